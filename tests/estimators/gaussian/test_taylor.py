"""FEJ with the Taylor net: the recipe with dense 5 x 5 matrices, its null space, its claim."""

import math

import numpy as np
import pytest

from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.gaussian.taylor import TaylorEKF
from estimators.interface import TARGET, Scan
from estimators.kernels.gaussian import remove_landmark
from estimators.models import MotionModel
from estimators.testing import checks

J = np.array([[0.0, -1.0], [1.0, 0.0]])
R = np.diag([SENSOR.range_std**2, SENSOR.bearing_std**2])


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def net(D, cov):
    """Mean return, slopes by D and curvature R_2 of (range, bearing), by a Hermite basis over D's covariance."""
    beam = np.array([D, J @ D]) / np.linalg.norm(D)
    L = beam.T @ np.linalg.cholesky(beam @ cov @ beam.T)
    x, w = np.polynomial.hermite_e.hermegauss(5)
    centre, total = math.atan2(D[1], D[0]), np.zeros((6, 2))
    for a, p in zip(x, w, strict=True):
        for b, q in zip(x, w, strict=True):
            d = D + L @ [a, b]
            g = np.array([np.hypot(*d), centre + wrap(math.atan2(d[1], d[0]) - centre)])
            basis = np.array([1.0, a, b, (a * a - 1.0) / math.sqrt(2.0), (b * b - 1.0) / math.sqrt(2.0), a * b])
            total += p * q / (2.0 * np.pi) * np.outer(basis, g)
    return total[0], total[1:3].T @ np.linalg.inv(L), total[3:].T @ total[3:]


def dense_observe(mu, P, rows, first, anchor, z):
    """Steps 1-4 of the recipe for one return; rows: of the point."""
    five = [0, 1, 2, *rows]
    P5, E = P[np.ix_(five, five)], np.hstack([-np.eye(2), np.zeros((2, 1)), np.eye(2)])
    D = mu[rows] - mu[:2]
    expected, G, R2 = net(D, E @ P5 @ E.T)
    H_SL = G @ E - np.outer([0.0, 1.0], [0.0, 0.0, 1.0, 0.0, 0.0])
    B = E.copy()
    B[:, 2] = -J @ (first - anchor)
    H = H_SL @ P5 @ B.T @ np.linalg.inv(B @ P5 @ B.T) @ B
    S = H @ P5 @ H.T + R + R2 + (H_SL - H) @ P5 @ (H_SL - H).T
    K = P[:, five] @ H.T @ np.linalg.inv(S)
    y = z - expected + [0.0, mu[2]]
    y[1] = wrap(y[1])
    mu, P = mu + K @ y, P - K @ S @ K.T
    mu[2] = wrap(mu[2])
    return mu, P


def test_an_update_is_the_recipe():
    """The known points of a late sweep, target included, through dense matrices."""
    recording = record(1, 40, seed=4)
    estimator = TaylorEKF(MOTION, SENSOR, TARGET_MODEL, max_landmarks=8)
    start(estimator, recording, pose_cov=np.diag([0.05, 0.05, 0.04]))
    feed(estimator, recording, 0, 39)
    estimator.predict(recording.steps[39].control, DT)
    scan = recording.steps[39].scan
    mu, P, n = estimator.mu[0].copy(), estimator.P[0].copy(), scan.count[0]
    slots = {label: slot for slot, label in enumerate(estimator.ids[0]) if label >= 0}
    seen = [k for k in range(n) if scan.labels[0, k] == TARGET or scan.labels[0, k] in slots]
    assert len(seen) == n > 4
    for k in seen:
        label = scan.labels[0, k]
        j = 3 if label == TARGET else 7 + 2 * slots[label]
        first = estimator.anchor[0, 2:4] if label == TARGET else estimator.first[0, slots[label], :2]
        z = np.array([scan.ranges[0, k], scan.bearings[0, k]])
        mu, P = dense_observe(mu, P, [j, j + 1], first, estimator.anchor[0, :2], z)
    estimator.update(scan)
    np.testing.assert_allclose(estimator.mu[0], mu, atol=1e-9)
    np.testing.assert_allclose(estimator.P[0], P, atol=1e-9)


