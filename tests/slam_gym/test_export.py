import numpy as np
import pytest

from estimators.interface import TARGET, UNKNOWN
from slam_gym import log_format, mrclam
from slam_gym.cli import main
from slam_gym.export import mrclam_files, record
from slam_gym.recording import Recording
from slam_gym.replay import replay
from slam_gym.replay_models import mrclam_models, scenario_models
from slam_gym.scenario import Scenario

STEPS = 1200


@pytest.fixture(scope="module")
def scenario():
    return Scenario.load("mrclam")


@pytest.fixture(scope="module")
def recording(scenario):
    return record(scenario, seed=1, steps=STEPS)


@pytest.fixture(scope="module")
def folder(recording, tmp_path_factory):
    return mrclam.save(tmp_path_factory.mktemp("export") / "set", mrclam_files(recording), compress=True)


def test_a_recording_of_the_simulator(scenario, recording):
    assert recording.name == "mrclam" and recording.complete
    assert len(recording.command_times) == STEPS + 1
    assert len(recording.sweep_times) == STEPS // scenario.sensor_period
    np.testing.assert_allclose(recording.truth.times, scenario.dt * np.arange(STEPS + 1), atol=1e-9)
    assert recording.labels.max() < 15 and (recording.labels == TARGET).any()
    first = slice(*recording.sweep_first[:2])
    pose, when = recording.truth, recording.sweep_times[0]
    offset = recording.landmarks[recording.labels[first]] - pose.at([when])[:, :2]
    near = recording.labels[first] >= 0
    assert np.abs(np.hypot(*offset.T) - recording.ranges[first])[near].max() < 1.0


def test_the_same_seed_gives_the_same_recording(scenario, recording):
    again = log_format.tables_of(record(scenario, seed=1, steps=STEPS))
    for table, rows in log_format.tables_of(recording).items():
        np.testing.assert_array_equal(again[table], rows)


def test_the_exported_set_reads_back(recording, folder):
    again = mrclam.load(folder, 1, 2)
    assert mrclam.robots(folder) == [1, 2]
    assert again.labels.tolist() == [n + 6 if n >= 0 else n for n in recording.labels.tolist()]
    np.testing.assert_allclose(again.ranges, recording.ranges, atol=1e-6)
    np.testing.assert_allclose(again.truth.poses[:, :2], recording.truth.poses[:, :2], atol=1e-7)
    np.testing.assert_allclose(again.target.poses[:, :2], recording.target.poses[:, :2], atol=1e-7)
    np.testing.assert_allclose(again.command_times, recording.command_times, atol=1.1e-3)
    assert not again.warnings
    other_way = mrclam.load(folder, 2, 1)
    assert len(other_way.ranges) == 0
    assert np.abs(other_way.commands[:, 0]).max() < 0.15


def test_replaying_an_exported_set(folder):
    found = replay(
        mrclam.load(folder, 1, 2), ["dead-reckoning", "ekf", "ri-ekf"], mrclam_models(), inflations=(1.0, 16.0)
    )
    summary = found.summary.set_index("estimator")
    assert summary.loc["ri-ekf (R x16)", "robot_error_rmse"] < 0.3
    assert summary.loc["ri-ekf (R x16)", "target_error_lt2"] < 0.4
    assert summary.loc["ri-ekf (R x16)", "pose_nees_mean"] < summary.loc["ri-ekf", "pose_nees_mean"]
    assert not summary["diverged"].any()


def test_the_odometry_calibration_matters(folder):
    recording = mrclam.load(folder, 1, 2)
    errors = [
        replay(recording, ["dead-reckoning"], mrclam_models(calibration)).summary["robot_error_rmse"].iloc[0]
        for calibration in ((0.935, 0.948, -0.0023), (1.0, 1.0, 0.02))
    ]
    assert errors[0] < errors[1]


def test_an_exported_log_replays_with_its_scenario(tmp_path):
    scenario = Scenario.load("open")
    log = log_format.load(log_format.save(tmp_path / "log.npz", record(scenario, steps=200)))
    models = scenario_models(scenario, log)
    assert models.command_delay == 0.0 and models.target is not None
    row = replay(log, ["ekf"], models).summary.iloc[0]
    assert row["robot_error_rmse"] < 0.2
    assert row["pose_nees_mean"] < 12.0


def test_what_cannot_be_exported(recording, scenario):
    with pytest.raises(ValueError, match="steps must be at least 1; got 0"):
        record(scenario, steps=0)
    fields = {name: getattr(recording, name) for name in Recording.__slots__}
    with pytest.raises(ValueError, match="no return here has a label; use `export log`"):
        mrclam_files(Recording(**fields | {"labels": np.full_like(recording.labels, UNKNOWN)}))
    with pytest.raises(ValueError, match="holds the true path"):
        mrclam_files(Recording(**fields | {"truth": None}))


def test_the_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["export", "mrclam", "set", "--steps", "200", "--seed", "3"]) == 0
    assert "set: 9.5 s, 40 sweeps" in capsys.readouterr().out
    words = ["replay", "mrclam", "set", "--robot", "1", "--target", "2", "--estimators", "ekf", "--out", "found"]
    assert main([*words, "--odometry-calibration", "none"]) == 0
    assert (tmp_path / "found" / "report.html").is_file()
    assert main(["export", "mrclam", "set", "--steps", "200"]) == 2
    assert "nothing is overwritten" in capsys.readouterr().err
    assert main(["export", "log", "log.npz", "--scenario", "open", "--steps", "50"]) == 0
    assert (tmp_path / "log.npz").is_file()
    assert main(["export", "log", "x", "--scenario", "opne"]) == 2
    assert "Did you mean 'open'" in capsys.readouterr().err
