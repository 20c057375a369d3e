"""JCBB against a plain enumeration of all hypotheses in NumPy."""

import itertools
import math

import numpy as np
import pytest
from scipy.stats import chi2

from estimators.interface import TARGET, UNKNOWN
from estimators.kernels import association as a
from estimators.kernels.joint_compatibility import jcbb, joint_gates, scratch_shape
from estimators.models import MotionModel, SensorModel, TargetModel, pack_models

SENSOR = SensorModel(range_std=0.05, bearing_std=0.02)
MODEL = pack_models(MotionModel(), SENSOR, TargetModel())[()]
R = np.diag([0.05**2, 0.02**2])
LANDMARKS, COUNT = 8, 4
MATCH, NEW = 9.21, 25.0


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def state(rng, spread=0.3):
    """A robot near the origin, a target and four landmarks in one place, all correlated: mu [1, n], P [1, n, n]."""
    n = 3 + 4 + 2 * LANDMARKS
    used = [*range(7), *range(7, 7 + 2 * COUNT)]
    mu, P = np.zeros((1, n)), np.zeros((1, n, n))
    mu[0, used[:3]] = 0.05 * rng.normal(size=3)
    mu[0, 3:5] = [3.0, 0.5] + spread * rng.normal(size=2)
    mu[0, 7 : 7 + 2 * COUNT] = (np.array([3.0, 0.0]) + spread * rng.normal(size=(COUNT, 2))).ravel()
    root = 0.06 * rng.normal(size=(len(used), len(used)))
    root[:, :2] *= 3.0  # errors that all have in common
    P[np.ix_([0], used, used)] = root @ root.T / 3.0
    return mu, P


def predicted(mu, j):
    """h and H of the point at row j."""
    d = mu[0, j : j + 2] - mu[0, :2]
    r = np.hypot(*d)
    A = np.array([[d[0] / r, d[1] / r], [-d[1] / r**2, d[0] / r**2]])
    H = np.zeros((2, mu.shape[1]))
    H[:, :2], H[:, 2], H[:, j : j + 2] = -A, [0.0, -1.0], A
    return np.array([r, wrap(np.arctan2(d[1], d[0]) - mu[0, 2])]), H


def joint_distance(mu, P, returns, pairs):
    """D^2 of a hypothesis: pairs of (return, row)."""
    nu, H = [], []
    for k, j in pairs:
        h, Hj = predicted(mu, j)
        e = returns[k] - h
        nu.append([e[0], wrap(e[1])])
        H.append(Hj)
    H = np.concatenate(H)
    C = H @ P[0] @ H.T + np.kron(np.eye(len(pairs)), R)
    nu = np.concatenate(nu)
    return nu @ np.linalg.solve(C, nu)


def enumerate_all(mu, P, returns, target_known=True):
    """Most pairings that are compatible one by one and together, then the least D^2: row by return (None: none)."""
    rows = [7 + 2 * slot for slot in range(COUNT)] + ([3] if target_known else [])
    best, answer = (0, 0.0), [None] * len(returns)
    for choice in itertools.product([None, *rows], repeat=len(returns)):
        pairs = [(k, j) for k, j in enumerate(choice) if j is not None]
        if not pairs or len({j for _, j in pairs}) < len(pairs):
            continue
        if any(joint_distance(mu, P, returns, [pair]) > MATCH for pair in pairs):
            continue
        # A hypothesis is grown pairing by pairing, in the order of the returns, and must pass at every size.
        if any(
            joint_distance(mu, P, returns, pairs[: m + 1]) > chi2.ppf(chi2.cdf(MATCH, 2), 2 * (m + 1))
            for m in range(len(pairs))
        ):
            continue
        score = (len(pairs), -joint_distance(mu, P, returns, pairs))
        if score[0] > best[0] or (score[0] == best[0] and score[1] > best[1]):
            best, answer = score, list(choice)
    return answer


def associate(mu, P, returns, labels=None, target_known=True):
    """Slots by `jcbb`, and whether it ran to its end."""
    K = len(returns)
    slots = np.zeros((1, K), dtype=np.int64)
    labels = np.full((1, K), UNKNOWN) if labels is None else np.array([labels])
    complete = jcbb(
        0, mu, P, MODEL, 4, COUNT, target_known, returns[None, :, 0].copy(), returns[None, :, 1].copy(), labels, K,
        MATCH, NEW, joint_gates(MATCH, LANDMARKS + 1), np.zeros(scratch_shape(K, LANDMARKS)), slots,
    )  # fmt: skip
    return slots[0].tolist(), complete


