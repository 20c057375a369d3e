"""SLAMTO as a whole: the belief as the mixture's moments, its behaviour, its bookkeeping."""

import pickle

import numpy as np
import pytest

from estimators import make as make_estimator
from estimators._recording import MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.interface import TARGET, UNKNOWN
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.particle.slamto import SLAMTO
from estimators.testing import checks

KINDS = ("twist", "constant-velocity")


@pytest.mark.parametrize("check", checks("slamto"), ids=str)
def test_contract(check):
    check()


def run_a_while(f, oracle, steps=6, seed=0):
    rng = np.random.default_rng(seed)
    pose, target = np.zeros(3), np.array([3.0, 1.0])
    for _ in range(steps):
        f.predict(np.tile([0.5, 0.2], (f.num_lanes, 1)), 0.2)
        pose += np.array([0.1 * np.cos(pose[2] + 0.04), 0.1 * np.sin(pose[2] + 0.04), 0.04])
        f.update(oracle.scan_of(oracle.sweep(pose, target, rng), f.num_lanes))
    return pose


def mixture(means, covs, w, headings=()):
    """Mean and covariance of a mixture by the textbook; `headings` names angular coordinates."""
    mean = w @ means
    for i in headings:
        mean[i] = np.angle(w @ np.exp(1j * means[:, i]))
        mean[i] += w @ ((means[:, i] - mean[i] + np.pi) % (2 * np.pi) - np.pi)
    d = means - mean
    for i in headings:
        d[:, i] = (d[:, i] + np.pi) % (2 * np.pi) - np.pi
    return mean, np.einsum("p,pij->ij", w, covs) + np.einsum("p,pi,pj->ij", w, d, d)


@pytest.mark.parametrize("kind", KINDS)
def test_belief_is_the_mixture_of_the_particles(make, oracle, kind):
    f = make(kind)
    f.reset(np.array([0.0, 0.0, 3.1]), np.diag([0.01, 0.01, 0.02]), seeds=[1],
            target=oracle.priors[kind][0], target_cov=oracle.priors[kind][1])  # fmt: skip
    f.update(oracle.scan_of([(3.0, 0.5, 0), (2.0, -1.0, 1)]))
    run_a_while(f, oracle, 2)
    state, (pose, w) = f.get_state(), f.belief.particles(0)
    n_t = len(f.target_names)
    parts = [oracle.unpack(state["target"][0, 0, :, p], n_t) for p in range(f.num_particles)]
    means, covs = np.array([m for m, _ in parts]), np.array([c for _, c in parts])
    angular = (2,) if kind == "twist" else ()
    belief = f.belief
    for got, expected in zip(
        (belief.pose[0], belief.pose_cov[0]), mixture(pose, np.zeros((len(w), 3, 3)), w, (2,)), strict=True
    ):
        np.testing.assert_allclose(got, expected, atol=1e-12)
    for got, expected in zip(
        (belief.target_mean[0], belief.target_cov[0]), mixture(means, covs, w, angular), strict=True
    ):
        np.testing.assert_allclose(got, expected, atol=1e-11)
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    turn = np.stack([np.stack([c, s], -1), np.stack([-s, c], -1)], -2)  # [N, 2, 2], into the robot's axes
    check_relative(belief.target_rel[0], belief.target_rel_cov[0], means[:, :2], covs[:, :2, :2], pose, turn, w)
    marks = [oracle.unpack(state["maps"][0, 1, :, p], 2) for p in range(f.num_particles)]
    mean, cov = np.array([m for m, _ in marks]), np.array([c for _, c in marks])
    expected = mixture(mean, cov, w)
    np.testing.assert_allclose(belief.landmark_mean[0, 1], expected[0], atol=1e-11)
    np.testing.assert_allclose(belief.landmark_cov[0, 1], expected[1], atol=1e-11)
    check_relative(belief.landmark_rel[0, 1], belief.landmark_rel_cov[0, 1], mean, cov, pose, turn, w)


