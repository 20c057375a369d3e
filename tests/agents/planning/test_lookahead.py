"""The plan's covariance against the textbook's matrices, and its chances of a return against geometry."""

import math

import numpy as np
import pytest

from agents.planning import lookahead
from agents.planning.state import MARK, TARGET, VELOCITY, from_joint, from_marginals
from agents.planning.visibility import chance_seen
from estimators.kernels.jit import jit
from estimators.models import MotionModel, SensorModel, TargetModel, pack_models

MOTION = MotionModel(speed_std=0.02, turn_std=0.03, speed_std_per_speed=0.1, turn_std_per_turn=0.1)
SENSOR = SensorModel(field_of_view=2.0, range_std_per_range=0.02, detection_probability=0.9, landmark_radius=0.5)
MODEL = pack_models(MOTION, SENSOR, TargetModel())[()]
NO_PILLARS = np.zeros((1, 2))


@jit
def advance(x, P, n, v, w, seconds, steps, model, density):
    dx, dy, heading = lookahead.drive(x, v, w, seconds)
    lookahead.grow(P, n, dx, dy, heading, v, w, seconds, steps, model, density)


@jit
def look(x, P, n, at, chance, sweeps, model, B):
    lookahead.look(x, P, n, at, chance, sweeps, model, B)


@jit
def chance(x, P, at, pillars, num_pillars, softness, model):
    return chance_seen(x, P, at, pillars, num_pillars, softness, model)


def a_belief(seed=0, marks=2):
    rng = np.random.default_rng(seed)
    n = MARK + 2 * marks
    x = np.concatenate([[0.3, -0.2, 0.4, 3.0, 1.0, 0.5, -0.3], rng.uniform(-4, 4, 2 * marks)])
    A = 0.15 * rng.standard_normal((n, n))
    return x, A @ A.T


def test_a_segment_moves_mean_and_covariance_as_its_small_steps_do():
    x, P = a_belief()
    y, Q = x.copy(), P.copy()
    advance(y, Q, len(x), 0.8, 0.7, 0.5, 5.0, MODEL, 0.3)
    small, S = x.copy(), P.copy()
    for _ in range(500):
        advance(small, S, len(x), 0.8, 0.7, 0.001, 0.01, MODEL, 0.3)  # 0.01 steps: the noise of 5 steps in all
    np.testing.assert_allclose(y, small, atol=1e-5)
    np.testing.assert_allclose(Q, S, atol=2e-3)
    np.testing.assert_allclose(Q, Q.T, atol=1e-15)


def test_prediction_is_F_P_F_plus_Q():
    x, P = a_belief()
    n, y, Q = len(x), x.copy(), P.copy()
    advance(y, Q, n, 0.8, 0.7, 0.5, 5.0, MODEL, 0.3)
    F = np.eye(n)
    F[0, 2], F[1, 2] = -(y[1] - x[1]), y[0] - x[0]
    F[TARGET, VELOCITY] = F[TARGET + 1, VELOCITY + 1] = 0.5
    extra = Q - F @ P @ F.T
    assert extra[0, 0] > 0.0
    np.testing.assert_allclose(extra[TARGET, TARGET], 0.3**2 * 0.5**3 / 3, rtol=1e-9)
    np.testing.assert_allclose(extra[TARGET, VELOCITY], 0.3**2 * 0.5**2 / 2, rtol=1e-9)
    np.testing.assert_allclose(extra[VELOCITY, VELOCITY], 0.3**2 * 0.5, rtol=1e-9)
    np.testing.assert_allclose(extra[2, 2], 5 * (0.1 * (0.03 + 0.1 * 0.7)) ** 2, rtol=1e-9)
    np.testing.assert_allclose(extra[MARK:], 0.0, atol=1e-12)


@pytest.mark.parametrize(("at", "p"), [(TARGET, 1.0), (TARGET, 0.4), (MARK + 2, 1.0)])
def test_an_expected_look_is_the_textbooks_update_times_its_chance(at, p):
    x, P = a_belief()
    n, found = len(x), P.copy()
    look(x, found, n, at, p, 4.0, MODEL, np.zeros((n, 2)))
    dx, dy = x[at : at + 2] - x[:2]
    r = math.hypot(dx, dy)
    H = np.zeros((2, n))
    H[0, at], H[0, at + 1], H[1, at], H[1, at + 1] = dx / r, dy / r, -dy / r**2, dx / r**2
    H[:, :2], H[1, 2] = -H[:, at : at + 2], -1.0
    R = np.diag([(0.05 + 0.02 * r) ** 2, 0.03**2]) / 4.0
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    np.testing.assert_allclose(found, P - p * K @ H @ P, atol=1e-12)
    assert np.linalg.eigvalsh(found).min() > -1e-12


@pytest.mark.parametrize(("point", "expected"), [
    ((5.0, 0.0), 0.9), ((6.0, 0.0), 0.45), ((7.0, 0.0), 0.0), ((-3.0, 0.0), 0.0),
    ((4.0 * math.cos(1.0), 4.0 * math.sin(1.0)), 0.45),
])  # fmt: skip
def test_the_chance_of_a_return_is_one_half_on_the_edges(point, expected):
    x = np.array([0.0, 0.0, 0.0, *point, 0.0, 0.0])
    P = np.diag([0.01, 0.01, 0.0, 0.01, 0.01, 0.0, 0.0])
    assert chance(x, P, TARGET, NO_PILLARS, 0, 0.1, MODEL) == pytest.approx(expected, abs=0.01)


