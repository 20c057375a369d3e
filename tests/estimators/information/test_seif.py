from dataclasses import replace

import numpy as np
import pytest

from estimators import registry
from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, record, start
from estimators.gaussian.ekf import EKF
from estimators.information.seif import SEIF
from estimators.information.sparsify import deactivate
from estimators.interface import TARGET, Scan
from estimators.kernels.gaussian import rows_in_use
from estimators.kernels.information import diffuse, invert, shear_information
from estimators.kernels.jit import jit
from estimators.kernels.left_looking import scratch
from estimators.kernels.simd import aligned_zeros
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.testing import checks

TWIST = TargetModel(kind="twist", speed=0.3, turn_rate=0.1, speed_std=0.1, turn_std=0.1)
N = 16  # rows of the matrices in the kernels' tests: robot and target, then landmarks


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@pytest.mark.parametrize("check", checks("seif"), ids=str)
def test_contract(check):
    check()


def information(rng, used=N):
    """A positive definite Omega [1, N, N], the rows beyond `used` without information."""
    root = rng.standard_normal((used, used))
    Omega = aligned_zeros(1, N, N)
    Omega[0, :used, :used] = root @ root.T + 0.5 * np.eye(used)
    Omega[0] = (Omega[0] + Omega[0].T) / 2
    return Omega


def test_inversion_leaves_empty_rows_out():
    Omega, out = information(np.random.default_rng(0), used=13), np.zeros((1, N, N))
    Omega[0, 4], Omega[0, :, 4] = 0.0, 0.0
    invert(Omega, 0, N, out, np.zeros((N, N)))
    rows = [i for i in range(13) if i != 4]
    expected = np.zeros((N, N))
    expected[np.ix_(rows, rows)] = np.linalg.inv(Omega[0][np.ix_(rows, rows)])
    np.testing.assert_allclose(out[0], expected, atol=1e-10)


@jit
def _shear(Omega):
    shear_information(Omega, 0, N, 1, 2, 0.7)


def test_motion_is_that_of_the_inverse():
    rng = np.random.default_rng(1)
    Omega = information(rng)
    E = np.eye(N)
    E[1, 2] = 0.7
    P = E @ np.linalg.inv(Omega[0]) @ E.T
    _shear(Omega)
    np.testing.assert_allclose(np.linalg.inv(Omega[0]), P, atol=1e-9)
    root = rng.standard_normal((3, 2))  # of rank 2, as two controls' noise
    P[3:6, 3:6] += root @ root.T
    diffuse(Omega, scratch(N), 0, N, 3, 3, root @ root.T)
    np.testing.assert_allclose(np.linalg.inv(Omega[0]), P, atol=1e-9)
    np.testing.assert_array_equal(Omega[0], Omega[0].T)


@jit
def _deactivate(Omega, work, n_t, count, active, slot):
    deactivate(Omega, work, 0, Omega.shape[1], n_t, count, active, slot)


def test_sparsification_is_the_textbooks():
    """Section 12.7 of Thrun, Burgard and Fox 2005 with its projections, the bodies x being robot and target."""
    Omega, active = information(np.random.default_rng(2), used=15), np.array([[True, False, True, True]])
    before = Omega[0].copy()
    _deactivate(Omega, scratch(N), 4, 4, active, 2)
    x, m0, plus = list(range(7)), [11, 12], [7, 8, 13, 14]

    def without(A, rows):
        """A with those rows marginalised out."""
        F = np.eye(N)[:, rows]
        return A - A @ F @ np.linalg.inv(F.T @ A @ F) @ F.T @ A

    S = np.zeros((N, N))
    for i in (*x, *m0, *plus):
        S[i, i] = 1.0
    conditioned = S @ before @ S
    expected = without(conditioned, m0) - without(conditioned, x + m0) + without(before, x)
    np.testing.assert_allclose(Omega[0], expected, atol=1e-9)
    assert not Omega[0][np.ix_(x, m0)].any()
    np.testing.assert_array_equal(active[0], [True, False, False, True])