def test_the_gates_keep_their_level():
    np.testing.assert_allclose(joint_gates(9.21, 30), chi2.ppf(chi2.cdf(9.21, 2), 2 * np.arange(1, 31)), rtol=1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_the_best_of_all_hypotheses(seed):
    rng = np.random.default_rng(seed)
    for trial in range(8):
        mu, P = state(rng)
        truth = rng.multivariate_normal(mu[0], P[0] + 1e-12 * np.eye(mu.shape[1]))[None]
        seen = rng.permutation([3, 7, 9, 11, 13])[: rng.integers(1, 5)]
        returns = np.array([predicted(truth, j)[0] + np.sqrt(np.diag(R)) * rng.normal(size=2) for j in seen])
        if trial % 2:  # a false alarm among them
            returns[0] += rng.normal(size=2) * [0.3, 0.1]
        known = trial % 3 > 0
        expected = enumerate_all(mu, P, returns, known)
        found, complete = associate(mu, P, returns, target_known=known)
        named = [None if s in (a.NEW, a.DROPPED) else 3 if s == a.TARGET_SLOT else 7 + 2 * s for s in found]
        assert complete
        assert named == expected


def test_a_turned_robot_is_not_misled():
    """Two landmarks side by side, the heading off by about their distance: each return fits the wrong one best."""
    mu, P = np.zeros((1, 23)), np.zeros((1, 23, 23))
    mu[0, 7:15] = [3.0, 0.0, 3.0, 0.3, 3.0, -8.0, -3.0, 8.0]
    P[0, range(7, 15), range(7, 15)] = 1e-4
    P[0, 2, 2] = 0.08**2
    turned = mu.copy()
    turned[0, 2] = 0.09  # the truth: everything is seen further to the right
    returns = np.array([predicted(turned, j)[0] for j in (7, 9)])
    near = np.zeros((1, 2), dtype=np.int64)
    a.nearest(
        0, mu, P, MODEL, 4, COUNT, False, returns[None, :, 0].copy(), returns[None, :, 1].copy(),
        np.full((1, 2), UNKNOWN), 2, MATCH, NEW, np.zeros((2, LANDMARKS + 1)), near,
    )  # fmt: skip
    assert associate(mu, P, returns, target_known=False)[0] == [0, 1]
    assert near[0].tolist() != [0, 1]


def test_a_return_labelled_target_is_the_targets_and_nobody_elses():
    mu, P = state(np.random.default_rng(0))
    returns = np.array([predicted(mu, 3)[0]] * 2)
    slots, _ = associate(mu, P, returns, [TARGET, UNKNOWN])
    assert slots[0] == a.TARGET_SLOT
    assert slots[1] != a.TARGET_SLOT


def test_far_away_is_new_and_what_cannot_be_used_is_dropped():
    mu, P = state(np.random.default_rng(0))
    returns = np.array([[12.0, 2.0], [math.nan, 0.0], *[predicted(mu, 7)[0]]])
    assert associate(mu, P, returns)[0] == [a.NEW, a.DROPPED, 0]


def test_a_search_that_grows_too_large_is_cut_and_still_answers():
    """Twelve returns among eight landmarks in one place: every one fits every other."""
    rng = np.random.default_rng(0)
    mu, P = np.zeros((1, 23)), np.zeros((1, 23, 23))
    mu[0, 7:23] = (np.array([3.0, 0.0]) + 0.02 * rng.normal(size=(8, 2))).ravel()
    P[0, range(7, 23), range(7, 23)] = 0.01
    returns = np.array([3.0, 0.0]) + 0.02 * rng.normal(size=(12, 2))
    slots = np.zeros((1, 12), dtype=np.int64)
    complete = jcbb(
        0, mu, P, MODEL, 4, 8, False, returns[None, :, 0].copy(), returns[None, :, 1].copy(),
        np.full((1, 12), UNKNOWN), 12, MATCH, NEW, joint_gates(MATCH, 9), np.zeros(scratch_shape(12, 8)), slots,
    )  # fmt: skip
    assert not complete
    assert sorted(s for s in slots[0] if s >= 0) == list(range(8))
    assert (slots[0] == a.DROPPED).sum() == 4