def check_relative(got_mean, got_cov, means, covs, pose, turn, w):
    rel = np.einsum("pij,pj->pi", turn, means - pose[:, :2])
    mean, cov = mixture(rel, turn @ covs @ turn.transpose(0, 2, 1), w)
    np.testing.assert_allclose(got_mean, mean, atol=1e-11)
    np.testing.assert_allclose(got_cov, cov, atol=1e-11)


def test_velocity_of_the_mixture(make, oracle):
    f = make("twist")
    run_a_while(f, oracle, 2)
    state, (pose, w) = f.get_state(), f.belief.particles(0)
    heading, var = state["target"][0, 0, 2], state["target"][0, 0, 8]
    speed = oracle.targets["twist"].speed
    v = speed * np.stack([np.cos(heading), np.sin(heading)], -1)
    across = np.stack([-v[:, 1], v[:, 0]], -1)
    mean, cov = mixture(v, var[:, None, None] * across[:, :, None] * across[:, None, :], w)
    np.testing.assert_allclose(f.belief.target_velocity[0], mean, atol=1e-12)
    np.testing.assert_allclose(f.belief.target_velocity_cov[0], cov, atol=1e-12)
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    expected = [w @ (c * v[:, 0] + s * v[:, 1]), w @ (c * v[:, 1] - s * v[:, 0])]
    np.testing.assert_allclose(f.belief.target_rel_velocity[0], expected, atol=1e-12)


def test_without_noise_it_maps_from_a_known_pose(make, oracle):
    f = make(None, motion=MotionModel(speed_std=0.0, turn_std=0.0), particles=2)
    f.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    rng, pose = np.random.default_rng(2), np.zeros(3)
    known = {}
    for _ in range(15):
        f.predict(np.array([[0.8, 0.3]]), 0.1)
        turn = pose[2] + 0.03
        pose = np.array([pose[0] + 0.08 * np.cos(turn), pose[1] + 0.08 * np.sin(turn), turn])
        returns = oracle.sweep(pose, np.zeros(2), rng)[:-1]
        f.update(oracle.scan_of(returns))
        for r, b, label in returns:
            R = np.diag([(0.1 + 0.02 * r) ** 2, 0.05**2])
            if label in known:
                known[label] = oracle.ekf_update(pose, *known[label], np.array([r, b]), R)[:2]
            else:
                point = pose[:2] + r * np.array([np.cos(pose[2] + b), np.sin(pose[2] + b)])
                H = np.linalg.inv(oracle.measurement(pose, point, 2)[1])
                known[label] = (point, H @ R @ H.T)
    np.testing.assert_allclose(f.belief.pose[0], pose, atol=1e-12)
    for label, (mean, cov) in known.items():
        np.testing.assert_allclose(f.belief.landmark_mean[0, label], mean, atol=1e-10)
        np.testing.assert_allclose(f.belief.landmark_cov[0, label], cov, atol=1e-10)


@pytest.mark.parametrize("association", ["known", "nearest"])
def test_lanes_are_single_runs_bit_for_bit(association):
    recording = record(5, 12, labelled=association == "known")
    options = {"particles": 31, "max_landmarks": 12, "association": association}
    together = SLAMTO(MOTION, SENSOR, TARGET_MODEL, num_lanes=5, **options)
    start(together, recording)
    feed(together, recording)
    for lane in range(5):
        alone = SLAMTO(MOTION, SENSOR, TARGET_MODEL, **options)
        start(alone, recording.lane(lane))
        feed(alone, recording.lane(lane))
        for name in ("pose", "pose_cov", "target_mean", "target_cov", "landmark_mean", "landmark_rel_cov"):
            np.testing.assert_array_equal(getattr(alone.belief, name)[0], getattr(together.belief, name)[lane])


def test_state_and_pickle_continue_bit_for_bit():
    recording = record(2, 20)
    f = SLAMTO(MOTION, SENSOR, TARGET_MODEL, num_lanes=2, max_landmarks=12, particles=40)
    start(f, recording)
    feed(f, recording, 0, 10)
    state, copy = f.get_state(), pickle.loads(pickle.dumps(f))
    feed(f, recording, 10, 20)
    feed(copy, recording, 10, 20)
    other = SLAMTO(MOTION, SENSOR, TARGET_MODEL, num_lanes=2, max_landmarks=12, particles=40)
    other.set_state(state)
    feed(other, recording, 10, 20)
    for again in (copy, other):
        np.testing.assert_array_equal(f.belief.pose, again.belief.pose)
        np.testing.assert_array_equal(f.belief.landmark_cov, again.belief.landmark_cov)
        assert {k: v.tolist() for k, v in f.counts.items()} == {k: v.tolist() for k, v in again.counts.items()}