def stacked_update(mu, P, n_t, ids, scan, lane, known):
    """The textbook's EKF: all returns of what is in the state, linearised at one mean."""
    H, y = [], []
    for k in range(scan.count[lane]):
        label = scan.labels[lane, k]
        if label == TARGET:
            j = 3 if known else None
        else:
            j = 3 + n_t + 2 * list(ids).index(label) if label in ids else None
        if j is None:
            continue
        dx, dy = mu[j : j + 2] - mu[:2]
        r = np.hypot(dx, dy)
        row = np.zeros((2, len(mu)))
        A = np.array([[dx / r, dy / r], [-dy / r**2, dx / r**2]])
        row[:, :2], row[:, j : j + 2], row[1, 2] = -A, A, -1.0
        H.append(row)
        y += [scan.ranges[lane, k] - r, wrap(scan.bearings[lane, k] - np.arctan2(dy, dx) + mu[2])]
    H = np.vstack(H)
    R = np.diag([SENSOR.range_std**2, SENSOR.bearing_std**2] * (len(y) // 2))
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    return mu + K @ y, (np.eye(len(mu)) - K @ H) @ P


@pytest.mark.parametrize("model", [TARGET_MODEL, TWIST, None], ids=["constant-velocity", "twist", "alone"])
def test_an_ekf_where_nothing_is_cut(model):
    """Every prediction and every update of a whole run, from the state before it."""
    recording = record(1, 25)
    seif, ekf = (cls(MOTION, SENSOR, model, max_landmarks=8) for cls in (SEIF, EKF))
    start(seif, recording, pose_cov=0.01 * np.eye(3))
    start(ekf, recording)
    n_t = seif.n_t
    for step in recording.steps:
        ekf.mu[:], ekf.P[:], ekf.count[:] = seif.mu, seif.P, seif.count
        ekf.target_known[:], ekf.pending[:] = seif.target_known, seif.pending
        seif.predict(step.control, DT)
        ekf.predict(step.control, DT)
        n = rows_in_use(n_t, seif.count[0])
        used = np.flatnonzero(np.diag(ekf.P[0]) > 0.0)
        np.testing.assert_allclose(seif.mu, ekf.mu, atol=1e-12)
        inverse = np.linalg.inv(seif.Omega[0][np.ix_(used, used)])
        np.testing.assert_allclose(inverse, ekf.P[0][np.ix_(used, used)], rtol=1e-6, atol=1e-9)
        mu, P, known, count = seif.mu[0].copy(), seif.P[0].copy(), seif.target_known[0], seif.count[0]
        seif.update(step.scan)
        if count == 0 or seif.count[0] != count or seif.target_known[0] != known:
            continue
        mu, P = stacked_update(mu, P, n_t, seif.ids[0, :count], step.scan, 0, known)
        np.testing.assert_allclose(seif.mu[0, :n], mu[:n], atol=1e-8)
        np.testing.assert_allclose(seif.P[0, :n, :n], P[:n, :n], rtol=1e-6, atol=1e-9)


def test_growth_is_the_ekfs():
    recording = record(1, 1)
    pair = []
    for cls in (SEIF, EKF):
        estimator = cls(MOTION, SENSOR, TARGET_MODEL, max_landmarks=8)
        start(estimator, recording, pose_cov=0.01 * np.eye(3))
        estimator.update(recording.steps[0].scan)
        pair.append(estimator)
    np.testing.assert_allclose(pair[0].joint(0)[0], pair[1].joint(0)[0], atol=1e-9)
    np.testing.assert_allclose(pair[0].joint(0)[1], pair[1].joint(0)[1], atol=1e-6)  # the prior's floor


@pytest.mark.parametrize("model", [TARGET_MODEL, None], ids=["target", "alone"])
def test_no_more_links_than_asked_for(model):
    """A landmark without a link to the bodies is passive; what a sweep sees stays, and is counted."""
    recording = record(2, 25)
    for i, step in enumerate(recording.steps):  # three at a time, which ones changing slowly
        for lane in range(2):
            labels = step.scan.labels[lane, : step.scan.count[lane]]
            keep = np.flatnonzero((labels == TARGET) | ((labels >= 0) & ((labels - i // 3) % 8 < 3)))
            for name in ("ranges", "bearings", "labels"):
                getattr(step.scan, name)[lane, : len(keep)] = getattr(step.scan, name)[lane, keep]
            step.scan.count[lane] = len(keep)
    estimator = SEIF(MOTION, SENSOR, model, num_lanes=2, max_landmarks=8, active=4)
    start(estimator, recording)
    for step in recording.steps:
        estimator.predict(step.control, DT)
        estimator.update(step.scan)
        n_b = 3 + estimator.n_t
        for lane in range(2):
            links = [np.abs(estimator.Omega[lane, :n_b, n_b + 2 * s : n_b + 2 * s + 2]).max() > 0.0 for s in range(8)]
            assert sum(links) <= 4
            np.testing.assert_array_equal(links, estimator.active[lane])
    assert estimator.count.min() > 4
    assert not estimator.counts["active_widened"].any()
    tight = SEIF(MOTION, SENSOR, model, num_lanes=2, max_landmarks=8, active=2)
    start(tight, recording)
    tight.update(recording.steps[0].scan)
    assert tight.counts["active_widened"].tolist() == [1, 1]


@pytest.mark.parametrize("model", [TARGET_MODEL, TWIST], ids=["constant-velocity", "twist"])
def test_sharp_returns_leave_the_information_definite_where_a_target_enters(model):
    """Returns of a few micrometres beside a pose known to decimetres: 11 digits lie between the two."""
    rng, sensor = np.random.default_rng(3), SensorModel(max_range=30.0, range_std=4e-6, bearing_std=1e-6)
    L, landmarks = 50, rng.uniform(-10.0, 10.0, (50, 12, 2))
    estimator = SEIF(MOTION, sensor, replace(model, reinitialise_nis=35.0), num_lanes=L, max_landmarks=12, active=4)
    cov = np.diag([0.04, 0.04, 0.003])
    truth = np.sqrt(np.diag(cov)) * rng.standard_normal((L, 3))
    estimator.reset(np.zeros((L, 3)), cov, seeds=np.arange(L))
    target = rng.uniform(-5.0, 5.0, (L, 2))
    for step in range(60):
        estimator.predict(np.zeros((L, 2)), DT)
        target[:, 0] += 0.3 * DT if step % 20 else 5.0  # now and then elsewhere: it starts anew
        scan = Scan.empty(L, 6)
        for lane in range(L):
            labels = rng.choice(12, 5, replace=False)
            points = [*landmarks[lane, labels], target[lane]]
            scan.count[lane] = n = 6 if step % 20 > 2 else 5  # the target comes and goes
            away = (points - truth[lane, :2])[:n]
            scan.ranges[lane, :n] = np.hypot(*away.T) + sensor.range_std * rng.standard_normal(n)
            bearing = np.arctan2(away[:, 1], away[:, 0]) - truth[lane, 2]
            scan.bearings[lane, :n] = wrap(bearing + sensor.bearing_std * rng.standard_normal(n))
            scan.labels[lane, :n] = [*labels, TARGET][:n]
        estimator.update(scan)
    assert estimator.counts["reinitialised"].min() > 0
    for lane in range(L):
        n = 3 + estimator.n_t + 2 * estimator.count[lane]
        Omega = estimator.Omega[lane, :n, :n]
        scale = np.sqrt(np.diag(Omega))
        assert np.linalg.eigvalsh(Omega / scale / scale[:, None])[0] > 0.0
    np.testing.assert_allclose(estimator.belief.pose, truth, atol=1.0)


@pytest.mark.parametrize("active", [0, 2.5, True])
def test_wrong_bound(active):
    with pytest.raises(ValueError, match="active must be a whole number"):
        registry.make("seif", MOTION, SENSOR, None, max_landmarks=1, active=active)


@pytest.mark.slow
def test_overconfident_the_more_the_fewer_links(ring_world):
    """Geng's ring, 100 paired runs: NEES (3 when honest) grows as links are cut, from the EKF's own."""
    nees = {name: ring_world(name, runs=100, steps=400)[0] for name in ("ekf", "fej-ekf")}
    for active in (20, 6, 3):
        nees[active] = ring_world("seif", runs=100, steps=400, active=active)[0]
    print({name: (values.mean(), 1.96 * values.std(ddof=1) / 10.0) for name, values in nees.items()})
    assert nees[20].mean() == pytest.approx(nees["ekf"].mean(), rel=0.15)
    cost = nees[3] - nees[20]
    assert cost.mean() > 3.0 * cost.std(ddof=1) / 10.0
    assert nees[20].mean() < nees[6].mean() < nees[3].mean()


@pytest.mark.parametrize("prior", [1.0, 1e4], ids="{:g} m2".format)
def test_a_target_a_nanometre_away_leaves_a_covariance(prior):
    """Sixteen decades between what a return says and what was known: more than an information matrix can hold."""
    motion, sensor = MotionModel(speed_std=3.0, turn_std=1.0), SensorModel(range_std=1e-6, bearing_std=2e-7)
    filter_ = registry.make("seif", motion, sensor, TargetModel(), max_landmarks=4)
    filter_.reset(np.zeros(3), prior * np.eye(3), seeds=0)
    scan = Scan.empty(1, 4)
    scan.ranges[0], scan.bearings[0] = (3.0, 2.0, 1e-3, 1e-9), (0.3, -0.7, 1.0, 0.2)
    scan.labels[0], scan.count[0] = (0, 1, 2, TARGET), 4
    for _ in range(30):
        filter_.predict(np.zeros((1, 2)), 0.1)
        filter_.update(scan)
        for cov in (filter_.belief.pose_cov, filter_.belief.target_cov, filter_.belief.target_rel_cov):
            values = np.linalg.eigvalsh(cov[0])
            assert values[0] > -1e-9 * values[-1]


def test_a_motion_that_leaves_only_rounding_of_omega():
    """Omega is P's inverse still where a target a few micrometres off, known to 1e-9 m, moves on by decimetres."""
    motion, sensor = MotionModel(speed_std=1.2, turn_std=0.4), SensorModel(range_std=7e-6, bearing_std=1.4e-6)
    filter_ = registry.make("seif", motion, sensor, TargetModel(acceleration_density=0.1), max_landmarks=6)
    filter_.reset(np.zeros(3), 1e-10 * np.eye(3), seeds=0)
    scan = Scan.empty(1, 6)
    scan.ranges[0], scan.bearings[0] = [18.6, 18.8, 20.1, 19.5, 19.8, 5e-6], [2.98, 2.94, 2.97, 2.92, 2.93, -1.65]
    scan.labels[0] = [0, 1, 2, 3, 4, TARGET]
    for returns in (5, 6, 0):
        scan.count[0] = returns
        filter_.update(scan)
        filter_.predict(np.array([[1.0, 0.5]]), DT)
    filter_.update(scan)
    used = np.flatnonzero(np.diagonal(filter_.P[0]))
    P, Omega = filter_.P[0][np.ix_(used, used)], filter_.Omega[0][np.ix_(used, used)]
    root = np.sqrt(np.diagonal(P))
    scaled = Omega * root[:, None] * root
    assert np.linalg.eigvalsh(scaled)[0] > 0.0
    np.testing.assert_allclose(scaled @ (P / root[:, None] / root), np.eye(len(used)), atol=1e-8)
