import math
import os

import numpy as np
import pygame
import pytest

from estimators.interface import TARGET
from slam_gym.render import Frame, History, Layers, Renderer
from slam_gym.render_canvas import Camera, ellipse_points, font, shortened, text
from slam_gym.render_legend import AXIS, FAINT, PAPER, legend
from slam_gym.render_map import WALL, view_outline
from slam_gym.render_panel import UNDEFINED, number, rows
from slam_gym.render_pygame import show_directly
from slam_gym.render_smooth import halve
from slam_gym.viewer import KEYS

LANDMARKS = np.array([[-6.0, -6.0], [6.0, -5.0], [3.0, 0.5], [-5.0, 5.0]])


CLOUD_POINTS = np.array([[-3.0, 3.0], [3.0, -3.0], [4.0, 4.0], [-4.0, -3.5]])


def make_frame(step=0, **changes):
    """A robot on a line through pillars, a target ahead of it, a belief a little off."""
    pose = np.array([-4.0 + 0.1 * step, 0.0, 0.1])
    target = np.array([1.0, 1.0 + 0.05 * step, 1.5])
    settings = {
        "time": 0.1 * step, "step": step, "scenario": "default", "estimator": "ekf", "walls": True, "pose": pose,
        "target": target, "landmarks": LANDMARKS, "landmark_radius": np.full(4, 0.5), "opaque": True,
        "field_of_view": 2.1, "returns": np.array([[5.1, 0.1], [2.0, -0.6], [3.0, 0.7]]),
        "sources": np.array([TARGET, -1, 2]), "time_since_seen": 0.0, "belief_pose": pose + np.array([0.3, -0.2, 0.1]),
        "belief_pose_cov": np.diag([0.2, 0.05, 0.01]), "belief_target": target[:2] + np.array([0.2, -0.4]),
        "belief_target_cov": np.array([[0.3, 0.1], [0.1, 0.2]]), "belief_landmarks": LANDMARKS[:2] + 0.3,
        "belief_landmark_cov": np.tile(0.1 * np.eye(2), (2, 1, 1)),
        "particles": pose + np.random.default_rng(0).normal(0, 0.8, (40, 3)), "robot_error": 0.36,
        "heading_error": 0.1, "target_error": 0.45, "pose_nees": 3.0, "target_nees": 1.0, "reward": 0.7,
        "belief_target_heading": 1.4, "belief_target_heading_std": 0.2,
        "cloud": target[:2] + np.random.default_rng(1).normal(0, 1.5, (60, 2)), "cloud_weights": np.full(60, 1 / 60),
    }  # fmt: skip
    return Frame(**{**settings, **changes})


def picture(frame, size=(480, 400), layers=None, history=None, follow=None, split=False):
    renderer = Renderer(size=size)
    renderer.layers = layers or Layers()
    renderer.follow, renderer.split = follow, split
    return renderer.draw(frame, history)


# ------------------------------------------------------------------------------------------------ the whole picture


@pytest.mark.parametrize("size", [(800, 600), (200, 160), (1280, 400), (333, 777)])
def test_a_picture_is_an_array_of_bytes(size):
    image = picture(make_frame(), size)
    assert image.shape == (size[1], size[0], 3)
    assert image.dtype == np.uint8
    assert image.flags.c_contiguous
    assert image.flags.writeable
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 50


def test_the_same_frames_give_the_same_pixels():
    first, second = Renderer(size=(600, 400)), Renderer(size=(600, 400))
    for step in range(3):
        np.testing.assert_array_equal(first.draw(make_frame(step)), second.draw(make_frame(step)))


