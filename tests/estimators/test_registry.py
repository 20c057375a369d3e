"""Names to classes: ours, registered ones, those of installed packages; errors that help."""

from importlib.metadata import EntryPoint

import pytest

import estimators
from estimators import registry
from estimators._recording import MOTION, SENSOR
from estimators.single_lane import LaneBelief, SingleLaneEstimator


class Theirs(SingleLaneEstimator):
    def __init__(self, *args, gain=1.0, **kwargs):
        super().__init__(*args, **kwargs)
        self.gain = gain

    def reset_one(self, models, pose, pose_cov, seed, target, target_cov):
        return pose, pose_cov

    def predict_one(self, state, models, control, dt):
        return state

    def update_one(self, state, models, returns):
        return state

    def describe_one(self, state, models):
        return LaneBelief(*state)


class Others(Theirs):
    pass


@pytest.fixture(autouse=True)
def clean(monkeypatch):
    monkeypatch.setattr(registry, "_registered", {})


def test_ours_come_first():
    ours = list(registry._BUILT_IN)
    assert {"dead-reckoning", "ekf", "slamto", "independent"} <= set(ours)
    assert estimators.names()[: len(ours)] == ours


def test_an_unknown_name_gets_the_nearest_and_the_choices():
    with pytest.raises(
        ValueError, match=r"unknown estimator 'fej-efk'. Did you mean 'fej-ekf'\? Choices: dead-reckoning"
    ):
        estimators.get("fej-efk")
    with pytest.raises(ValueError, match=r"unknown estimator 'zzz'. Choices"):
        estimators.get("zzz")


def test_register_and_make():
    estimators.register("theirs", Theirs)
    assert estimators.get("theirs") is Theirs
    assert "theirs" in estimators.names()
    made = estimators.make("theirs", MOTION, SENSOR, None, num_lanes=2, max_landmarks=3, gain=0.5)
    assert (made.num_lanes, made.max_landmarks, made.gain) == (2, 3, 0.5)


def test_register_decorates():
    assert estimators.register("theirs")(Theirs) is Theirs
    estimators.register("theirs", Theirs)  # the same class again: a module run twice


@pytest.mark.parametrize("name", ["ekf", "theirs"])
def test_a_taken_name_is_refused(name):
    estimators.register("theirs", Theirs)
    with pytest.raises(ValueError, match=f"named '{name}' exists already; choose another name"):
        estimators.register(name, Others)


def test_entry_points_of_installed_packages_are_found(monkeypatch):
    point = EntryPoint("installed", f"{__name__}:Theirs", registry.ENTRY_POINT_GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda group: [point] if group == registry.ENTRY_POINT_GROUP else [])
    monkeypatch.setattr(EntryPoint, "load", lambda self: Theirs)
    assert estimators.names()[-1] == "installed"
    assert estimators.get("installed") is Theirs


def test_an_unknown_option_is_a_value_error():
    estimators.register("theirs", Theirs)
    with pytest.raises(ValueError, match=r"estimator 'theirs': .*'gian'.*slam-gym list theirs"):
        estimators.make("theirs", MOTION, SENSOR, None, max_landmarks=3, gian=2.0)


def test_a_type_error_inside_the_constructor_is_not_hidden():
    class Faulty(Theirs):
        def __init__(self, *args, **kwargs):
            super().__init__(*args, **kwargs)
            len(3)

    estimators.register("faulty", Faulty)
    with pytest.raises(TypeError, match="len"):
        estimators.make("faulty", MOTION, SENSOR, None, max_landmarks=3)
