"""Wrong calls across the packages, and what each one says: what was expected, what came, what to do."""

import errno

import numpy as np
import pytest

import estimators
from estimators import registry
from estimators.models import MotionModel, SensorModel, TargetModel
from slam_gym import policies
from slam_gym.consistency import nees_bounds
from slam_gym.evaluation import compare, merge
from slam_gym.results import Results, write_json
from slam_gym.scenario import Scenario
from slam_gym.specs import parse_options, parse_settings

MODELS = (MotionModel(), SensorModel(), TargetModel())


def make(name, **options):
    return registry.make(name, *MODELS, max_landmarks=5, **options)


def reset(**changes):
    arguments = {"pose": np.zeros(3), "pose_cov": np.zeros((3, 3)), "seeds": [0], **changes}
    make("dead-reckoning").reset(arguments.pop("pose"), arguments.pop("pose_cov"), **arguments)


def load(**overrides):
    return Scenario.load("default", **overrides)


def policy(name, **options):
    return policies.make(name, policies.PolicyContext.from_scenario(load()), 1, **options)


WRONG = {  # the message, its parts split by |
    # estimators
    "estimator misspelt": (lambda: make("ri-efk"), "unknown estimator 'ri-efk'. Did you mean 'ri-ekf'? Choices: "),
    "estimator option": (lambda: make("ekf", gates=3), "estimator 'ekf': unknown option 'gates'. Did you mean 'gate'?"),
    "text for an option's number": (
        lambda: make("slamto", particles="five"),
        "estimator 'slamto': particles must be a whole number, such as 200; got 'five'",
    ),
    "estimators with a comma": (
        lambda: make("ekf,ri-ekf"),
        "Several names are written with spaces between them: ekf ri-ekf",
    ),
    "estimator of one's own": (lambda: make("zzz"), "declares it (entry points |slam_gym.estimators"),
    "folder that is not there": (lambda: policy("zzz"), "Nor is there a folder 'zzz' here"),
    "no lanes": (lambda: make("dead-reckoning", num_lanes=0), "num_lanes must be at least 1; got 0"),
    "no capacity": (
        lambda: registry.make("ekf", *MODELS, max_landmarks=0),
        "max_landmarks must be at least 1; got 0",
    ),
    "shape of a pose": (lambda: reset(pose=np.zeros(2)), "pose must have shape [1, 3] or [3]; got [2]"),
    "pose not finite": (lambda: reset(pose=[0.0, np.nan, 0.0]), "pose must be finite; got NaN or infinity"),
    "lane that is not there": (
        lambda: reset(lanes=np.array([1])),
        "lanes must be distinct indices below 1; got [1]",
    ),
    "half a target prior": (lambda: reset(target=np.zeros(4)), "target and target_cov go together"),
    "negative noise": (
        lambda: MotionModel(speed_std=-0.1),
        "MotionModel.speed_std must be a number that is zero or more; got -0.1",
    ),
    "noise not a number": (
        lambda: SensorModel(range_std=np.nan),
        "SensorModel.range_std must be a number that is positive; got nan",
    ),
    "model's kind": (
        lambda: TargetModel(kind="rocket"),
        "TargetModel.kind must be one of 'twist', 'constant-velocity', 'imm'; got 'rocket'",
    ),
    "name taken": (lambda: registry.register("ekf", estimators.Estimator), "an estimator named 'ekf' exists already"),
    # scenarios
    "an estimator in a scenario's place": (
        lambda: Scenario.load("slamto:particles=5"),
        "unknown scenario 'slamto:particles=5'|is an estimator: --estimators slamto:particles=5",
    ),
    "scenario misspelt": (
        lambda: Scenario.load("defualt"),
        "unknown scenario 'defualt'. Did you mean 'default'?|path of a .toml file",
    ),
    "scenario's key misspelt": (
        lambda: load(**{"sensor.maxrange": 3}),
        "unknown scenario key 'sensor.maxrange'. Did you mean 'sensor.max_range'?",
    ),
    "scenario's section misspelt": (
        lambda: load(**{"senser.max_range": 3}),
        "unknown scenario section 'senser'. Did you mean 'sensor'?",
    ),
    "impossible number": (
        lambda: load(**{"sensor.detection_probability": 1.5}),
        "sensor.detection_probability must be |; got 1.5",
    ),
    "text for a number": (
        lambda: load(**{"robot.speed_max": "fast"}),
        "robot.speed_max must be a number or a range [low, high]; got 'fast'",
    ),
    "range upside down": (
        lambda: load(**{"target.speed": [2, 1]}),
        "target.speed: the range's low end must come first; got [2, 1]",
    ),
    "a word that is no choice": (
        lambda: load(**{"landmarks.layout": "rings"}),
        "unknown value of landmarks.layout 'rings'. Did you mean 'ring'?",
    ),
    # policies
    "policy misspelt": (lambda: policy("persuit"), "unknown policy 'persuit'. Did you mean 'pursuit'?"),
    "policy's option misspelt": (
        lambda: policy("pursuit", standoff=2),
        "policy 'pursuit': unknown option 'standoff'. Did you mean 'stand_off'?",
    ),
    # comparing
    "no runs": (lambda: compare(runs=0), "runs must be at least 1; got 0"),
    "no jobs": (lambda: compare(jobs=0), "jobs must be at least 1; got 0"),
    "shard": (lambda: compare(shard=(3, 2)), "shard i/n needs 1 <= i <= n; got 3/2"),
    "mode": (lambda: compare(mode="open"), "mode must be 'shared' or 'closed-loop'; got 'open'"),
    "no estimator": (lambda: compare(estimators=[]), "name at least one estimator"),
    "estimator twice": (lambda: compare(estimators=["ekf", "ekf"]), "estimator 'ekf' is named twice"),
    "driver": (
        lambda: compare(estimators=["ekf"], driver="ri-ekf"),
        "unknown driver | 'ri-ekf'|Choices: ekf",
    ),
    "estimator's option in a comparison": (lambda: compare(estimators=["ekf:gates=3"]), "estimator 'ekf': |gates"),
    "everything unscored": (
        lambda: compare(estimators=["ekf"], steps=10, burn_in=10),
        "burn_in must be less than the 10 steps of a run",
    ),
    "no steps": (lambda: compare(steps=0), "steps must be at least 1; got 0"),
    "nothing to merge": (lambda: merge([], "out"), "name at least one folder to merge"),
    # what people type
    "setting without a value": (lambda: parse_settings(["sensor.max_range"]), "a setting is written key=value|got"),
    "options not JSON": (lambda: parse_options("{ekf: 1}"), "options are a JSON object like"),
    "options not by name": (lambda: parse_options('{"ekf": 1}'), "options are a JSON object of objects"),
    "options for a stranger": (
        lambda: parse_options('{"ekv": {}}', ["ekf"]),
        "unknown estimator 'ekv'. Did you mean 'ekf'?",
    ),
    # statistics
    "bounds of nothing": (lambda: nees_bounds(0), "nees_bounds needs dof >= 1, runs >= 1, 0 < probability < 1; got 0"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_value_is_a_valueerror_that_says_so(case):
    call, message = WRONG[case]
    with pytest.raises(ValueError) as caught:
        call()
    assert [piece for piece in message.split("|") if piece not in str(caught.value)] == []


def test_a_wrong_call_leaves_no_folder_in_the_way_of_the_next(tmp_path):
    with pytest.raises(ValueError, match="jobs must be at least 1"):
        compare(estimators=["ekf"], jobs=0, out=tmp_path / "here")
    assert not (tmp_path / "here").exists()


FILES = {
    "no results": (lambda tmp: Results.load(tmp / "none"), FileNotFoundError, "no results folder"),
    "unfinished results": (lambda tmp: Results.load(tmp), FileNotFoundError, "holds no finished results"),
    "no parts": (lambda tmp: merge([tmp], tmp / "out"), FileNotFoundError, "holds no parts of a comparison"),
    "no scenario file": (lambda tmp: Scenario.load(tmp / "a.toml"), FileNotFoundError, "no scenario file"),
    "no map file": (
        lambda tmp: load(**{"landmarks.layout": "file", "landmarks.file": str(tmp / "map.csv")}).max_landmarks,
        FileNotFoundError,
        "no file '|map.csv'",
    ),
    "results in a file's place": (
        lambda tmp: write_json(tmp / "file" / "x.json", {}),
        OSError,
        "cannot write '|x.json'",
    ),
    "results that exist": (
        lambda tmp: compare(estimators=["ekf"], out=tmp),
        FileExistsError,
        "is not empty, and results are never overwritten",
    ),
}


@pytest.mark.parametrize("case", FILES)
def test_a_wrong_file_is_an_oserror_that_says_so(case, tmp_path):
    (tmp_path / "file").write_text("something")
    call, kind, message = FILES[case]
    with pytest.raises(kind) as caught:
        call(tmp_path)
    assert [piece for piece in message.split("|") if piece not in str(caught.value)] == []


def test_a_scenario_file_that_is_not_toml(tmp_path):
    (tmp_path / "bad.toml").write_text("dt = = 3")
    with pytest.raises(ValueError, match=r"bad\.toml' is not a TOML file"):
        Scenario.load(tmp_path / "bad.toml")


def test_a_full_disk_stops_a_comparison_with_one_message_and_keeps_what_is_done(tmp_path, monkeypatch):
    import slam_gym.evaluation_unit as unit

    real, written = np.savez, []

    def fill_up(file, **arrays):
        if written:
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(file)
        real(file, **arrays)

    monkeypatch.setattr(unit.np, "savez", fill_up)
    call = {"runs": 3, "steps": 3, "jobs": 1, "chunk": 1}
    with pytest.raises(OSError, match=r"cannot write .*No space left on device. What was written before is kept"):
        compare("default", ["dead-reckoning"], out=tmp_path / "out", **call)
    parts = tmp_path / "out" / "parts" / "000"
    assert [path.name for path in parts.iterdir()] == ["000000.npz"]
    monkeypatch.undo()
    assert len(compare("default", ["dead-reckoning"], out=tmp_path / "out", resume=True, **call).runs) == 3
