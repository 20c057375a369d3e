import builtins
import math

import numpy as np
import pytest

pytest.importorskip("gtsam", reason="the extra `smoothing` is not installed")

from dataclasses import replace

from estimators import registry
from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.gaussian.ekf import EKF
from estimators.interface import TARGET, UNKNOWN, Scan
from estimators.models import MotionModel, TargetModel
from estimators.smoothing.events import Motion, Prior, Sighting, Sweep
from estimators.smoothing.graph import Graph
from estimators.smoothing.isam2 import ISAM2
from estimators.smoothing.odometry import carry, turned
from estimators.testing import checks

SMALL = 1e-3
TWIST = TargetModel(kind="twist", speed=0.3, turn_rate=0.1, speed_std=SMALL, turn_std=SMALL)


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@pytest.mark.parametrize("check", checks("isam2"), ids=str)
def test_contract(check):
    check()


def test_the_whole_batch_problem(batch_problem):
    """Mean and covariance of robot, target and map are those of all residuals minimised at once."""
    recording, cov = record(1, 10), np.diag([0.1, 0.1, 0.05]) ** 2
    estimator = ISAM2(MOTION, SENSOR, TARGET_MODEL, max_landmarks=8, relinearize_threshold=1e-6, iterations=2)
    start(estimator, recording, pose_cov=cov)
    feed(estimator, recording)
    mean, P = estimator.joint(0)
    order = np.argsort(estimator.ids[0, : estimator.count[0]])
    rows = np.r_[:7, (7 + 2 * order[:, None] + [0, 1]).ravel()]
    problem = batch_problem(recording, 0, 10, MOTION, SENSOR, TARGET_MODEL, np.sqrt(np.diag(cov)), DT)
    expected, expected_cov = problem.solve()
    std = np.sqrt(np.diag(expected_cov))
    gap = mean[rows] - expected
    gap[2] = wrap(gap[2])
    np.testing.assert_allclose(gap / std, 0.0, atol=0.002)
    scale = np.outer(std, std)
    np.testing.assert_allclose(P[np.ix_(rows, rows)] / scale, expected_cov / scale, atol=0.005)