def test_no_return_says_anything_about_the_unobservable_directions():
    """H N = 0 whatever the net's slopes: with P = n n' an update finds nothing to correct."""
    recording = record(1, 30)
    estimator = TaylorEKF(MOTION, SENSOR, TARGET_MODEL, max_landmarks=8)
    start(estimator, recording)
    feed(estimator, recording, 0, 20)
    estimator.set_models(0, MotionModel(speed_std=0.0, turn_std=0.0), SENSOR, TARGET_MODEL)
    estimator.predict(recording.steps[20].control, DT)
    points = [estimator.anchor[0, :2], estimator.anchor[0, 2:4], estimator.anchor[0, 4:6]]
    N = np.zeros((3, estimator.n_max))
    for row, point in zip((0, 3, 5), points, strict=True):
        N[2, row : row + 2] = J @ point
    N[2, 2] = N[0, 0] = N[1, 1] = N[0, 3] = N[1, 4] = 1.0
    for slot in range(estimator.count[0]):
        j = 7 + 2 * slot
        N[0, j] = N[1, j + 1] = 1.0
        N[2, j : j + 2] = J @ estimator.first[0, slot, :2]
    for n in N:
        estimator.P[0] = np.outer(n, n)
        before = estimator.mu[0].copy()
        estimator.update(recording.steps[20].scan)
        np.testing.assert_allclose(estimator.P[0], np.outer(n, n), atol=1e-9)
        np.testing.assert_allclose(estimator.mu[0], before, atol=1e-9)


def one_return(distance, bearing):
    scan = Scan.empty(1, 1)
    scan.count[0], scan.ranges[0, 0], scan.bearings[0, 0], scan.labels[0, 0] = 1, distance, bearing, 0
    return scan


def test_a_point_as_near_as_it_is_uncertain_teaches_little():
    """Curvature joins the noise: the bearing of a point within its own spread hardly changes the heading."""
    estimator = TaylorEKF(MOTION, SENSOR, None, max_landmarks=4)
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=0)
    estimator.update(one_return(0.1, 0.0))
    estimator.P[0, :3, :3], estimator.P[0, 3:5, 3:5] = np.diag([0.0, 0.0, 0.04]), 0.04 * np.eye(2)
    estimator.P[0, :3, 3:5] = estimator.P[0, 3:5, :3] = 0.0
    estimator.update(one_return(0.1, 1.0))
    assert abs(estimator.mu[0, 2]) < 0.02
    assert estimator.P[0, 2, 2] > 0.035


@pytest.mark.parametrize("check", checks("taylor-ekf", budget=3), ids=str)
def test_the_contract_holds(check):
    check()


def test_growth_is_fejs():
    """A landmark dropped and seen again starts a new first estimate."""
    recording = record(1, 20)
    estimator = TaylorEKF(MOTION, SENSOR, None, max_landmarks=8)
    start(estimator, recording)
    feed(estimator, recording, 0, 15)
    label, kept = estimator.ids[0, 0], estimator.count[0]
    remove_landmark(estimator.mu, estimator.P, estimator.count, estimator.ids, estimator.first, 0, 0, estimator.n_t)
    feed(estimator, recording, 15, 16)
    slot = estimator.ids[0].tolist().index(label)
    assert estimator.count[0] == kept
    np.testing.assert_array_equal(estimator.first[0, slot, :2], estimator.mu[0, 3 + 2 * slot : 5 + 2 * slot])


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["geng-m1", "geng-m2"])
def test_closer_to_consistent_than_fej(scenario):
    """Paired over fresh runs: pose NEES nearer to 3, by more than a 95 % interval; no worse for the group's filter."""
    from slam_gym.evaluation import compare

    names = ["fej-ekf", "taylor-ekf", "ri-taylor-ekf"]
    runs = compare(scenario, names, runs=200, seed=20240, jobs=1, tracks=0).runs
    nees = runs.pivot(index="run", columns="estimator", values="pose_nees_mean")
    assert abs(nees["taylor-ekf"].mean() - 3.0) < abs(nees["fej-ekf"].mean() - 3.0)
    for name in names[1:]:
        gain = nees["fej-ekf"] - nees[name]
        assert gain.mean() - 1.96 * gain.std() / math.sqrt(len(gain)) > 0.0
        assert 2.6 < nees[name].mean() < 3.4
