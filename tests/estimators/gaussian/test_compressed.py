"""The compressed filter is the full one: whatever is seen, forgotten, lost and read, and however little is active."""

import pickle

import numpy as np
import pytest

from estimators import registry
from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL
from estimators.gaussian.postponed import PAST, past_slots
from estimators.gaussian.shrinking import has_shrunk
from estimators.interface import TARGET, UNKNOWN, Belief, Scan
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.testing import checks

TWIST = TargetModel(kind="twist", speed=0.3, turn_rate=0.1, speed_std=0.1, turn_std=0.1)
VAGUE = TargetModel(acceleration_density=3.0, initial_speed_std=1.0)
LANDMARKS, LANES = 60, 3


@pytest.mark.parametrize("check", checks("compressed-ekf", active=4), ids=str)
def test_contract(check):
    check()


class Drive:
    """Robots on a circle that pass by different landmarks, see all once in a while; a target that comes and goes."""

    def __init__(self, steps, seed=0, reach=2.5):
        self.rng = rng = np.random.default_rng(seed)
        self.points = rng.uniform(-6.0, 6.0, (LANDMARKS, 2))
        around = np.arange(LANES) * 2.0
        pose = np.column_stack([3.0 * np.sin(around), -3.0 * np.cos(around), around])
        self.start = pose.copy()
        self.steps = []
        for step in range(steps):
            control = np.tile([1.2, 0.4], (LANES, 1))  # a circle of 3 m
            pose[:, 2] += DT * control[:, 1]
            pose[:, :2] += DT * control[:, :1] * np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])])
            turn = 0.05 * step + around
            target = 1.5 * np.column_stack([np.cos(turn), np.sin(turn)])
            self.steps.append((control, self._sweep(pose, target, step, reach)))

    def _sweep(self, pose, target, step, reach):
        scan = Scan.empty(LANES, LANDMARKS + 2)
        for lane in range(LANES):
            offsets = self.points - pose[lane, :2]
            seen = [(j, d) for j, d in enumerate(offsets) if np.hypot(*d) < (20.0 if step % 97 == 60 else reach)]
            if (step // 40 + lane) % 3:
                seen.append((TARGET, target[lane] - pose[lane, :2]))
            self.rng.shuffle(seen)
            for k, (label, offset) in enumerate(seen):
                std = SENSOR.range_std, SENSOR.bearing_std
                scan.ranges[lane, k] = np.hypot(*offset) + std[0] * self.rng.standard_normal()
                bearing = np.arctan2(offset[1], offset[0]) - pose[lane, 2] + std[1] * self.rng.standard_normal()
                scan.bearings[lane, k] = (bearing + np.pi) % (2 * np.pi) - np.pi
                scan.labels[lane, k] = label if self.rng.uniform() < 0.97 else UNKNOWN
            scan.count[lane] = len(seen)
        return scan


@pytest.fixture(scope="module")
def drive():
    return Drive(300)


def make(name, target=TARGET_MODEL, sensor=SENSOR, **options):
    return registry.make(name, MOTION, sensor, target, num_lanes=LANES, **{"max_landmarks": LANDMARKS, **options})


def begin(estimator, drive, **prior):
    estimator.reset(drive.start, 0.01 * np.eye(3), seeds=0, **prior)


def need_equal(one, other, tolerance=1e-10):
    for name in (*Belief._CORE, *Belief._MAP):
        np.testing.assert_allclose(
            getattr(one.belief, name), getattr(other.belief, name), rtol=0.0, atol=tolerance, err_msg=name
        )
    for name, values in one.counts.items():
        np.testing.assert_array_equal(values, other.counts[name], err_msg=name)


OPTIONS = {
    "constant-velocity": {},
    "no target": {"target": None},
    "twist": {"target": TWIST, "first_heading": "two-sightings"},
    "vague target": {"target": VAGUE},
    "gate": {"gate": 6.0},
    "range grows": {"sensor": SensorModel(max_range=6.0, range_std=0.02, range_std_per_range=0.02, bearing_std=0.05)},
    "full map": {"max_landmarks": 40},
    "budget": {"budget": 25},
}


@pytest.mark.parametrize("active", [1, 12, 20, 100])
@pytest.mark.parametrize("kind", OPTIONS)
def test_it_is_the_full_filter(kind, active, drive):
    options = OPTIONS[kind]
    full, compressed = make("ekf", **options), make("compressed-ekf", active=active, **options)
    for estimator in (full, compressed):
        begin(estimator, drive)
    for i, (control, scan) in enumerate(drive.steps):
        for estimator in (full, compressed):
            estimator.predict(control, DT)
            estimator.update(scan)
        if i % 10 == 0 or i > 290:
            need_equal(full, compressed)
    for lane in range(LANES):
        for ours, theirs in zip(compressed.joint(lane), full.joint(lane), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-10)


def test_a_waiting_landmark_whose_variance_collapses_keeps_its_digits():
    """B is mapped by a robot that is lost by 100 m; one sharp look at A, fourteen decades better, tells where both are.

    While B waits it is P_bb(0) + C cov(z, z) C', a difference that fourteen decades leave nothing of.
    """
    motion, sensor = MotionModel(speed_std=1e3, turn_std=1e-5), SensorModel(range_std=1e-5, bearing_std=1e-5)
    a, b, c = [(2.0, 0.5, 0)], [(3.0, -0.5, 1)], [(1.0, 0.0, 2)]
    known = {}
    for name, options in {"ekf": {}, "compressed-ekf": {"active": 1}}.items():
        estimator = registry.make(name, motion, sensor, None, max_landmarks=3, **options)
        estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=0)
        for returns, speed in ((a, 0.0), (b, 1.0), (c, 0.0), (a, 0.0)):  # there is room for two
            scan = Scan.empty(1, 1)
            scan.ranges[0], scan.bearings[0], scan.labels[0] = np.array(returns).T
            scan.count[0] = 1
            if speed:
                estimator.predict(np.array([[speed, 0.0]]), DT)
            estimator.update(scan)
        known[name] = estimator.belief.landmark_cov[0, :2].copy()
    assert known["ekf"][1].max() < 1e-6 * 100.0**2
    np.testing.assert_allclose(known["compressed-ekf"], known["ekf"], rtol=1e-6, atol=0.0)
    assert np.linalg.eigvalsh(known["compressed-ekf"]).min() > 0.0