def test_resampling_keeps_the_mean_and_equals_the_weights(make, oracle):
    f = make("twist", particles=4000, resample_threshold=1.0)
    run_a_while(f, oracle, 1)
    before = f.belief.pose.copy(), f.belief.landmark_mean.copy(), f.belief.target_mean.copy()
    f.update(oracle.scan_of([]))  # resamples first, then sees nothing
    assert f.counts["resampled"][0] == 1
    np.testing.assert_allclose(f.belief.particles(0)[1], 1.0 / 4000)
    for old, name in zip(before, ("pose", "landmark_mean", "target_mean"), strict=True):
        np.testing.assert_allclose(getattr(f.belief, name), old, atol=0.01)


def test_weights_are_kept_when_not_resampling(make, oracle):
    f = make("twist", resample_threshold=0.0)
    run_a_while(f, oracle, 2)
    w = f.belief.particles(0)[1]
    f.predict(np.array([[0.5, 0.2]]), 0.2)
    f.update(oracle.scan_of([]))
    np.testing.assert_allclose(f.belief.particles(0)[1], w, rtol=1e-12)
    assert w.std() > 0.0
    assert f.counts["resampled"][0] == 0


def test_no_resampling_above_the_threshold(make, oracle):
    f = make(None, resample_threshold=0.5)
    f.update(oracle.scan_of([(2.0, 0.3, 0)]))
    f.update(oracle.scan_of([(2.0, 0.3, 0)]))
    w = f.belief.particles(0)[1]
    assert 1.0 / (w**2).sum() > 15.0
    f.predict(np.zeros((1, 2)), 0.1)
    assert f.counts["resampled"][0] == 0


def test_a_hundred_sharp_landmarks_do_not_overflow(oracle):
    sensor = SensorModel(max_range=100.0, range_std=1e-4, bearing_std=1e-5)
    f = SLAMTO(MOTION, sensor, None, max_landmarks=400, particles=50)
    returns = [(5.0 + 0.1 * k, oracle.wrap(0.7 * k), k) for k in range(400)]
    for _ in range(4):
        f.predict(np.zeros((1, 2)), 0.1)
        f.update(oracle.scan_of(returns))
    assert np.isfinite(f.belief.pose).all()
    assert np.isfinite(f.belief.landmark_cov).all()
    assert f.belief.particles(0)[1].sum() == pytest.approx(1.0)
    assert f.counts["bad_weights"][0] == 0


def test_a_particle_that_is_no_number_is_replaced(make, oracle):
    f = make("twist", resample_threshold=0.0)
    run_a_while(f, oracle, 2)
    state = f.get_state()
    state["pose"][0, 0, 4] = np.nan
    f.set_state(state)
    f.update(oracle.scan_of([(2.0, 0.5, 0)]))
    assert np.isfinite(f.belief.pose).all()
    assert f.counts["bad_weights"][0] == 1
    f.predict(np.array([[0.5, 0.2]]), 0.2)
    assert np.isfinite(f.belief.particles(0)[0]).all()


def test_a_landmark_under_the_robot_does_no_harm(make, oracle):
    f = make(None)
    f.update(oracle.scan_of([(1e-9, 0.0, 0), (2.0, 0.1, 1)]))
    f.update(oracle.scan_of([(1e-9, 1.0, 0), (2.0, 0.1, 1)]))
    assert np.isfinite(f.belief.pose).all()
    assert np.isfinite(f.belief.landmark_mean).all()


def test_returns_that_cannot_be_used_are_counted(make, oracle):
    f = make(None, max_landmarks=2)
    f.update(oracle.scan_of([(2.0, 0.1, 0), (2.0, 0.9, 1), (3.0, 0.5, 2), (2.0, 0.0, UNKNOWN), (2.0, 0.2, TARGET)]))
    assert f.counts["overflow"][0] == 1
    assert f.counts["dropped"][0] == 2
    assert f.belief.landmark_count[0] == 2


