"""The live view, driven by events and by hand-fed time, without a screen."""

import imageio_ffmpeg
import pygame
import pytest

import slam_gym.viewer
from slam_gym.cli import main
from slam_gym.episode import Episode
from slam_gym.render import Renderer
from slam_gym.render_canvas import font
from slam_gym.scenario import Scenario
from slam_gym.viewer import KEYS, Viewer, check_display


@pytest.fixture
def viewer(tmp_path, monkeypatch):
    monkeypatch.setattr(slam_gym.viewer, "BUSY", 1e6)  # however slow the machine, nothing is left out
    scenario = Scenario.load("open", max_steps=60)
    episode = Episode(scenario, ["ekf", "dead-reckoning"], policy="constant:speed=0.5", seed=3)
    episode.warm_up()
    return Viewer(episode, Renderer("rgb_array", (560, 420)), tmp_path)


def press(viewer, key, character=""):
    viewer.handle(pygame.event.Event(pygame.KEYDOWN, key=key, unicode=character))


def release(viewer, key):
    viewer.handle(pygame.event.Event(pygame.KEYUP, key=key))


def type_(viewer, character):
    press(viewer, ord(character), character)


def test_time_passes_as_fast_as_asked(viewer):
    dt = viewer.episode.context.step_dt
    viewer.tick(2.5 * dt)
    assert viewer.episode.step_count == 2
    viewer.tick(0.6 * dt)
    assert viewer.episode.step_count == 3
    type_(viewer, "+")
    viewer.tick(1.0 * dt)
    assert viewer.episode.step_count == 5
    for _ in range(3):
        type_(viewer, "-")
    assert viewer.speed == 0.25


def test_a_pause_stops_and_n_steps(viewer):
    press(viewer, pygame.K_SPACE, " ")
    viewer.tick(0.2)
    assert viewer.episode.step_count == 0
    type_(viewer, "n")
    type_(viewer, "n")
    assert viewer.episode.step_count == 2
    press(viewer, pygame.K_SPACE, " ")
    viewer.tick(0.2)
    assert viewer.episode.step_count > 2


def test_tab_shows_the_other_estimator_on_the_same_data(viewer):
    viewer.tick(0.2)
    first = viewer.renderer.pixels()
    viewer.paused = True
    press(viewer, pygame.K_TAB, "\t")
    viewer.tick(0.0)
    assert viewer.shown == 1
    assert (first != viewer.renderer.pixels()).any()
    press(viewer, pygame.K_TAB, "\t")
    viewer.tick(0.0)
    assert viewer.shown == 0
    assert [len(history) for history in viewer._histories] == [3, 3]


@pytest.mark.parametrize(("character", "layer"), [("t", "truth"), ("b", "belief"), ("e", "ellipses"), ("r", "trails")])
def test_letters_toggle_layers(viewer, character, layer):
    type_(viewer, character)
    assert not getattr(viewer.renderer.layers, layer)
    type_(viewer, character)
    assert getattr(viewer.renderer.layers, layer)


def test_f_follows_the_robot_then_the_target_then_nobody(viewer):
    seen = []
    for _ in range(3):
        type_(viewer, "f")
        seen.append(viewer.renderer.follow)
    assert seen == ["robot", "target", None]


def test_d_divides_truth_and_belief(viewer):
    viewer.tick(0.0)
    together = viewer.renderer.pixels()
    type_(viewer, "d")
    viewer.tick(0.0)
    assert (together != viewer.renderer.pixels()).any()


def test_m_records_a_video_at_the_pace_of_the_clock(viewer, tmp_path):
    type_(viewer, "m")
    viewer.tick(0.0)
    assert "recording" in viewer.renderer.note
    for _ in range(6):
        viewer.tick(0.1)
    type_(viewer, "m")
    (file,) = tmp_path.glob("*.mp4")
    frames, size = imageio_ffmpeg.count_frames_and_secs(str(file))[0], viewer.renderer.size
    assert abs(frames - 18) <= 1  # 0.6 s at 30 pictures a second
    assert size == (560, 420)


def test_arrow_keys_take_over_and_p_gives_back(viewer):
    context = viewer.episode.context
    press(viewer, pygame.K_UP)
    press(viewer, pygame.K_LEFT)
    viewer.tick(0.11)
    assert viewer.episode.simulation.world.odometry[0] == pytest.approx([context.speed_max, 0.6 * context.turn_max])
    release(viewer, pygame.K_UP)
    release(viewer, pygame.K_LEFT)
    viewer.tick(0.11)
    assert viewer.episode.simulation.world.odometry[0] == pytest.approx([0.0, 0.0])
    assert "you drive" in viewer.renderer.note
    type_(viewer, "p")
    viewer.tick(0.11)
    assert viewer.episode.simulation.world.odometry[0, 0] == pytest.approx(0.5)


