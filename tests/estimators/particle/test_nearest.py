"""Association in each particle for itself."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from estimators.interface import TARGET, UNKNOWN
from estimators.models import MotionModel, SensorModel
from estimators.registry import make as make_estimator
from estimators.testing import checks


@pytest.mark.parametrize("check", checks("slamto", association="nearest"), ids=str)
def test_contract(check):
    check()


@pytest.mark.parametrize("check", checks("rbpf", association="nearest")[:6], ids=str)
def test_contract_of_rbpf(check):
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


FILTERS = ("slamto", "fastslam2", "rbpf")
CLUTTERED = SensorModel(max_range=20.0, range_std=0.1, bearing_std=0.05, clutter_rate=1.0, detection_probability=0.9)
NEAR, FAR = (3.0, 0.2, UNKNOWN), (2.0, -1.5, UNKNOWN)


def settled(name, sensor=CLUTTERED, **options):
    f = make_estimator(
        name, MotionModel(speed_std=0.02, turn_std=0.02), sensor, None, max_landmarks=6, particles=20,
        association="nearest", **options,
    )  # fmt: skip
    f.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    return f


def feed(f, oracle, *sweeps, complete=True):
    for returns in sweeps:
        scan = oracle.scan_of(returns)
        scan.complete[:] = complete
        f.predict(np.zeros((1, 2)), 0.1)
        f.update(scan)


@pytest.mark.parametrize("name", FILTERS)
def test_a_false_alarm_never_reaches_the_belief_and_is_removed(oracle, name):
    f = settled(name)
    feed(f, oracle, [NEAR, FAR])
    assert (f.get_state()["used"] == 2).all()
    assert f.belief.landmark_count[0] == 0
    feed(f, oracle, *[[NEAR]] * 4)
    assert (f.get_state()["used"] == 1).all()
    assert f.belief.landmark_mapped[0].tolist() == [True] + [False] * 5
    np.testing.assert_allclose(f.belief.landmark_mean[0, 0], [3.0 * np.cos(0.2), 3.0 * np.sin(0.2)], atol=0.1)
    assert f.counts["removed"][0] == 1


def test_what_need_not_have_been_seen_stays(oracle):
    gone, kept, incomplete, narrow = (
        settled("slamto"), settled("slamto", remove_below=0.0), settled("slamto"),
        settled("slamto", replace(CLUTTERED, field_of_view=0.45)),
    )  # fmt: skip
    feed(gone, oracle, [NEAR], *[[]] * 8)
    feed(kept, oracle, [NEAR], *[[]] * 8)
    feed(incomplete, oracle, [NEAR], *[[]] * 8, complete=False)
    feed(narrow, oracle, [NEAR], *[[]] * 8)
    assert [int(f.get_state()["used"].max()) for f in (gone, kept, incomplete, narrow)] == [0, 1, 1, 1]


def test_behind_a_mapped_pillar_a_landmark_need_not_be_seen(oracle):
    behind = (5.0, 0.2, UNKNOWN)
    for radius, left in ((0.3, 2), (0.0, 1)):
        f = settled("slamto", replace(CLUTTERED, landmark_radius=radius))
        feed(f, oracle, *[[NEAR, behind]] * 3, *[[NEAR]] * 12)
        assert f.get_state()["used"].max() == left


def test_resampling_takes_the_books_along(oracle):
    """Particles that are copies of one have its map and its log odds."""
    f = settled("slamto")
    feed(f, oracle, *[[NEAR, FAR]] * 3)
    state = f.get_state()
    state["w"][0] = np.eye(20)[7]
    state["log_w"][0] = np.where(np.eye(20)[7] > 0, 0.0, -np.inf)
    state["exists"][0, 1, 7] = -1.0
    state["state"]["due"] = 1
    f.set_state(state)
    f.predict(np.zeros((1, 2)), 0.1)
    after = f.get_state()
    assert (after["exists"][0, 1] == -1.0).all()
    assert (after["exists"][0, 0] == state["exists"][0, 0, 7]).all()