def nearly_linear(twist):
    """The recording with all noise but the target's a hundredth: whatever is linearised anew changes nothing."""
    motion = MotionModel(speed_std=SMALL, turn_std=SMALL)
    sensor = replace(SENSOR, range_std=SMALL, bearing_std=SMALL)
    recording, rng = record(2, 20), np.random.default_rng(4)
    before, place, heading = recording.start, recording.target_start[:, :2], np.zeros(2)
    for step in recording.steps:
        way = np.linalg.norm(step.pose[:, :2] - before[:, :2], axis=1)
        rates = np.column_stack([way, wrap(step.pose[:, 2] - before[:, 2])]) / DT
        step.control[:] = rates + SMALL * rng.standard_normal((2, 2))
        before, scan = step.pose, step.scan
        target = step.target
        if twist:
            heading += DT * (TWIST.turn_rate + SMALL * rng.standard_normal(2))
            way = DT * (TWIST.speed + SMALL * rng.standard_normal(2))
            target = place = place + way[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        for lane in range(2):
            n = scan.count[lane]
            points = np.vstack([recording.landmarks[lane], target[lane, :2]])
            which = np.where(scan.labels[lane, :n] == TARGET, -1, scan.labels[lane, :n])
            gap = points[which] - step.pose[lane, :2]
            bearing = np.arctan2(gap[:, 1], gap[:, 0]) - step.pose[lane, 2]
            scan.ranges[lane, :n] = np.hypot(*gap.T) + SMALL * rng.standard_normal(n)
            scan.bearings[lane, :n] = wrap(bearing + SMALL * rng.standard_normal(n))
    return motion, sensor, recording


@pytest.mark.parametrize("target", [TARGET_MODEL, TWIST, None], ids=["constant-velocity", "twist", "alone"])
def test_agrees_with_the_ekf_where_all_is_nearly_linear(target):
    motion, sensor, recording = nearly_linear(target is TWIST)
    given, state = {}, recording.target_start
    if target is not None:
        if target is TWIST:
            state = np.column_stack([state[:, :2], [0.0, 0.0]])
        given = {"target": state, "target_cov": SMALL**2 * np.eye(state.shape[1])}
    pair = []
    for cls in (EKF, ISAM2):
        estimator = cls(motion, sensor, target, num_lanes=2, max_landmarks=8)
        estimator.reset(recording.start, SMALL**2 * np.eye(3), seeds=[0, 1], **given)
        feed(estimator, recording)
        pair.append(estimator)
    for lane in range(2):
        mean, cov = pair[0].joint(lane)
        other, other_cov = pair[1].joint(lane)
        std = np.sqrt(np.diag(cov))
        gap = other - mean
        gap[2] = wrap(gap[2])
        np.testing.assert_allclose(gap / std, 0.0, atol=0.1)
        np.testing.assert_allclose(other_cov / np.outer(std, std), cov / np.outer(std, std), atol=0.05)


@pytest.mark.parametrize("model", [TARGET_MODEL, TWIST], ids=["constant-velocity", "twist"])
def test_prediction_carries_the_covariance_as_the_ekf_does(model):
    """Between two sweeps nothing enters the graph: mean and covariance move as the EKF's."""
    recording = record(2, 4)
    n_t = len(model.coordinates)
    root = 0.1 * np.random.default_rng(0).standard_normal((3, 3)) + 0.2 * np.eye(3)
    beliefs = []
    for cls in (EKF, ISAM2):
        estimator = cls(MOTION, SENSOR, model, num_lanes=2, max_landmarks=8)
        given = {"target": recording.target_start[:, :n_t], "target_cov": 0.04 * np.eye(n_t)}
        estimator.reset(recording.start, root @ root.T, seeds=[0, 1], **given)
        for step in recording.steps:
            estimator.predict(step.control, DT)
        beliefs.append({name: getattr(estimator.belief, name).copy() for name in ("pose", "pose_cov", "target_mean",
                        "target_cov", "target_rel", "target_rel_cov", "target_velocity_cov")})  # fmt: skip
    for name, values in beliefs[0].items():
        np.testing.assert_allclose(beliefs[1][name], values, rtol=1e-3, atol=5e-5, err_msg=name)


def test_twist_target_starts_from_its_first_two_sightings():
    motion, sensor, recording = nearly_linear(True)
    model = replace(TWIST, speed_std=0.05, turn_std=0.05)
    estimator = ISAM2(motion, sensor, model, num_lanes=2, max_landmarks=8)
    start(estimator, recording)
    feed(estimator, recording, 0, 1)
    assert not estimator.target_known.any()
    feed(estimator, recording, 1, 20)
    belief = estimator.belief
    assert belief.target_known.all()
    heading = TWIST.turn_rate * 20 * DT
    assert np.abs(wrap(belief.target_heading - heading)).max() < 4.0 * np.sqrt(belief.target_heading_var).max() < 0.4


def test_a_target_that_jumps_starts_anew():
    recording = record(1, 20)
    model = replace(TARGET_MODEL, reinitialise_nis=35.0)
    estimator = ISAM2(MOTION, SENSOR, model, max_landmarks=8)
    start(estimator, recording)
    feed(estimator, recording, 0, 15)
    for step in recording.steps[15:]:
        estimator.predict(step.control, DT)
        scan = step.scan
        scan.ranges[scan.labels == TARGET] += 3.0
        estimator.update(scan)
    assert estimator.counts["reinitialised"][0] == 1
    pose, point = estimator.belief.pose[0], estimator.belief.target_position[0]
    k = np.flatnonzero(scan.labels[0, : scan.count[0]] == TARGET)[0]
    assert np.linalg.norm(point - pose[:2]) == pytest.approx(scan.ranges[0, k], abs=0.2)


def test_a_sweep_without_a_solution_is_left_out():
    graph = Graph(Prior(np.zeros(3), 0.01 * np.eye(3), None, None, None, 0.05, 1))
    far = Sighting(0, 3.0, 0.5, 0.05, 0.02, True)
    step = Motion(np.array([0.1, 0.0, 0.0]), 1e-4 * np.eye(3), 0.1, np.zeros(3), np.zeros((3, 3)))
    assert graph.take(Sweep(step, (far,)))
    pose, cov = graph.pose.copy(), graph.joint(False, 1)
    assert not graph.take(Sweep(step, (Sighting(1, math.nan, 0.0, 0.05, 0.02, True),)))
    np.testing.assert_array_equal(graph.pose, pose)
    np.testing.assert_array_equal(graph.joint(False, 1), cov)
    assert graph.take(Sweep(step, (replace(far, is_new=False),)))


def test_covariances_are_turned_between_axes():
    rng = np.random.default_rng(1)
    root = rng.standard_normal((3, 3))
    pose, moved, h = np.array([1.0, -2.0, 2.5]), np.array([0.4, 0.2, 0.9]), 1e-6
    reached, F, Q = carry(pose, moved, root @ root.T)

    def compose(pose, moved):
        return carry(pose, moved, np.zeros((3, 3)))[0]

    by_pose = np.array([(compose(pose + d, moved) - compose(pose - d, moved)) / (2 * h) for d in h * np.eye(3)]).T
    by_move = np.array([(compose(pose, moved + d) - compose(pose, moved - d)) / (2 * h) for d in h * np.eye(3)]).T
    np.testing.assert_allclose(F, by_pose, atol=1e-8)
    np.testing.assert_allclose(Q, by_move @ root @ root.T @ by_move.T, atol=1e-8)
    np.testing.assert_allclose(turned(turned(Q, 0.7), -0.7), Q, atol=1e-12)
    assert reached[2] == pytest.approx(wrap(3.4))


def test_without_gtsam_the_message_names_the_extra(monkeypatch):
    real = builtins.__import__

    def missing(name, *rest):
        if name.startswith(("gtsam", "estimators.smoothing.graph")):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(ImportError, match=r"pip install .*\[smoothing\]"):
        registry.make("isam2", MOTION, SENSOR, None, max_landmarks=1)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"relinearize_threshold": 0.0}, "must be positive"),
        ({"iterations": 0}, "at least 1"),
        ({"budget": 3}, "budget"),
    ],
)
def test_wrong_options(wrong, message):
    with pytest.raises(ValueError, match=message):
        registry.make("isam2", MOTION, SENSOR, None, max_landmarks=1, **wrong)


