import pytest

from estimators import registry
from estimators.gaussian import ekf
from slam_gym.evaluation import compare
from slam_gym.exercise import exercise
from slam_gym.scenario import Scenario
from slam_gym.specs import Spec


def compiled():
    return {name: len(kernel.overloads) for name, kernel in vars(ekf).items() if hasattr(kernel, "overloads")}


@pytest.mark.parametrize("scenario", ["default", "slamto"])
def test_after_an_exercise_a_comparison_compiles_nothing_more_of_the_filter(scenario):
    exercise(Scenario.load(scenario), Spec.parse("ekf"))
    before = compiled()
    assert before["predict"] > 0
    compare(scenario, ["ekf"], runs=1, steps=30, jobs=1)
    assert compiled() == before


@pytest.mark.parametrize("changes", [{"target.kind": "none"}, {"landmarks.count": 0}, {"landmarks.labelled": False}])
def test_worlds_without_target_landmarks_or_labels_are_exercised_too(changes):
    scenario = Scenario.load("open", **changes)
    for name in ("ekf", "dead-reckoning", "ideal-ekf", "fastslam2"):
        assert name in registry.names()
        exercise(scenario, Spec.parse(name))