def test_all_that_the_note_says_has_room_on_a_small_screen(viewer):
    viewer.renderer = Renderer("rgb_array", (800, 600))
    for character in "-----":
        type_(viewer, character)
    viewer.tick(0.0)
    assert viewer.renderer.note == "1/16 x real time"
    press(viewer, pygame.K_LEFT)
    type_(viewer, "m")
    viewer.tick(0.0)
    panel = viewer.renderer._panel
    assert viewer.renderer.note == "1/16 x, you drive, recording"
    assert font(round(0.85 * panel.letter), bold=True).size(viewer.renderer.note)[0] <= panel.right - panel.left
    viewer.close()


def test_the_note_says_when_the_machine_does_not_keep_pace(viewer, monkeypatch):
    monkeypatch.setattr(slam_gym.viewer, "BUSY", 0.0)
    for _ in range(6):
        type_(viewer, "+")
    viewer.tick(0.01)  # one step fits, 0.64 s were asked for
    viewer.tick(0.0)
    assert viewer.episode.step_count == 1
    assert viewer.renderer.note == "< 64 x real time"


def test_a_recording_is_on_screen_also_at_the_end(viewer):
    type_(viewer, "m")
    for _ in range(60):
        viewer.tick(0.2)
    assert viewer.episode.finished
    assert "recording" in viewer.renderer.note
    viewer.close()


def test_a_video_of_an_odd_size_is_as_large_as_the_codec_takes(viewer, tmp_path, capfd):
    viewer.renderer = Renderer("rgb_array", (563, 421))
    type_(viewer, "m")
    viewer.tick(0.1)
    type_(viewer, "m")
    (file,) = tmp_path.glob("*.mp4")
    read = imageio_ffmpeg.read_frames(str(file))
    assert next(read)["size"] == (562, 420)
    read.close()
    assert "WARNING" not in capfd.readouterr().err


def test_enter_begins_the_next_world_after_the_end(viewer):
    for _ in range(60):
        viewer.tick(0.2)
    assert viewer.episode.finished
    assert viewer.renderer.note == "the end; enter: next world"
    press(viewer, pygame.K_RETURN, "\r")
    viewer.tick(0.0)
    assert viewer.episode.seed == 4
    assert viewer.episode.step_count == 0
    assert len(viewer._histories[0]) == 1


def test_s_saves_a_picture(viewer, tmp_path):
    viewer.tick(0.1)
    type_(viewer, "s")
    (file,) = tmp_path.iterdir()
    assert file.name == "open-ekf-1.png"
    assert pygame.image.load(file).get_size() == (560, 420)
    viewer.tick(0.0)
    assert viewer.renderer.note == "saved open-ekf-1.png"
    type_(viewer, "s")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["open-ekf-1-2.png", "open-ekf-1.png"]


def test_a_picture_that_cannot_be_saved_is_a_message(viewer, tmp_path):
    viewer.folder = tmp_path / "missing"
    viewer.tick(0.0)
    type_(viewer, "s")
    viewer.tick(0.0)
    assert viewer.renderer.note.startswith("not saved")


@pytest.mark.parametrize("event", [
    pygame.event.Event(pygame.QUIT), pygame.event.Event(pygame.KEYDOWN, key=pygame.K_q, unicode="q"),
    pygame.event.Event(pygame.KEYDOWN, key=pygame.K_ESCAPE, unicode="\x1b"),
])  # fmt: skip
def test_it_can_be_left(viewer, event):
    viewer.handle(event)
    assert not viewer.running


def test_the_keys_are_on_the_screen(viewer):
    assert viewer.renderer.keys is KEYS
    named = " ".join(key for key, _ in KEYS).split()
    assert {"space", "n", "+", "tab", "t", "e", "f", "d", "l", "arrows", "p", "s", "m", "q"} <= set(named)


def test_no_display_is_said_at_once(monkeypatch):
    monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
    monkeypatch.setattr(pygame.display, "init", lambda: None)
    monkeypatch.setattr(pygame.display, "get_driver", lambda: "offscreen")
    with pytest.raises(ValueError, match=r"no window can be opened here \(offscreen\): set DISPLAY"):
        check_display()
    monkeypatch.setenv("SDL_VIDEODRIVER", "offscreen")  # asked for
    check_display()


def test_watch_runs_until_it_is_left(monkeypatch, capsys):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(Viewer, "tick", lambda self, elapsed: setattr(self, "running", False))
    assert main(["watch", "open", "--estimators", "ekf", "--size", "320", "240"]) == 0
    assert "Loading" in capsys.readouterr().out