def garbage(rng, lanes, width):
    """A sweep as no world makes it: any range, any label, the same landmark twice."""
    scan = Scan.empty(lanes, width)
    scan.count[:] = rng.integers(0, width + 1, lanes)
    scan.ranges[:] = 10.0 ** rng.uniform(-4.0, 1.5, scan.ranges.shape)
    scan.bearings[:] = rng.uniform(-np.pi, np.pi, scan.ranges.shape)
    scan.labels[:] = rng.choice([TARGET, UNKNOWN, *range(9)], scan.ranges.shape)
    return scan


def fuzz(model, steps, association, lanes=2):
    """Legal input of every kind; the belief must stay finite and positive semidefinite."""
    rng, recording = np.random.default_rng(7), record(lanes, steps, seed=3)
    estimator = ISAM2(MOTION, SENSOR, model, num_lanes=lanes, max_landmarks=6, association=association)
    start(estimator, recording)
    for k, step in enumerate(recording.steps):
        if k % 25 == 0:
            start(estimator, recording)
        estimator.predict(step.control * rng.uniform(-3.0, 3.0), rng.choice([0.0, 0.01, DT, 2.0]))
        estimator.update(step.scan if rng.uniform() < 0.5 else garbage(rng, lanes, 6))
        belief = estimator.belief
        for name in ("pose_cov", "target_cov", "target_rel_cov", "landmark_cov", "landmark_rel_cov"):
            cov = getattr(belief, name)
            assert np.isfinite(cov).all(), (k, name)
            if cov.size:
                assert np.linalg.eigvalsh(cov).min() > -1e-9 * max(1.0, np.abs(cov).max()), (k, name)
        assert np.isfinite(belief.pose).all()
        assert np.isfinite(belief.target_mean).all()
        assert np.isfinite(belief.landmark_mean).all()
    return estimator


@pytest.mark.parametrize("association", ["known", "nearest"])
def test_rough_input(association):
    fuzz(replace(TARGET_MODEL, reinitialise_nis=50.0), 100, association)


@pytest.mark.slow
@pytest.mark.parametrize("model", [replace(TARGET_MODEL, reinitialise_nis=50.0, reinitialise_spread=3.0), TWIST, None])
def test_ten_thousand_rough_steps(model):
    """With the two of the quick test: no exception, no NaN, no negative variance."""
    fuzz(model, 850, "known", lanes=4)


@pytest.mark.slow
def test_accurate_and_honest_beside_the_invariant_filter(ring_world):
    """Geng's ring, 20 paired runs of 250 steps: robot error not larger than ri-ekf's, NEES near 3."""
    nees, error = {}, {}
    for name in ("ri-ekf", "isam2"):
        nees[name], error[name] = ring_world(name, runs=20, steps=250)
    difference = error["isam2"] - error["ri-ekf"]
    assert difference.mean() < 2.0 * difference.std(ddof=1) / np.sqrt(20) + 0.002
    assert nees["isam2"].mean() == pytest.approx(nees["ri-ekf"].mean(), abs=0.3)
    assert abs(nees["isam2"].mean() - 3.0) < 3.0 * nees["isam2"].std(ddof=1) / np.sqrt(20)
