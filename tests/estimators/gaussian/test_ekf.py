import numpy as np
import pytest

from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.gaussian.ekf import EKF
from estimators.interface import TARGET, UNKNOWN, Scan
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.testing import checks

TWIST = TargetModel(kind="twist", speed=0.3, turn_rate=0.1, speed_std=0.1, turn_std=0.1)
CHORD = {"first_heading": "two-sightings"}
PRIOR_COV = np.diag([0.02, 0.02, 0.01])


@pytest.fixture(scope="module")
def recording():
    return record(2, 40)


def scan_of(*returns):
    """One lane's sweep of (range, bearing, label)."""
    scan = Scan.empty(1, max(len(returns), 1))
    scan.count[0] = len(returns)
    for k, (distance, bearing, label) in enumerate(returns):
        scan.ranges[0, k], scan.bearings[0, k], scan.labels[0, k] = distance, bearing, label
    return scan


def target_prior(recording, model):
    """Mean and covariance near the target's true start."""
    state = recording.target_start
    if model.kind == "twist":
        state = np.column_stack([state[:, :2], np.arctan2(state[:, 3], state[:, 2])])
    return state, 0.01 * np.eye(state.shape[1])


@pytest.mark.parametrize("check", checks("ekf"), ids=str)
def test_contract(check):
    check()


@pytest.mark.parametrize("model", [None, TARGET_MODEL, TWIST], ids=["alone", "constant-velocity", "twist"])
def test_whole_run_against_dense_matrices(recording, model, dense_filter, run_dense, compare_joint):
    estimator = EKF(MOTION, SENSOR, model, num_lanes=2, max_landmarks=8)
    mean, cov = (None, None) if model is None else target_prior(recording, model)
    estimator.reset(recording.start, PRIOR_COV, seeds=recording.seeds, target=mean, target_cov=cov)
    feed(estimator, recording)
    for lane in range(2):
        prior = None if model is None else (mean[lane], cov)
        dense = dense_filter("ekf", MOTION, SENSOR, model, recording.start[lane], PRIOR_COV, prior)
        compare_joint(estimator, lane, run_dense(dense, recording, lane, DT))
    assert not any(counts.any() for counts in estimator.counts.values()) or model is None


def test_is_the_kalman_filter_where_everything_is_linear():
    """Driving straight along x, landmarks far ahead on the axis: x and range are a linear system."""
    motion = MotionModel(speed_std=0.2, turn_std=0.0)
    sensor = SensorModel(max_range=1e4, range_std=0.1, bearing_std=1e-3)
    estimator = EKF(motion, sensor, None, max_landmarks=1)
    estimator.reset(np.zeros(3), np.diag([0.04, 0.0, 0.0]), seeds=[0])
    rng = np.random.default_rng(0)
    x, P, H = np.zeros(2), np.diag([0.04, 0.0]), np.array([[-1.0, 1.0]])
    for k in range(30):
        z = 100.0 - 0.1 * k + 0.1 * rng.standard_normal()
        estimator.predict(np.array([[1.0, 0.0]]), 0.1)
        estimator.update(scan_of((z, 0.0, 5)))
        x[0], P[0, 0] = x[0] + 0.1, P[0, 0] + 0.02**2
        if k == 0:
            x[1], P = x[0] + z, np.array([[P[0, 0], P[0, 0]], [P[0, 0], P[0, 0] + 0.01]])
        else:
            K = P @ H.T / (H @ P @ H.T + 0.01)
            x, P = x + (K * (z - H @ x)).ravel(), P - K @ H @ P
    mean, cov = estimator.joint(0)
    np.testing.assert_allclose(mean[[0, 3]], x, atol=1e-9)
    np.testing.assert_allclose(cov[np.ix_([0, 3], [0, 3])], P, atol=1e-9)


