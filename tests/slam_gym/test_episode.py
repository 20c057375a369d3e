"""One episode: its loop, its table, and what `slam-gym run` writes."""

import numpy as np
import pygame
import pytest
from rich.console import Console

from slam_gym.cli import main
from slam_gym.commands.run import Run
from slam_gym.episode import Episode
from slam_gym.episode_log import EpisodeLog
from slam_gym.render import Renderer
from slam_gym.scenario import Scenario
from slam_gym.video import VideoWriter

SHORT = ("--steps", "12", "--size", "400", "300")


def test_the_same_seed_gives_the_same_episode_and_the_estimators_change_nothing():
    scenario = Scenario.load("default", max_steps=30)
    paths = []
    for estimators in (["ekf"], ["ekf", "dead-reckoning"]):
        episode = Episode(scenario, estimators, seed=5)
        episode.warm_up()
        path = []
        while not episode.finished:
            episode.step()
            path.append(episode.simulation.world.pose[0].copy())
        paths.append(np.array(path))
    assert paths[0].tobytes() == paths[1].tobytes()
    assert len(paths[0]) == 30
    assert episode.time == pytest.approx(3.0)


def test_a_route_at_its_end_finishes_the_episode():
    scenario = Scenario.load("open", max_steps=400)
    episode = Episode(scenario, policy=("waypoints", {"points": [[1.0, 0.0], [2.0, 0.0]], "radius": 0.3}))
    while not episode.finished:
        episode.step()
    assert 10 < episode.step_count < 100
    assert episode.simulation.world.step_count[0] == episode.step_count


def test_an_action_is_held_as_long_as_the_scenario_says():
    episode = Episode(Scenario.load("open", hold=5, max_steps=20), policy="random:hold_time=0")
    commands = []
    for _ in range(20):
        episode.step()
        commands.append(episode.simulation.world.odometry[0].copy())
    assert len(np.unique(np.array(commands), axis=0)) == 4


def test_no_estimator_is_refused():
    with pytest.raises(ValueError, match="at least one estimator"):
        Episode(Scenario.load("open"), [])


@pytest.mark.parametrize("scenario", ["default", "tian-sparse"])
def test_the_table_fits_80_columns_and_has_a_row_per_estimator(scenario):
    episode = Episode(Scenario.load(scenario, max_steps=20), ["ekf", "dead-reckoning"])
    log = EpisodeLog(episode)
    while not episode.finished:
        episode.step()
        log.record()
    console = Console(width=80, record=True, force_terminal=False, file=None, quiet=False)
    with console.capture() as captured:
        console.print(log.table())
    lines = captured.get().splitlines()
    assert max(map(len, lines)) <= 80
    assert any(line.startswith("ekf") for line in lines)
    assert any(line.startswith("dead-reckoning") for line in lines)
    assert ("target" in captured.get()) == (scenario == "default")
    assert "…" not in captured.get()
    assert log.metrics.shape == (20, 2)
    for row in log._metrics:  # a filter that is sure of what is wrong
        row["pose_nees"] = 3.2564e5
    with console.capture() as captured:
        console.print(log.table())
    assert "3.3e+05" in captured.get()
    assert "…" not in captured.get()


def test_a_long_name_is_folded_before_any_number_is_cut():
    episode = Episode(Scenario.load("default", max_steps=5), ["ekf:association=nearest,gate=20.5"])
    log = EpisodeLog(episode)
    episode.step()
    log.record()
    console = Console(width=80)
    with console.capture() as captured:
        console.print(log.table())
    said = captured.get()
    assert "…" not in said
    assert max(map(len, said.splitlines())) <= 80
    assert "ekf:association=nearest,gate=20.5" in "".join(line.split(" ")[0] for line in said.splitlines())


def test_run_writes_what_it_is_asked_for(tmp_path, capsys):
    files = [tmp_path / name for name in ("last.png", "drive.gif", "paths.png")]
    arguments = ("--png", str(files[0]), "--video", str(files[1]), "--plot", str(files[2]))
    assert main(["run", "open", "--estimators", "ekf", "dead-reckoning", *SHORT, *arguments]) == 0
    assert pygame.image.load(files[0]).get_size() == (400, 300)
    assert files[1].read_bytes()[:3] == b"GIF"
    assert files[2].stat().st_size > 10_000
    said = capsys.readouterr().out
    assert "dead-reckoning" in said
    assert "last.png" in said.replace("\n", "")


@pytest.mark.parametrize(("arguments", "message"), [
    (("nowhere",), "unknown scenario 'nowhere'"), (("--policy", "persuit"), "Did you mean 'pursuit'"),
    (("--policy", "pursuit:standoff=2"), "Did you mean 'stand_off'"), (("--estimators", "efk"), "Did you mean 'ekf'"),
    (("--video", "a.avi"), ".mp4 or .gif"), (("--video", "missing/a.gif"), "does not exist"),
    (("--png", "a.xyz"), "a picture is"), (("--png", "missing/a.png"), "does not exist"),
    (("--plot", "a.xyz"), "a figure is"), (("--size", "10", "10"), "at least 160 x 120"),
    (("--speed", "0"), "--speed must be positive"), (("--set", "sensor.max_range"), "key=value"),
])  # fmt: skip
def test_a_wrong_call_is_one_clear_line(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    extra = ("--png", "a.png") if "--size" in arguments else ()
    assert main(["run", *arguments, "--steps", "5", *extra]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_pictures_show_where_a_lost_target_may_be(tmp_path, monkeypatch, capsys):
    """As the live view does; the numbers are those of a run without pictures."""
    drawn = []
    monkeypatch.setattr(Renderer, "draw", lambda self, frame, history=None: drawn.append(frame))
    assert main(["run", "--steps", "30", "--png", str(tmp_path / "a.png")]) == 0
    assert drawn[-1].keeps_cloud
    with_picture = capsys.readouterr().out
    assert main(["run", "--steps", "30"]) == 0
    assert with_picture.startswith(capsys.readouterr().out)


def test_a_video_has_every_picture(tmp_path):
    from PIL import Image

    with VideoWriter(tmp_path / "a.gif", (64, 48), 10.0) as video:
        for shade in (0, 100, 200):
            video.write(np.full((48, 64, 3), shade, dtype=np.uint8))
    with Image.open(tmp_path / "a.gif") as image:
        assert image.n_frames == 3
        assert image.size == (64, 48)


def test_a_video_plays_in_real_time():
    episode = Episode(Scenario.load("slamto"))
    run = Run(speed=1.0)
    every = run._steps_per_picture(episode)
    assert every == 2  # 50 steps a second, 25 pictures
    assert Run(speed=4.0)._steps_per_picture(episode) == 7
