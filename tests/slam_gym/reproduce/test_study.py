import numpy as np
import pytest

from slam_gym.reproduce import study as module
from slam_gym.reproduce.study import Study
from slam_gym.scenario import Scenario

SCENARIO = Scenario.load("slamto", max_steps=24)


def measure(study, **changes):
    arguments = {"runs": 3, "fields": ("robot_error", "pose_nees"), "tracks": 1, **changes}
    return study.measure("part one", SCENARIO, ["ekf", "slamto:particles=20"], **arguments)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return Study(tmp_path_factory.mktemp("study"), quick=True, jobs=1)


@pytest.fixture(scope="module")
def sample(study):
    return measure(study)


def test_a_sample_holds_every_run_and_step(sample):
    assert sample.labels == ["ekf", "slamto:particles=20"]
    assert sample.values["ekf"]["robot_error"].shape == (3, 24)
    assert sample.events["slamto:particles=20"]["resampled"].shape == (3,)
    assert sample.microseconds("ekf") > 0.0
    errors = sample.values["ekf"]["robot_error"]
    np.testing.assert_allclose(sample.of_runs("ekf", "robot_error"), errors[:, 1:].mean(axis=1))
    np.testing.assert_allclose(sample.over_time("ekf", "robot_error"), errors.mean(axis=0))
    tracks, landmarks = sample.drawn(["ekf"])
    assert (len(tracks), len(landmarks)) == (24, 20)


def test_what_was_measured_is_found_again(study, sample, monkeypatch):
    def forbidden(*_, **__):
        raise AssertionError("measured twice")

    monkeypatch.setattr(module, "compare", forbidden)
    again = measure(study)
    for label, values in sample.values.items():
        for name, array in values.items():
            np.testing.assert_array_equal(again.values[label][name], array)
    np.testing.assert_array_equal(again.tracks["ekf"], sample.tracks["ekf"])
    with pytest.raises(AssertionError, match="measured twice"):
        measure(study, seed=1)  # another measurement


def test_a_killed_measurement_goes_on_with_the_same_numbers(sample, tmp_path, monkeypatch):
    study = Study(tmp_path, jobs=1)
    whole = module.compare

    def killed(*arguments, **options):
        whole(*arguments, **{**options, "runs": 2})
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(module, "compare", killed)
        with pytest.raises(KeyboardInterrupt):
            measure(study)
    seen = []
    found = measure(Study(tmp_path, jobs=1, progress=lambda what, done, total: seen.append((done, total))))
    assert seen[0] == (2, 3)
    np.testing.assert_array_equal(found.values["ekf"]["pose_nees"], sample.values["ekf"]["pose_nees"])
    assert not list((tmp_path / "work").glob("*/"))


def test_sizes():
    assert Study(None).size(400, 20) == 400
    assert Study(None, quick=True).size(400, 20) == 20
    assert Study(None, quick=True, most_runs=3).size(400, 20) == 3