def known_map(**options):
    """One landmark (id 4) at (3, 0), the robot at the origin, everything known to a centimetre or so."""
    target = options.pop("target", None)
    estimator = EKF(MotionModel(), SensorModel(), target, max_landmarks=2, **options)
    estimator.reset(np.zeros(3), 1e-4 * np.eye(3), seeds=[0])
    estimator.update(scan_of((3.0, 0.0, 4)))
    return estimator


def test_gate_rejects_a_label_that_cannot_be_right():
    estimator = known_map(gate=13.8)
    before = estimator.joint(0)
    estimator.update(scan_of((4.0, 0.5, 4)))
    assert estimator.counts["gate_rejected"][0] == 1
    for old, new in zip(before, estimator.joint(0), strict=True):
        np.testing.assert_array_equal(old, new)


def test_overflow_and_unusable_returns_are_counted():
    estimator = known_map()
    estimator.update(scan_of((2.0, 1.0, 5), (2.0, -1.0, 6), (np.nan, 0.0, 4), (2.0, 0.0, UNKNOWN)))
    assert estimator.counts["overflow"][0] == 1
    assert estimator.counts["dropped"][0] == 2


def test_a_new_landmark_seen_twice_in_one_sweep():
    estimator = known_map()
    estimator.update(scan_of((2.0, 1.0, 5), (2.0, 1.0, 5)))
    assert estimator.count[0] == 2
    assert estimator.counts["dropped"][0] == 1


def test_the_point_at_the_robot_itself_is_skipped():
    estimator = known_map()
    estimator.mu[0, 3:5] = 0.0
    estimator.update(scan_of((1.0, 0.0, 4)))
    assert estimator.counts["not_positive"][0] == 1
    assert np.isfinite(estimator.joint(0)[0]).all()


def test_ids_by_order_of_creation_without_labels():
    estimator = EKF(MotionModel(), SensorModel(), None, max_landmarks=4, association="nearest")
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    for _ in range(3):
        estimator.update(scan_of((3.0, 0.0, UNKNOWN), (3.0, 1.0, UNKNOWN)))
    assert estimator.belief.landmark_id[0].tolist() == [0, 1, -1, -1]


