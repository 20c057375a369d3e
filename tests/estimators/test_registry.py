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


@pytest.mark.parametrize(("name", "options", "message"), [
    ("slamto", {"particels": 5}, r"'slamto': unknown option 'particels'. Did you mean 'particles'\? Choices: "),
    ("slamto", {"particles": "many"}, "'slamto': particles must be a whole number, such as 200; got 'many'"),
    ("slamto", {"particles": 4.5}, "particles must be a whole number"),
    ("ri-ekf", {"gaet": 9.0}, r"Did you mean 'gate'\?"),  # an option of its base class
    ("ri-ekf", {"gate": "wide"}, "gate must be a number, such as .*; got 'wide'"),
    ("theirs", {"gian": 2.0}, r"estimator 'theirs': unknown option 'gian'. Did you mean 'gain'\? Choices: gain"),
    ("theirs", {"gain": True}, "gain must be a number, such as 1.0; got True"),
])  # fmt: skip
def test_an_option_that_is_mistyped_is_named(name, options, message):
    estimators.register("theirs", Theirs)
    with pytest.raises(ValueError, match=message):
        estimators.make(name, MOTION, SENSOR, None, max_landmarks=3, **options)


def test_options_that_only_the_class_itself_knows_reach_it():
    class Loose(Theirs):
        def __init__(self, *args, **anything):
            self.colour = anything.pop("colour")
            super().__init__(*args, **anything)

    estimators.register("loose", Loose)
    made = estimators.make("loose", MOTION, SENSOR, None, max_landmarks=3, colour="red", gain=2)
    assert (made.colour, made.gain) == ("red", 2)


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


def test_a_plug_in_that_cannot_be_loaded_is_named(monkeypatch):
    point = EntryPoint("broken", "no_such_package.filters:Broken", registry.ENTRY_POINT_GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda group: [point])
    with pytest.raises(
        ImportError, match=r"estimator 'broken' cannot be loaded from 'no_such_package.filters:Broken': No"
    ):
        estimators.get("broken")


def test_a_type_error_inside_the_constructor_is_not_hidden():
    class Faulty(Theirs):
        def __init__(self, *args, **kwargs):
            super().__init__(*args, **kwargs)
            len(3)

    estimators.register("faulty", Faulty)
    with pytest.raises(TypeError, match="len"):
        estimators.make("faulty", MOTION, SENSOR, None, max_landmarks=3)