def test_a_pillar_hides_what_is_behind_it_and_less_surely_what_is_badly_known():
    x = np.array([0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0])
    known, unknown = np.zeros((7, 7)), np.diag([0, 0, 0, 1.0, 1.0, 0, 0])
    behind, beside, beyond = (np.array([p]) for p in ([2.0, 0.1], [2.0, 0.8], [4.2, 0.0]))
    assert chance(x, known, TARGET, behind, 1, -1.0, MODEL) == 0.0
    assert chance(x, known, TARGET, beside, 1, -1.0, MODEL) == 0.9
    assert chance(x, known, TARGET, beyond, 1, -1.0, MODEL) == 0.9  # the point's own pillar, or one farther away
    assert 0.02 < chance(x, unknown, TARGET, behind, 1, 0.0, MODEL) < 0.5
    assert 0.4 < chance(x, unknown, TARGET, beside, 1, 0.0, MODEL) < 0.85


def rows(n, marks):
    return np.zeros(marks, dtype=np.int64), np.zeros(n), np.zeros((n, n))


def marginals(x, P):
    """What a belief without a joint Gaussian says of x, P: marginals, and covariances in the robot's frame."""
    c, s = math.cos(x[2]), math.sin(x[2])
    turn = np.array([[c, s], [-s, c]])

    def relative(at):
        J = np.zeros((2, len(x)))
        J[:, at : at + 2], J[:, :2] = turn, -turn
        east, north = x[at : at + 2] - x[:2]
        J[:, 2] = turn @ [north, -east]
        return J @ P @ J.T

    marks = range(MARK, len(x), 2)
    block = [P[at : at + 2, at : at + 2] for at in marks]
    return {
        "pose": x[None, :3], "pose_cov": P[None, :3, :3], "position": x[None, 3:5], "position_cov": P[None, 3:5, 3:5],
        "velocity": x[None, 5:7], "velocity_cov": P[None, 5:7, 5:7], "target_rel_cov": relative(TARGET)[None],
        "mapped": np.ones((1, len(marks)), dtype=np.bool_), "landmarks": x[None, MARK:].reshape(1, -1, 2),
        "landmark_cov": np.array([block]), "landmark_rel_cov": np.array([[relative(at) for at in marks]]),
    }  # fmt: skip


def test_rows_of_the_joint_are_taken_nearest_first_within_reach():
    x, P = a_belief(marks=4)
    x[MARK:] = [9.0, 0.0, 2.0, 0.0, 1.0, 1.0, 30.0, 0.0]
    order, y, Q = rows(MARK + 6, 3)
    pillars = np.zeros((4, 2))
    velocity = np.zeros((1, 2)), np.zeros((1, 2, 2))
    n, count = from_joint(0, x, P, 4, *velocity, 12.0, order, np.zeros(MARK + 6, dtype=np.int64), pillars, y, Q)
    chosen = [*range(MARK), MARK + 4, MARK + 5, MARK + 2, MARK + 3, MARK, MARK + 1]
    assert (n, count) == (MARK + 6, 4)
    np.testing.assert_array_equal(y, x[chosen])
    np.testing.assert_array_equal(Q, P[np.ix_(chosen, chosen)])
    np.testing.assert_array_equal(pillars.ravel(), x[MARK:])


@pytest.mark.parametrize("seed", range(6))
def test_without_a_joint_marginals_stay_and_the_relative_trace_with_them(seed):
    x, P = a_belief(seed)
    if seed < 3:  # as after driving with points fixed in the robot's frame: all have the pose's error in common
        P *= 0.02
        G = np.zeros((len(x), 3))
        G[:3] = np.eye(3)
        for at in (TARGET, MARK, MARK + 2):
            east, north = x[at : at + 2] - x[:2]
            G[at : at + 2] = [[0.8, 0.0, -0.8 * north], [0.0, 0.8, 0.8 * east]]
        P += G @ np.diag([0.05, 0.03, 0.01]) @ G.T
    said = marginals(x, P)
    order, y, Q = rows(len(x), 2)
    n, _ = from_marginals(0, *said.values(), 99.0, order, np.zeros(2, dtype=np.int64), np.zeros((2, 2)),
                          np.zeros((len(x), 3)), y, Q)  # fmt: skip
    assert n == len(x)
    again = marginals(y, Q)
    order = np.argsort(order)
    for name in ("pose_cov", "position_cov", "velocity_cov"):
        np.testing.assert_allclose(again[name], said[name], atol=1e-12, err_msg=name)
    np.testing.assert_allclose(again["landmark_cov"][0, order], said["landmark_cov"][0], atol=1e-12)
    assert np.linalg.eigvalsh(Q).min() > -1e-9
    if seed < 3:
        np.testing.assert_allclose(np.trace(again["target_rel_cov"][0]), np.trace(said["target_rel_cov"][0]), rtol=0.02)