def test_a_window_shows_the_same_pixels(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window, array = Renderer("human", (600, 400)), Renderer("rgb_array", (600, 400))
    try:
        assert window.draw(make_frame()) is None
        shown = pygame.surfarray.array3d(window.window).swapaxes(0, 1)
        np.testing.assert_array_equal(shown, array.draw(make_frame()))
        np.testing.assert_array_equal(window.pixels(), array.pixels())
    finally:
        window.close()
    assert window.window is None
    np.testing.assert_array_equal(window.pixels(), array.pixels())


@pytest.mark.parametrize(("driver", "before", "after"), [
    ("x11", None, "0"), ("x11", "opengl", "opengl"), ("wayland", None, None), ("cocoa", None, None),
])  # fmt: skip
def test_x11_alone_is_shown_without_opengl_unless_asked(driver, before, after, monkeypatch):
    monkeypatch.setenv("SDL_FRAMEBUFFER_ACCELERATION", before or "")  # so that it is as it was afterwards
    if before is None:
        monkeypatch.delenv("SDL_FRAMEBUFFER_ACCELERATION")
    monkeypatch.setattr(pygame.display, "get_driver", lambda: driver)
    show_directly()
    assert os.environ.get("SDL_FRAMEBUFFER_ACCELERATION") == after


def test_a_window_may_get_another_size_between_two_pictures(monkeypatch):
    """Also a smaller one, in which the old picture's last rows would be written behind the window's memory."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window = Renderer("human", (600, 400))
    try:
        for size in ((600, 300), (320, 300), (900, 700), (160, 120), (100, 80), (160, 120)):
            pygame.display.set_mode(size, pygame.RESIZABLE)
            window.draw(make_frame())
            drawn = (max(size[0], 160), max(size[1], 120))
            array = Renderer("rgb_array", drawn).draw(make_frame())
            np.testing.assert_array_equal(window.pixels(), array)
            shown = pygame.surfarray.array3d(window.window).swapaxes(0, 1)
            np.testing.assert_array_equal(shown, array[: size[1], : size[0]])
    finally:
        window.close()


def test_fonts_survive_a_quit_elsewhere():
    before = picture(make_frame(), (800, 600))
    pygame.quit()
    np.testing.assert_array_equal(picture(make_frame(), (800, 600)), before)


@pytest.mark.parametrize(("arguments", "message"), [
    ({"mode": "ansi"}, "'rgb_array', 'human'; got 'ansi'"), ({"size": (20, 600)}, "at least 160 x 120 pixels"),
])  # fmt: skip
def test_impossible_renderers_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Renderer(**arguments)


@pytest.mark.parametrize("layer", ["truth", "belief", "ellipses", "trails", "view", "scan", "particles", "cloud"])
def test_each_layer_draws_something(layer):
    history = History()
    for step in range(20):
        history.record(make_frame(step))
    everything = picture(make_frame(20), history=history)
    without = picture(make_frame(20), layers=Layers(**{layer: False}), history=history)
    assert (everything != without).any(axis=2).sum() > 20


def test_hidden_truth_leaves_no_pixel_that_depends_on_it():
    """Truth off: moving the true target, robot and landmarks changes nothing on the map."""
    frame, other = make_frame(), make_frame(landmarks=LANDMARKS - 0.7, target=np.array([-3.0, 4.0, 0.0]))
    layers = Layers(truth=False)
    np.testing.assert_array_equal(picture(frame, layers=layers), picture(other, layers=layers))


@pytest.mark.parametrize("changes", [
    {"target": None, "belief_target": None, "belief_target_cov": None, "time_since_seen": None},
    {"belief_target": None, "belief_target_cov": None, "target_error": math.nan, "target_nees": math.nan},
    {"landmarks": np.zeros((0, 2)), "landmark_radius": np.zeros(0)},
    {"belief_landmarks": np.zeros((0, 2)), "belief_landmark_cov": np.zeros((0, 2, 2))},
    {"returns": np.zeros((0, 2)), "sources": np.zeros(0, dtype=np.int64)},
    {"particles": None, "pose_nees": math.inf, "robot_error": math.inf},
    {"belief_pose_cov": np.zeros((3, 3)), "pose_nees": math.nan},
    {"cloud": None, "cloud_weights": None, "reward": math.nan, "belief_target_heading_std": math.nan},
    {"belief_target_cov": 1e12 * np.eye(2), "belief_target": np.array([1e9, -1e9])},
])  # fmt: skip
def test_nothing_that_may_be_missing_or_absurd_stops_the_picture(changes):
    assert picture(make_frame(**changes), (800, 600)).shape == (600, 800, 3)


def test_side_by_side_the_left_half_is_truth_alone_and_the_right_half_belief_alone():
    frame, believed_elsewhere = make_frame(), make_frame(belief_pose=np.array([3.0, -3.0, 0.0]))
    truth_elsewhere = make_frame(landmarks=LANDMARKS - 0.7)
    size = (480, 300)  # without panel and strip: the map is the whole picture
    one, other, third = (picture(f, size, split=True) for f in (frame, believed_elsewhere, truth_elsewhere))
    left, right = slice(0, 240), slice(240, 480)
    np.testing.assert_array_equal(one[:, left], other[:, left])
    assert (one[:, right] != other[:, right]).any()
    np.testing.assert_array_equal(one[:, right], third[:, right])
    assert (one[:, left] != third[:, left]).any()


def test_side_by_side_the_legend_holds_both_and_a_line_divides_them():
    """Whichever is hidden in the overlay; followed, the floors of both reach the middle."""
    hidden = Layers(truth=False, belief=False)
    np.testing.assert_array_equal(
        picture(make_frame(), (800, 600), hidden, split=True), picture(make_frame(), (800, 600), split=True)
    )
    image = picture(make_frame(arena=(80.0, 80.0)), (800, 600), follow="robot", split=True)
    middle = Renderer(size=(800, 600))._map.width // 2
    assert (image[200:480, middle] == AXIS).all()


def test_an_empty_map_says_why():
    shown, hidden = (
        picture(make_frame(), (800, 600), Layers(belief=False, truth=t, view=t, scan=t)) for t in (True, False)
    )
    assert not (shown == FAINT).all(axis=2)[:300, 150:430].any()
    assert (hidden == FAINT).all(axis=2)[:300, 150:430].any()


def test_the_view_does_not_hide_the_walls():
    """A robot at the wall looks through it: its sensor knows of pillars only."""
    frame = make_frame(pose=np.array([9.5, 0.0, 0.0]), target=None, belief_target=None, belief_target_cov=None)
    nothing = Layers(belief=False, trails=False, scan=False, view=False)
    watched = picture(frame, (800, 600), Layers(belief=False, trails=False, scan=False))
    bare = picture(frame, (800, 600), nothing)
    assert (watched != bare).any()
    assert (watched == WALL).all(axis=2).sum() == (bare == WALL).all(axis=2).sum() > 500


def test_the_strip_shows_the_reward():
    good, bad = History(), History()
    for step in range(20):
        good.record(make_frame(step, reward=0.9))
        bad.record(make_frame(step, reward=-2.5))
    frame = make_frame(20)
    changed = (picture(frame, (800, 600), history=good) != picture(frame, (800, 600), history=bad)).any(axis=2)
    assert changed.any()
    assert not changed[:480].any()  # nothing but the strip


def test_following_keeps_the_robot_in_the_middle():
    """The robot's dark symbol stands in the middle of the map wherever it drives."""
    for x in (-4.0, 30.0):
        frame = make_frame(pose=np.array([x, 2.0, 0.0]), belief_pose=np.array([x, 2.0, 0.0]))
        image = picture(frame, (300, 300), layers=Layers(belief=False), follow="robot")
        assert image[150, 150].max() < 90


# -------------------------------------------------------------------------------------------------------- geometry


def test_the_ellipse_has_the_axes_of_the_eigen_decomposition():
    cov = np.array([[0.5, 0.2], [0.2, 0.3]])
    values, vectors = np.linalg.eigh(cov)
    rel = ellipse_points([2.0, -1.0], cov) - [2.0, -1.0]
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", rel, np.linalg.inv(cov), rel), 5.991464547, rtol=1e-9)
    along = np.abs(rel @ vectors).max(axis=0)
    np.testing.assert_allclose(along, np.sqrt(5.991464547 * values), rtol=1e-9)


def test_the_ellipse_holds_95_percent():
    rng = np.random.default_rng(0)
    cov = np.array([[2.0, -1.2], [-1.2, 1.0]])
    draws = rng.multivariate_normal([0.0, 0.0], cov, 40_000)
    outline = ellipse_points([0.0, 0.0], cov)
    following = np.roll(outline, -1, axis=0)
    edge = following - outline
    turn = np.sign(np.sum(outline[:, 0] * following[:, 1] - outline[:, 1] * following[:, 0]))
    inside = np.ones(len(draws), dtype=bool)
    for start, step in zip(outline, edge, strict=True):
        inside &= turn * (step[0] * (draws[:, 1] - start[1]) - step[1] * (draws[:, 0] - start[0])) > 0.0
    assert inside.mean() == pytest.approx(0.95, abs=0.006)  # a polygon of 48 corners loses 0.2 %


def test_a_covariance_that_is_not_positive_draws_no_nan():
    assert np.isfinite(ellipse_points([0.0, 0.0], [[1.0, 0.0], [0.0, -1e-12]])).all()


def test_the_camera_shows_the_whole_box_upright():
    area = pygame.Rect(10, 20, 300, 200)
    camera = Camera.fit(area, [-10.0, -4.0], [10.0, 4.0], margin=0.1)
    low, high = camera.pixels([[-10.0, -4.0], [10.0, 4.0]])
    assert area.left <= low[0] < high[0] <= area.right
    assert area.top <= high[1] < low[1] <= area.bottom
    np.testing.assert_allclose(camera.pixels([0.0, 0.0]), area.center)
    assert high[0] - low[0] == pytest.approx(0.8 * 300)


def test_the_view_ends_at_a_pillar():
    frame = make_frame(landmarks=np.array([[3.0, 0.0]]), landmark_radius=np.array([0.5]), max_range=6.0)
    outline = view_outline(frame, np.zeros(3))
    np.testing.assert_allclose(outline[0], 0.0)
    distance = np.hypot(*outline[1:].T)
    assert distance[60] == pytest.approx(2.5)  # straight ahead
    assert distance[0] == distance[-1] == pytest.approx(6.0)
    shadow = np.degrees(np.arctan2(outline[1:, 1], outline[1:, 0]))[distance < 5.9]
    assert np.abs(shadow).max() == pytest.approx(np.degrees(math.asin(0.5 / 3.0)), abs=1.1)


def test_points_cast_no_shadow_and_a_full_turn_has_no_edge():
    frame = make_frame(opaque=False, field_of_view=2.0 * math.pi)
    np.testing.assert_allclose(np.hypot(*view_outline(frame, np.zeros(3)).T), frame.max_range)


# ------------------------------------------------------------------------------------------------ history and words


def test_history_grows_and_starts_anew_with_an_episode():
    history = History()
    for step in range(600):
        history.record(make_frame(step))
    assert len(history) == 600
    np.testing.assert_allclose(history.track("")[:, 0], -4.0 + 0.1 * np.arange(600))
    assert history.column("seen").all()
    history.record(make_frame(599, pose_nees=7.0))  # the same step again
    assert len(history) == 600
    assert history.column("pose_nees")[-1] == 7.0
    history.record(make_frame(0))
    assert len(history) == 1


def test_an_unknown_target_interrupts_its_trail():
    history = History()
    history.record(make_frame(0))
    history.record(make_frame(1, belief_target=None, belief_target_cov=None))
    assert np.isnan(history.track("belief_target_")[1]).all()
    assert np.isfinite(history.track("target_")[1]).all()


def test_the_panel_says_what_is_known_of_the_target():
    seen = dict(rows(make_frame()))
    assert seen["target"] == "in view"
    assert seen["landmarks mapped"] == "2 of 4"
    unseen = dict(rows(make_frame(50, sources=np.array([-1, 0, 2]), time_since_seen=3.25)))
    assert unseen["target"] == "unseen 3.2 s"
    for step in (0, 50):  # the world counts from the start before the first return
        never = dict(rows(make_frame(step, sources=np.array([-1, 0, 2]), time_since_seen=0.1 * step)))
        assert never["target"] == "not seen yet"
    assert not any("target" in name for name in dict(rows(make_frame(target=None))))


def test_numbers_are_short():
    assert number(1.234, "m") == "1.23 m"
    assert number(math.nan, "m") == UNDEFINED
    assert number(math.inf, "") == "> 10⁴"


def test_long_words_are_cut():
    surface = pygame.Surface((200, 40), 0, 32)
    text(surface, "a rather long name of an estimator", (0, 0), (255, 255, 255), 14, max_width=90)
    lit = pygame.surfarray.array3d(surface).any(axis=(1, 2))
    assert 60 < np.flatnonzero(lit).max() <= 90
    assert font(14) is font(14)


def test_a_cut_in_the_middle_keeps_both_ends():
    """A file's name ends in what tells it from the others."""
    found = shortened("saved default-dead-reckoning-277.mp4", font(14), 120, "middle")
    assert found.startswith("saved …")
    assert found.endswith("7.mp4")
    assert font(14).size(found)[0] <= 120
    assert shortened("saved", font(14), 120, "middle") == "saved"
    assert shortened("saved", font(14), 1) == "…"


def test_a_picture_is_halved_by_the_mean_of_four_pixels():
    large = np.random.default_rng(0).integers(0, 256, (12, 20, 4), dtype=np.uint8)
    small = np.zeros((6, 10), dtype=np.uint32)
    halve(large.reshape(12, 80).view(np.uint32), small, 0, 0, 10, 6)
    found = small.view(np.uint8).reshape(6, 10, 4).astype(float)
    mean = large.reshape(6, 2, 10, 2, 4).mean(axis=(1, 3))
    assert np.all((mean - 1.5 < found) & (found <= mean))
    white = np.full((4, 4), np.iinfo(np.uint32).max, dtype=np.uint32)
    halve(white, small[:2, :2], 0, 0, 2, 2)
    assert np.all(small[:2, :2] == np.iinfo(np.uint32).max)


def test_only_the_named_part_of_a_picture_is_halved():
    large = np.random.default_rng(1).integers(0, 256, (12, 20, 4), dtype=np.uint8).reshape(12, 80).view(np.uint32)
    whole, part = np.zeros((2, 6, 10), dtype=np.uint32)
    halve(large, whole, 0, 0, 10, 6)
    halve(large, part, 2, 1, 9, 4)
    assert np.array_equal(part[1:4, 2:9], whole[1:4, 2:9])
    part[1:4, 2:9] = 0
    assert not part.any()


def test_points_grow_with_the_picture():
    small, large = (Renderer(size=size) for size in ((800, 600), (1600, 1200)))
    coloured = []
    for renderer in (small, large):
        renderer.layers = Layers(truth=False, trails=False, view=False, scan=False, ellipses=False)
        with_cloud, without = (renderer.draw(make_frame(**changes)).astype(int) for changes in (
            {"particles": None, "cloud": CLOUD_POINTS, "cloud_weights": np.full(4, 0.25)}, {"particles": None},
        ))  # fmt: skip
        map_only = (slice(0, renderer._map.height), slice(0, renderer._map.width))
        coloured.append((with_cloud != without)[map_only].any(axis=2).sum())
    assert 2.5 < coloured[1] / coloured[0] < 5.5  # areas: four times


def test_nothing_remains_of_the_picture_before():
    kept = Renderer(size=(700, 500))
    far = make_frame(arena=(30.0, 10.0), landmarks=np.array([[14.0, 4.0]]), landmark_radius=np.ones(1))
    changes = [({}, {}), ({"split": True}, {}), ({}, {"layers": Layers(truth=False)}), ({"follow": "robot"}, {})]
    for change, layers in [*changes, ({}, {"layers": Layers(scan=False, view=False)})]:
        for frame in (far, make_frame(), make_frame(keeps_cloud=True, cloud=None, cloud_weights=None)):
            fresh = Renderer(size=(700, 500))
            for renderer in (kept, fresh):
                renderer.split, renderer.follow, renderer.layers = False, None, Layers()
                for name, value in {**change, **layers}.items():
                    setattr(renderer, name, value)
            history = History()
            history.record(frame)
            assert np.array_equal(kept.draw(frame, history), fresh.draw(frame, history))


@pytest.mark.parametrize("size", [(800, 600), (1200, 800), (1920, 1080)])
def test_the_panel_has_room_for_all_that_may_stand_in_it(size):
    frame = make_frame(keeps_cloud=True, false_alarms=True, collisions=3)
    renderer = Renderer(size=size)
    renderer.keys = KEYS
    without = renderer.draw(frame)
    renderer.note = "1/16 x, you drive, recording"
    changed = (renderer.draw(frame) != without).any(axis=(1, 2))
    assert changed.any()
    panel = without[changed, size[0] - renderer._panel.area.width + 2 :]
    assert (panel == PAPER).all()  # the note stands on nothing else
    renderer.keys, renderer.note = KEYS[:-1], ""
    fewer = renderer.draw(frame)
    last = slice(size[1] - 2 * renderer._letter, None)
    assert (fewer[last] != without[last]).any()  # the last key is on the picture


def test_the_legend_stays_while_the_target_comes_and_goes():
    lost = make_frame(keeps_cloud=True)
    seen = make_frame(keeps_cloud=True, cloud=None, cloud_weights=None)
    assert [words for _, words in legend(lost, Layers())] == [words for _, words in legend(seen, Layers())]
