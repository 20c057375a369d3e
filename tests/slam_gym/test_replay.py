import math
from pathlib import Path

import numpy as np
import pytest

from estimators.interface import TARGET, UNKNOWN
from estimators.models import MotionModel, SensorModel, TargetModel
from slam_gym import mrclam, plots
from slam_gym.cli import main
from slam_gym.recording import Recording
from slam_gym.replay import replay
from slam_gym.replay_models import ReplayModels, mrclam_models, parse_calibration
from slam_gym.report import write_report
from slam_gym.results import Results
from slam_gym.schedule import NONE, make_schedule

SET_7 = Path(__file__).resolve().parents[2] / "../shared/data/mrclam/MRCLAM_Dataset7"
MODELS = ReplayModels(
    motion=MotionModel(speed_std=0.02, turn_std=0.02, noise_law="root-second"),
    sensor=SensorModel(max_range=9.0, range_std=0.05, bearing_std=0.02),
    target=TargetModel(acceleration_density=0.05, initial_speed_std=0.3),
)
LANDMARKS = np.array([[12, 2.0, 1.0], [7, -1.0, 3.0], [30, 1.0, -2.0], [31, 3.0, -2.0]])


def circle(duration=20.0, *, delay=0.0, target_gap=(8.0, 12.0), **changes):
    """A robot on a circle among four landmarks, a target on a line; perfect odometry, small noise, 4 sweeps/s."""
    rng = np.random.default_rng(3)
    times = np.arange(0.0, duration, 0.01)
    heading = 0.3 * times
    pose = np.column_stack([np.sin(heading) / 0.3 * 0.5, (1 - np.cos(heading)) / 0.3 * 0.5, heading])
    target = np.column_stack([1.0 + 0.1 * times, 0.05 * times])
    commands = np.array([[-delay, 0.5, 0.3], [duration - delay, 0.5, 0.3]])
    rows = []
    for k in range(25, len(times), 25):
        hidden = target_gap[0] < times[k] < target_gap[1]
        points = [*LANDMARKS, *([] if hidden else [[TARGET, *target[k]]])]
        for label, x, y in points:
            dx, dy = x - pose[k, 0], y - pose[k, 1]
            noise = rng.normal(0.0, [0.05, 0.02])
            rows.append([times[k], label, math.hypot(dx, dy) + noise[0], math.atan2(dy, dx) - heading[k] + noise[1]])
    tables = {
        "odometry": commands,
        "measurements": rows,
        "truth": np.column_stack([times, pose]),
        "target": np.column_stack([times, target]),
        "landmarks": LANDMARKS,
    }
    tables |= changes
    return Recording.from_tables("circle", {name: rows for name, rows in tables.items() if rows is not None})


def test_steps_end_exactly_at_sweeps_and_samples():
    recording = circle()
    schedule = make_schedule(recording, sample_rate=2.0)
    sweeps = schedule.sweep != NONE
    np.testing.assert_array_equal(schedule.times[sweeps], recording.sweep_times[schedule.sweep[sweeps]])
    samples = schedule.sample != NONE
    np.testing.assert_array_equal(schedule.times[samples], schedule.sample_times)
    np.testing.assert_allclose(schedule.sample_times, schedule.start + np.arange(1, 40) / 2.0, atol=1e-9)
    assert 0.0 < schedule.dt.min() and schedule.dt.max() <= 0.05 + 1e-12
    moved = (schedule.controls * schedule.dt[:, None]).sum(axis=0)
    np.testing.assert_allclose(moved, np.array([0.5, 0.3]) * schedule.dt.sum(), rtol=1e-9)


def test_a_sweep_right_at_the_start_is_taken():
    first = [[0.0, label, math.hypot(x, y), math.atan2(y, x)] for label, x, y in LANDMARKS]
    recording = circle(5.0, measurements=first)
    schedule = make_schedule(recording)
    assert schedule.sweep[0] == 0 and schedule.times[0] == schedule.start and np.isfinite(schedule.controls).all()
    assert replay(recording, ["ekf"], MODELS).runs["landmark_count"].tolist() == [len(LANDMARKS)]


def test_a_replay_begins_where_the_truth_does():
    times = np.concatenate([[-5.0], np.arange(3.0, 20.0, 0.01)])
    heading = 0.3 * np.maximum(times, 0.0)
    path = np.column_stack([times, np.sin(heading) / 0.3 * 0.5, (1 - np.cos(heading)) / 0.3 * 0.5, heading])
    recording = circle(truth=path)
    assert make_schedule(recording).start == pytest.approx(3.01)
    assert replay(recording, ["ekf"], MODELS).runs["robot_error_rmse"].max() < 0.2