def test_first_sighting_of_a_constant_velocity_target():
    model = TargetModel(initial_speed_std=0.7)
    estimator = known_map(target=model)
    estimator.update(scan_of((2.0, 0.5, TARGET)))
    belief = estimator.belief
    assert belief.target_known[0]
    np.testing.assert_allclose(belief.target_mean[0], [2 * np.cos(0.5), 2 * np.sin(0.5), 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(belief.target_velocity_cov[0], 0.49 * np.eye(2))
    # Seen in the robot's frame the pose's own error drops out: only the return's noise is left.
    noise = np.diag([0.05**2, (2.0 * 0.03) ** 2])
    turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    np.testing.assert_allclose(belief.target_rel_cov[0], turn @ noise @ turn.T, rtol=1e-6)


def test_an_impossible_return_starts_the_target_anew():
    estimator = known_map(target=TargetModel(reinitialise_nis=30.0, initial_speed_std=0.1))
    estimator.update(scan_of((2.0, 0.5, TARGET)))
    estimator.update(scan_of((2.0, -1.5, TARGET)))
    assert estimator.counts["reinitialised"][0] == 1
    np.testing.assert_allclose(estimator.belief.target_mean[0, :2], [2 * np.cos(1.5), -2 * np.sin(1.5)], atol=1e-6)


@pytest.mark.parametrize(("speed", "turn_rate"), [(1.0, 0.6), (-1.0, 0.0), (1.0, 0.0)])
def test_twist_target_starts_from_two_sightings(speed, turn_rate):
    model = TargetModel(kind="twist", speed=speed, turn_rate=turn_rate, speed_std=0.0, turn_std=0.0)
    estimator = EKF(MotionModel(speed_std=0.0, turn_std=0.0), SensorModel(), model, max_landmarks=1, **CHORD)
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    x, y, heading = 2.0, 1.0, -2.0
    estimator.update(scan_of((np.hypot(x, y), np.arctan2(y, x), TARGET)))
    assert not estimator.belief.target_known[0]
    for _ in range(8):
        heading += turn_rate * 0.1
        x, y = x + speed * 0.1 * np.cos(heading), y + speed * 0.1 * np.sin(heading)
        estimator.predict(np.zeros((1, 2)), 0.1)
    estimator.update(scan_of((np.hypot(x, y), np.arctan2(y, x), TARGET)))
    assert estimator.belief.target_known[0]
    gap = estimator.belief.target_mean[0] - [x, y, heading]
    np.testing.assert_allclose((gap + np.pi) % (2 * np.pi) - np.pi, 0.0, atol=1e-9)


def test_heading_of_the_chord_against_sampling():
    """Joint covariance after two sightings, the robot uncertain too, against draws of the same two returns."""
    rng, draws = np.random.default_rng(1), 40_000
    model = TargetModel(kind="twist", speed=1.0, turn_rate=0.0, speed_std=0.0, turn_std=0.0)
    sensor, pose_cov = SensorModel(range_std=0.02, bearing_std=0.005), np.diag([0.01, 0.01, 4e-4])
    estimator = EKF(MotionModel(speed_std=0.0, turn_std=0.0), sensor, model, max_landmarks=1, **CHORD)
    estimator.reset(np.zeros(3), pose_cov, seeds=[0])
    estimator.update(scan_of((3.0, 0.2, TARGET)))
    for _ in range(10):
        estimator.predict(np.zeros((1, 2)), 0.1)
    estimator.update(scan_of((2.5, 0.5, TARGET)))
    pose = rng.multivariate_normal(np.zeros(3), pose_cov, draws)
    ends = []
    for distance, bearing in ((3.0, 0.2), (2.5, 0.5)):
        r = distance + 0.02 * rng.standard_normal(draws)
        angle = pose[:, 2] + bearing + 0.005 * rng.standard_normal(draws)
        ends.append(pose[:, :2] + r[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))
    chord = ends[1] - ends[0]
    sampled = np.cov(np.column_stack([pose, ends[1], np.arctan2(chord[:, 1], chord[:, 0])]).T)
    deviations = np.sqrt(np.diag(sampled))
    np.testing.assert_allclose(estimator.P[0, :6, :6] / np.outer(deviations, deviations),
                               sampled / np.outer(deviations, deviations), atol=0.03)  # fmt: skip


def test_a_target_that_does_not_move_starts_in_the_end():
    model = TargetModel(kind="twist", speed=0.0, turn_rate=0.0)
    estimator = EKF(MotionModel(), SensorModel(), model, max_landmarks=1, **CHORD)
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    rng = np.random.default_rng(0)
    for _ in range(25):
        estimator.predict(np.zeros((1, 2)), 0.1)
        estimator.update(scan_of((2.0 + 0.05 * rng.standard_normal(), 0.03 * rng.standard_normal(), TARGET)))
    assert estimator.belief.target_known[0]
    assert np.isfinite(estimator.joint(0)[1]).all()


def test_order_of_lanes_and_threads_of_control_do_not_matter(recording):
    forward, backward = (EKF(MOTION, SENSOR, TARGET_MODEL, num_lanes=2, max_landmarks=8) for _ in range(2))
    for estimator, lanes in ((forward, np.array([0, 1])), (backward, np.array([1, 0]))):
        start(estimator, recording)
        feed(estimator, recording, lanes=lanes)
    np.testing.assert_array_equal(forward.mu, backward.mu)
    np.testing.assert_array_equal(forward.P, backward.P)


def test_covariance_stays_exactly_symmetric(recording):
    estimator = EKF(MOTION, SENSOR, TARGET_MODEL, num_lanes=2, max_landmarks=8)
    start(estimator, recording)
    feed(estimator, recording)
    np.testing.assert_array_equal(estimator.P, np.swapaxes(estimator.P, 1, 2))
