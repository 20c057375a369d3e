"""Association in each particle for itself."""

import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from estimators.interface import TARGET, UNKNOWN
from estimators.testing import checks


@pytest.mark.parametrize("check", checks("slamto", association="nearest"), ids=str)
def test_contract(check):
    check()


def unlabelled(returns, keep=()):
    return [(r, b, label if label in keep else UNKNOWN) for r, b, label in returns]


def test_matches_update_and_weigh_as_the_textbook(make, oracle):
    f = make(None, association="nearest")
    rng = np.random.default_rng(0)
    f.update(oracle.scan_of(unlabelled(oracle.sweep(np.zeros(3), np.array([3.0, 1.0]), rng)[:-1])))
    before, returns = f.get_state(), oracle.sweep(np.zeros(3), np.array([3.0, 1.0]), rng)[:-1]
    f.update(oracle.scan_of(unlabelled(returns[::-1])))
    after = f.get_state()
    assert (after["used"] == 4).all()
    log_w = before["log_w"][0].copy()
    for p in range(f.num_particles):
        for r, b, label in returns:
            mean, cov = oracle.unpack(before["maps"][0, label, :, p], 2)
            R = np.diag([(0.1 + 0.02 * r) ** 2, 0.05**2])
            mean, cov, nu, S = oracle.ekf_update(before["pose"][0, :, p], mean, cov, np.array([r, b]), R)
            log_w[p] += multivariate_normal.logpdf(nu, cov=S)
            new_mean, new_cov = oracle.unpack(after["maps"][0, label, :, p], 2)
            np.testing.assert_allclose(new_mean, mean, atol=1e-9)
            np.testing.assert_allclose(new_cov, cov, atol=1e-9)
    np.testing.assert_allclose(after["log_w"][0], log_w - log_w.max(), atol=1e-9)


def test_inventing_a_landmark_costs_the_sensors_area(make, oracle):
    """Two particles, one certain that the return is its landmark, one that finds nothing there."""
    f = make(None, association="nearest", particles=2)
    f.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    f.update(oracle.scan_of([(3.0, 0.0, UNKNOWN)]))
    state = f.get_state()
    state["maps"][0, 0, 0, 1] = -3.0  # the second particle's landmark is elsewhere
    f.set_state(state)
    f.update(oracle.scan_of([(3.0, 0.0, UNKNOWN)]))
    assert f.get_state()["used"][0].tolist() == [1, 2]
    S = 2.0 * np.diag([(0.1 + 0.06) ** 2, 0.05**2])
    match = 1.0 / (2.0 * math.pi * np.sqrt(np.linalg.det(S)))
    area = oracle.sensor.max_range * oracle.sensor.field_of_view
    w = f.belief.particles(0)[1]
    assert w[1] / w[0] == pytest.approx(1.0 / area / match, rel=1e-9)


def test_two_returns_never_share_a_landmark(make, oracle):
    f = make(None, association="nearest")
    f.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    f.update(oracle.scan_of([(3.0, 0.0, UNKNOWN)]))
    single = make(None, association="nearest")
    single.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    single.set_state(f.get_state())
    f.update(oracle.scan_of([(3.3, 0.0, UNKNOWN), (3.05, 0.0, UNKNOWN)]))
    single.update(oracle.scan_of([(3.05, 0.0, UNKNOWN)]))
    np.testing.assert_array_equal(f.belief.landmark_mean, single.belief.landmark_mean)
    assert f.counts["dropped"][0] == 1


def test_between_the_gates_a_return_is_left_alone(make, oracle):
    f = make(None, association="nearest")
    f.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    f.update(oracle.scan_of([(3.0, 0.0, UNKNOWN)]))
    std = np.sqrt(2.0) * 0.16
    f.update(oracle.scan_of([(3.0 + 4.5 * std, 0.0, UNKNOWN)]))  # NIS about 20
    assert f.belief.landmark_count[0] == 1
    assert f.counts["dropped"][0] == 1
    f.update(oracle.scan_of([(5.5, 0.0, UNKNOWN)]))
    assert f.belief.landmark_count[0] == 2


def test_an_unlabelled_return_can_be_the_targets(make, oracle):
    f = make("constant-velocity", association="nearest")
    rng, target = np.random.default_rng(1), oracle.priors["constant-velocity"][0][:2]
    before = np.trace(f.belief.target_position_cov[0])
    for _ in range(3):
        f.update(oracle.scan_of(unlabelled(oracle.sweep(np.zeros(3), target, rng))))
    assert f.belief.landmark_count[0] == 4
    assert np.trace(f.belief.target_position_cov[0]) < before
    np.testing.assert_allclose(f.belief.target_position[0], target, atol=0.2)


def test_a_return_labelled_target_leaves_the_others_to_the_map(make, oracle):
    f = make("constant-velocity", association="nearest")
    rng, target = np.random.default_rng(1), oracle.priors["constant-velocity"][0][:2]
    f.update(oracle.scan_of(unlabelled(oracle.sweep(np.zeros(3), target, rng), keep=(TARGET,))))
    assert f.belief.landmark_count[0] == 4


def test_the_map_shown_is_the_heaviest_particles(make, oracle):
    f = make(None, association="nearest")
    rng = np.random.default_rng(0)
    for _ in range(2):
        f.update(oracle.scan_of(unlabelled(oracle.sweep(np.zeros(3), np.array([3.0, 1.0]), rng)[:-1])))
    state = f.get_state()
    heaviest = state["w"][0].argmax()
    for slot in range(4):
        mean, cov = oracle.unpack(state["maps"][0, slot, :, heaviest], 2)
        np.testing.assert_allclose(f.belief.landmark_mean[0, slot], mean)
        np.testing.assert_allclose(f.belief.landmark_cov[0, slot], cov)
    assert f.belief.landmark_id[0].tolist() == [0, 1, 2, 3, -1, -1]


def test_a_full_map_is_counted(make, oracle):
    f = make(None, association="nearest", max_landmarks=2)
    rng = np.random.default_rng(0)
    f.update(oracle.scan_of(unlabelled(oracle.sweep(np.zeros(3), np.array([3.0, 1.0]), rng)[:-1])))
    assert f.counts["overflow"][0] == 2
    assert f.belief.landmark_count[0] == 2