def test_delayed_commands_move_later():
    odometry = [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [2.0, 0.0, 0.0], [5.0, 0.0, 0.0]]
    recording = circle(5.0, odometry=odometry)
    schedule = make_schedule(recording, command_delay=0.25)
    moving = schedule.controls[:, 0] > 0.5
    assert schedule.times[moving][-1] == pytest.approx(2.25, abs=0.03)
    assert (schedule.controls[:, 0] * schedule.dt).sum() == pytest.approx(1.0)


def test_recordings_that_do_not_overlap_are_refused():
    truth = np.column_stack([np.arange(100.0, 110.0), np.zeros((10, 3))])
    with pytest.raises(ValueError, match="commands and recorded truth do not overlap"):
        make_schedule(circle(truth=truth))
    with pytest.raises(ValueError, match="sample_rate must be positive; got 0"):
        make_schedule(circle(), sample_rate=0.0)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    out = tmp_path_factory.mktemp("replay") / "out"
    found = replay(circle(), ["dead-reckoning", "ekf", "ri-ekf"], MODELS, inflations=(1.0, 4.0), out=out)
    found.save()
    return found


def test_tables_of_a_replay(results):
    summary = results.summary.set_index("estimator")
    assert list(summary.index) == [
        "dead-reckoning", "dead-reckoning (R x4)", "ekf", "ekf (R x4)", "ri-ekf", "ri-ekf (R x4)",
    ]  # fmt: skip
    assert set(summary["policy"]) == {"recorded"}
    for name in ("ekf", "ri-ekf"):
        row = summary.loc[name]
        assert row["robot_error_rmse"] < 0.1
        assert row["target_error_lt2"] < 0.15
        assert row["target_error_2_15"] < 0.6
        assert np.isnan(row["target_error_gt15"])
        assert row["landmark_error_rmse"] < 0.15
        assert row["pose_nees_mean"] < 9.0
        assert row["landmark_count"] == 4
        assert not row["diverged"]
    assert summary.loc["ekf (R x4)", "pose_nees_mean"] < summary.loc["ekf", "pose_nees_mean"]
    assert set(results.landmarks["id"]) == {7, 12, 30, 31}
    track = results.tracks[results.tracks["estimator"] == "ri-ekf"]
    assert len(track) == 19 and track["target_seen"].sum() in range(15, 18)
    loaded = Results.load(results.path)
    assert loaded.summary["robot_error_rmse"].tolist() == results.summary["robot_error_rmse"].tolist()


def test_a_command_delay_is_made_good():
    late = circle(delay=0.5)
    rows = {d: replay(late, ["dead-reckoning"], _delayed(d)).summary.iloc[0] for d in (0.0, 0.5)}
    assert rows[0.5]["robot_error_rmse"] < 0.03


def _delayed(seconds):
    return ReplayModels(motion=MODELS.motion, sensor=MODELS.sensor, target=MODELS.target, command_delay=seconds)


def test_mis_read_labels_are_gated():
    recording = circle()
    rng = np.random.default_rng(0)
    labels = recording.labels.copy()
    wrong = rng.random(len(labels)) < 0.03
    wrong[:20] = False
    labels[wrong] = rng.choice([7, 12, 30, 31], wrong.sum())
    swapped = Recording(**{f: getattr(recording, f) for f in Recording.__slots__} | {"labels": labels})
    gated, trusting = (replay(swapped, ["ekf"], MODELS, gate=gate).summary.iloc[0] for gate in (13.8, math.inf))
    assert gated["robot_error_rmse"] < 0.15 < trusting["robot_error_rmse"]


def test_hidden_ids_and_unsurveyed_landmarks():
    row = replay(circle(), ["ekf"], MODELS, association="nearest").summary.iloc[0]
    assert row["robot_error_rmse"] < 0.2 and row["landmark_error_rmse"] < 0.3
    partly = replay(circle(landmarks=LANDMARKS[:1]), ["ekf"], MODELS)
    assert partly.landmarks["id"].tolist() == [12, 7, 30, 31]
    assert partly.landmarks["true_x"].notna().sum() == 1


def test_without_truth_nothing_is_scored():
    found = replay(circle(truth=None, target=None, landmarks=None), ["ekf"], MODELS)
    assert found.summary["robot_error_rmse"].isna().all()
    assert found.summary["pose_nees_mean"].isna().all()
    assert not found.summary["diverged"].any()
    assert found.tracks["x"].notna().all()