def test_the_gate_refuses_a_mislabelled_return(make, oracle):
    returns = [(2.8, 0.8, 0), (4.1, -0.3, 1)]
    swapped = [(4.1, -0.3, 0), (2.8, 0.8, 1)]
    f = make(None, gate=14.0)
    f.update(oracle.scan_of(returns))
    before = f.belief.landmark_mean.copy()
    f.update(oracle.scan_of(swapped))
    assert f.counts["gated"][0] == 2
    np.testing.assert_array_equal(f.belief.landmark_mean, before)
    f.update(oracle.scan_of(returns))
    assert f.counts["gated"][0] == 2


def test_a_target_that_jumps_starts_anew(make, oracle):
    target = TargetModel(kind="constant-velocity", reinitialise_nis=50.0)
    f = make("constant-velocity", target=target)
    f.update(oracle.scan_of([(3.1, 0.3, TARGET)]))
    assert f.counts["target_restarts"][0] == 0
    f.update(oracle.scan_of([(3.1, -2.5, TARGET)]))
    assert f.counts["target_restarts"][0] == 1
    expected = 3.1 * np.array([np.cos(-2.5), np.sin(-2.5)])
    np.testing.assert_allclose(f.belief.target_rel[0], expected, atol=1e-9)
    np.testing.assert_allclose(f.belief.target_velocity_cov[0], np.eye(2), atol=1e-9)


def test_target_of_unknown_heading_is_found_by_hypotheses(make, oracle):
    """Eight headings at the first sighting, one once they agree; the heading comes out right in every direction."""
    model = TargetModel(kind="twist", speed=2.0, turn_rate=0.0, speed_std=0.2, turn_std=0.1)
    sensor = SensorModel(max_range=20.0, range_std=0.02, bearing_std=0.005)
    for heading in np.linspace(-3.0, 3.0, 7):
        f = make("twist", prior=False, target=model, sensor=sensor, motion=MotionModel(speed_std=0.0, turn_std=0.0))
        f.reset(np.zeros(3), np.zeros((3, 3)), seeds=[3])
        assert not f.belief.target_known[0]
        for step in range(12):
            point = np.array([5.0, 1.0]) + 0.2 * step * np.array([np.cos(heading), np.sin(heading)])
            f.update(oracle.scan_of([(np.hypot(*point), np.arctan2(point[1], point[0]), TARGET)]))
            assert f.belief.target_known[0]
            if step == 0:
                assert f.get_state()["state"]["hypotheses"][0] == 8
                assert f.belief.target_heading_var[0] > 3.0
            f.predict(np.zeros((1, 2)), 0.1)
        assert f.get_state()["state"]["hypotheses"][0] == 1
        assert abs(oracle.wrap(f.belief.target_heading[0] - heading)) < 0.1


def test_first_sighting_does_not_touch_the_weights(make, oracle):
    f = make("twist", prior=False)
    f.update(oracle.scan_of([(3.0, 0.2, TARGET)]))
    np.testing.assert_allclose(f.belief.particles(0)[1], 1.0 / 30)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"particles": 1}, "particles must be at least 2"),
        ({"resample_threshold": 1.5}, "share of the particles"),
        ({"association": "jcbb"}, "'known', 'nearest'"),
        ({"match_gate": 30.0, "new_gate": 20.0}, "match_gate at most new_gate"),
        ({"gate": 0.0}, "gates are positive"),
        ({"partikles": 10}, "unknown option 'partikles'. Did you mean 'particles'"),
    ],
)
def test_wrong_options(options, message):
    with pytest.raises(ValueError, match=message):
        make_estimator("slamto", MOTION, SENSOR, None, max_landmarks=3, **options)


def test_a_step_of_no_time_changes_nothing(make, oracle):
    f = make("twist")
    run_a_while(f, oracle, 1)
    before = f.belief.particles(0)[0]
    f.predict(np.array([[1.0, 1.0]]), 0.0)
    np.testing.assert_array_equal(f.belief.particles(0)[0], before)