def test_the_whole_is_brought_up_to_date_once_a_variance_has_shrunk_by_six_decades():
    """Of the robot, or of a landmark that has waited; not of one without a past, nor of a target that was forgotten."""
    n_t, count = 4, past_slots(4) + 3
    ids, whole = np.array([[PAST] * past_slots(4) + [5, PAST, 7]]), np.zeros((1, count), dtype=np.int64)
    whole[0, past_slots(4)], whole[0, -1] = 1, 0
    P, waited, new = np.eye(12)[None].copy(), 3 + n_t + 2 * past_slots(4), 3 + n_t + 2 * (count - 1)

    def shrunk(row, variance):
        a_P = np.eye(3 + n_t + 2 * count)[None].copy()
        a_P[0, row, row] = variance
        return has_shrunk(0, P, a_P, n_t, np.array([count]), ids, whole)

    assert [shrunk(row, 0.9e-6) for row in (1, waited, new)] == [True, True, False]
    assert [shrunk(row, 1.1e-6) for row in (1, waited, new)] == [False, False, False]
    assert not shrunk(4, 0.0)


def test_a_prior_of_the_target_and_lanes_that_go_by_themselves(drive):
    full, compressed = make("ekf"), make("compressed-ekf", active=20)
    rng = np.random.default_rng(1)
    prior = {"target": np.ones((LANES, 4)), "target_cov": 0.1 * np.eye(4)}
    for estimator in (full, compressed):
        begin(estimator, drive, **prior)
    for i, (control, scan) in enumerate(drive.steps[:150]):
        lanes = np.flatnonzero(rng.uniform(size=LANES) < 0.7)
        for estimator in (full, compressed):
            estimator.predict(control, DT, lanes=lanes)
            estimator.update(scan, lanes=lanes)
            if i == 80:
                estimator.reset(drive.start[1:2], np.zeros((3, 3)), seeds=0, lanes=np.array([1]))
    need_equal(full, compressed)


def test_states_and_pickles_go_on_bit_for_bit_and_reading_changes_nothing(drive):
    first, second = make("compressed-ekf", active=12), make("compressed-ekf", active=12)
    begin(first, drive)
    for control, scan in drive.steps[:120]:
        first.predict(control, DT)
        first.update(scan)
    second.set_state(first.get_state())
    third = pickle.loads(pickle.dumps(first))
    for control, scan in drive.steps[120:180]:
        for estimator in (first, second, third):
            estimator.predict(control, DT)
            estimator.update(scan)
        first.belief.refresh()
        first.joint(0)
    for other in (second, third):
        need_equal(first, other, 0.0)
        np.testing.assert_array_equal(first.joint(1)[1], other.joint(1)[1])


def test_bound_calls_are_the_methods(drive):
    one, other = make("compressed-ekf", active=12), make("compressed-ekf", active=12)
    scan, control, dt = Scan.empty(LANES, LANDMARKS + 2), np.zeros((LANES, 2)), np.full(LANES, DT)
    calls = other.bound_calls(control, dt, scan)
    for estimator in (one, other):
        begin(estimator, drive)
        estimator.belief.refresh()  # from here on the calls see to it
    for moved, sweep in drive.steps[:60]:
        control[:] = moved
        for name in ("ranges", "bearings", "labels", "count"):
            getattr(scan, name)[:] = getattr(sweep, name)
        one.predict(moved, DT)
        one.update(sweep)
        calls.predict(other.all_lanes)
        calls.update(other.all_lanes)
        calls.fill(other.all_lanes)
        need_equal(one, other, 0.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"active": 0}, "active must be a whole number of landmarks"),
        ({"active": 2.5}, "active must be a whole number"),
        ({"association": "nearest"}, 'association="known"'),
        ({"target": TargetModel(kind="imm")}, "imm"),
    ],
)
def test_what_it_cannot_do_it_refuses(options, message):
    with pytest.raises(ValueError, match=message):
        make("compressed-ekf", **options)