def test_a_report_without_truth_shows_the_believed_path(tmp_path):
    found = replay(circle(truth=None, target=None, landmarks=None), ["ekf", "ri-ekf"], MODELS, out=tmp_path / "here")
    page = write_report(found).read_text(encoding="utf-8")
    assert page.count("<img") == 1  # the path; nothing is scored
    figure = plots.trajectories(found.tracks, found.landmarks)
    low, high = figure.axes[0].get_xlim()
    assert low < found.tracks["x"].min() < found.tracks["x"].max() < high


def test_truth_of_the_target_may_end_early():
    target = np.column_stack([np.arange(0.0, 5.0, 0.1), np.ones((50, 2))])
    found = replay(circle(target=target), ["ekf"], MODELS)
    assert found.series["target_error"].notna().sum() == 4
    assert np.isfinite(found.summary["target_nees_mean"]).all()


def test_the_same_replay_gives_the_same_numbers():
    first, second = (replay(circle(), ["slamto:particles=20"], MODELS).tracks for _ in range(2))
    assert first.equals(second)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"estimators": ["kalman"]}, "unknown estimator 'kalman'"),
        ({"estimators": []}, "at least one estimator"),
        ({"estimators": ["ideal-ekf"]}, "'ideal-ekf' needs the truth"),
        ({"estimators": ["ekf:colour=3"]}, "estimator 'ekf': unknown option 'colour'. Choices: "),
        ({"inflations": [-1.0]}, "noise inflation .* must be positive, got -1"),
    ],
)
def test_wrong_calls(arguments, message):
    with pytest.raises(ValueError, match=message):
        replay(**{"recording": circle(2.0), "estimators": ["ekf"], "models": MODELS} | arguments)


def test_calibrations():
    assert parse_calibration("mrclam") == (0.935, 0.948, -0.0023)
    assert parse_calibration("none") == (1.0, 1.0, 0.0)
    assert parse_calibration("0.9, 1.1,0.01") == (0.9, 1.1, 0.01)
    for text in ("0.9,1.1", "good"):
        with pytest.raises(ValueError, match=r"'mrclam', 'none' or SPEED,TURN,BIAS"):
            parse_calibration(text)


def test_unknown_returns_do_not_disturb():
    recording = circle()
    labels = np.where(np.arange(len(recording.labels)) % 7 == 0, UNKNOWN, recording.labels)
    partly = Recording(**{f: getattr(recording, f) for f in Recording.__slots__} | {"labels": labels})
    assert replay(partly, ["ekf"], MODELS).summary["robot_error_rmse"].iloc[0] < 0.1


@pytest.mark.skipif(not SET_7.is_dir(), reason="the data set is not here")
@pytest.mark.parametrize(("robot", "target"), [(5, 1), (3, 4)])
def test_recorded_robots(robot, target):
    recording = mrclam.load(SET_7, robot, target)
    names = ["ekf", "fej-ekf", "ri-ekf", "cdkf"]
    found = replay(recording, names, mrclam_models(), inflations=(1.0, 16.0))
    assert np.isfinite(found.tracks[["x", "y", "heading", "pose_cov_xx", "pose_cov_yy"]]).all(axis=None)
    late = found.tracks[found.tracks["time"] > 300.0]
    assert np.isfinite(late[["target_x", "target_y", "target_cov_xx", "target_cov_yy"]]).all(axis=None)
    assert not np.isinf(found.series[["pose_nees", "target_nees"]]).any(axis=None)
    row = found.summary.set_index("estimator").loc["ri-ekf (R x16)"]
    assert row["robot_error_rmse"] <= 0.40
    assert row["target_error_lt2"] <= 0.60


def test_the_command(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    from slam_gym import log_format

    log_format.save(tmp_path / "circle", circle(3.0))
    words = ["replay", "log", "circle", "--scenario", "open", "--estimators", "ekf", "--noise-inflation", "4"]
    assert main([*words, "--no-report"]) == 0
    said = capsys.readouterr().out
    assert "ekf (R x4)" in said
    assert "RMSE [m, rad]" in said
    assert "Note: there is no recorded truth" not in said
    assert Results.load("results/replay-circle").summary["n_runs"].tolist() == [1, 1]
    assert main([*words, "--out", "results/replay-circle"]) == 2
    assert "never overwritten" in capsys.readouterr().err
    (tmp_path / "circle" / "truth.csv").unlink()
    assert main([*words, "--no-report"]) == 0
    assert "Note: there is no recorded truth, so nothing is scored" in capsys.readouterr().out
    assert main(["replay", "mrclam", "nowhere", "--robot", "1", "--target", "2"]) == 2
    assert "expected an unpacked MRCLAM data set" in capsys.readouterr().err
