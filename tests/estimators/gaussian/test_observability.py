import numpy as np
import pytest

from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, feed, record
from estimators.gaussian.observability import OCEKF, constrain
from estimators.kernels.gaussian import remove_landmark
from estimators.kernels.jit import jit
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.testing import checks

TWIST = TargetModel(kind="twist", speed=0.3, turn_rate=0.1, speed_std=0.1, turn_std=0.1)
J = np.array([[0.0, -1.0], [1.0, 0.0]])
MODELS = pytest.mark.parametrize("model", [None, TARGET_MODEL, TWIST], ids=["alone", "constant-velocity", "twist"])


@pytest.fixture(scope="module")
def recording():
    return record(2, 30)


@pytest.mark.parametrize("check", checks("oc-ekf"), ids=str)
def test_contract(check):
    check()


@jit
def _constrain(mu, pull):
    return constrain(mu, 0, pull)


@pytest.mark.parametrize("n", [0, 1, 5])
def test_the_constrained_point_solves_the_linear_system(n):
    """(1 1' + I) lam = 2 r and p* = p + sum(lam) / 2, per axis."""
    rng = np.random.default_rng(n)
    mu, r = rng.standard_normal((1, 8)), rng.standard_normal((n, 2))
    pull = np.append(r.sum(axis=0), n)[None, :]
    lam = np.linalg.solve(np.ones((n, n)) + np.eye(n), 2.0 * r)
    np.testing.assert_allclose(_constrain(mu, pull), mu[0, :2] + lam.sum(axis=0) / 2.0, atol=1e-12)
    assert not pull.any()


def directions(estimator, model):
    """N [3, n_max]: the joint state moved along x, along y, and turned; of lane 0."""
    n_t, N = estimator.n_t, np.zeros((3, estimator.n_max))
    points = [(0, estimator.anchor[0, :2])]
    if model is not None:
        points.append((3, estimator.anchor[0, 2:4]))
    points += [(3 + n_t + 2 * slot, estimator.first[0, slot, :2]) for slot in range(estimator.count[0])]
    for row, point in points:
        N[0, row] = N[1, row + 1] = 1.0
        N[2, row : row + 2] = J @ point
    N[2, 2] = 1.0
    if n_t == 4:
        N[2, 5:7] = J @ estimator.anchor[0, 4:6]
    elif n_t == 3:
        N[2, 5] = 1.0
    return N


def without_noise(model):
    if model is None:
        return None
    if model.kind == "twist":
        return TargetModel(kind="twist", speed=0.3, turn_rate=0.1, speed_std=0.0, turn_std=0.0)
    return TargetModel(acceleration_density=0.0)


def run_until_shifted(recording, model):
    """A filter whose linearisation points have left both the estimates and the first estimates; then without noise."""
    estimator = OCEKF(MOTION, SENSOR, model, num_lanes=2, max_landmarks=8)
    given = {}
    if model is not None:
        state = recording.target_start
        if model.kind == "twist":
            state = np.column_stack([state[:, :2], np.arctan2(state[:, 3], state[:, 2])])
        given = {"target": state, "target_cov": 0.01 * np.eye(state.shape[1])}
    estimator.reset(recording.start, np.diag([0.02, 0.02, 0.01]), seeds=recording.seeds, **given)
    feed(estimator, recording, 0, 20)
    assert np.abs(estimator.mu[0, :2] - estimator.anchor[0, :2]).max() > 1e-4
    estimator.set_models(0, MotionModel(speed_std=0.0, turn_std=0.0), SENSOR, without_noise(model))
    return estimator


@MODELS
def test_the_directions_stay_unobservable(recording, model):
    """F N_k = N_{k+1} and H N = 0: P = n n' becomes (F n)(F n)', and an update finds nothing to correct."""
    for k in range(3):
        estimator = run_until_shifted(recording, model)
        n = directions(estimator, model)[k]
        estimator.P[0] = np.outer(n, n)
        estimator.predict(recording.steps[20].control, DT)
        moved, before = directions(estimator, model)[k], estimator.mu[0].copy()
        np.testing.assert_allclose(estimator.P[0], np.outer(moved, moved), atol=1e-10)
        estimator.update(recording.steps[20].scan, lanes=np.array([0]))
        np.testing.assert_allclose(estimator.P[0], np.outer(moved, moved), atol=1e-10)
        np.testing.assert_allclose(estimator.mu[0], before, atol=1e-10)


@MODELS
def test_growth_keeps_the_directions(recording, model):
    """A landmark enters along N too: here one is removed, and seen again."""
    estimator = run_until_shifted(recording, model)
    kept = estimator.count[0]
    estimator.predict(recording.steps[20].control, DT)
    n = directions(estimator, model)[2]
    estimator.P[0] = np.outer(n, n)
    remove_landmark(estimator.mu, estimator.P, estimator.count, estimator.ids, estimator.first, 0, 2, estimator.n_t)
    estimator.set_models(0, estimator.motion, SensorModel(range_std=1e-9, bearing_std=1e-9), model)
    estimator.update(recording.steps[20].scan, lanes=np.array([0]))
    assert estimator.count[0] == kept
    j = 3 + estimator.n_t + 2 * (kept - 1)
    expected = J @ estimator.first[0, kept - 1, :2]
    np.testing.assert_allclose(estimator.P[0, 2, j : j + 2], expected * estimator.P[0, 2, 2], atol=1e-9)


def test_the_points_lie_nearer_to_the_estimates_than_first_estimates_do(recording):
    """What the constrained choice is for: the vectors from robot to landmark in H against those of the estimates."""
    estimator = run_until_shifted(recording, None)
    estimator.predict(recording.steps[20].control, DT)
    count = estimator.count[0]
    points = estimator.mu[0, 3 : 3 + 2 * count].reshape(-1, 2)
    now = points - estimator.mu[0, :2]
    used = estimator.first[0, :count, :2] - estimator.anchor[0, :2]
    first = estimator.first[0, :count, :2] - estimator.mu[0, :2]
    assert np.linalg.norm(used - now) < np.linalg.norm(first - now)


@pytest.mark.slow
def test_consistent_where_the_ekf_is_not(ring_world):
    """Geng's ring, 200 paired runs, robot alone and with a target: 3 within its interval, as fej-ekf, not as ekf."""
    for with_target in (False, True):
        scores = {name: ring_world(name, runs=200, steps=500, with_target=with_target)
                  for name in ("ekf", "fej-ekf", "ri-ekf", "oc-ekf")}  # fmt: skip
        for name, (nees, error, *target) in scores.items():
            half = 1.96 * nees.std(ddof=1) / np.sqrt(200)
            print(
                with_target,
                name,
                f"{nees.mean():.2f} +- {half:.2f}",
                f"{error.mean():.3f}",
                *(t.mean() for t in target),
            )
        nees = scores["oc-ekf"][0]
        assert abs(nees.mean() - 3.0) < 3.0 * nees.std(ddof=1) / np.sqrt(200)
        beside = nees - scores["fej-ekf"][0]
        assert beside.mean() < 0.1 + 3.0 * beside.std(ddof=1) / np.sqrt(200)
        gain = scores["ekf"][0] - nees
        assert gain.mean() > 3.0 * gain.std(ddof=1) / np.sqrt(200)
