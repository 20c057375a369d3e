"""The target cloud's kernels against NumPy: where the sensor looks, Bayes' rule, resampling, motion."""

import math

import numpy as np
import pytest

import estimators
from estimators import MotionModel, Scan, SensorModel, TargetModel
from estimators.kernels.cloud_evidence import detection, resample, weigh
from estimators.kernels.cloud_motion import COSINE, ROWS, SINE, SPEED, X, Y, draw_anywhere, move_points
from estimators.kernels.jit import jit
from estimators.kernels.random import lane_key
from estimators.models import pack_models
from estimators.target_cloud import TargetCloud

KEY = lane_key(5)
SETTINGS = (10.0, 8.0, 12.0, 0.25, 0.0, 0.0, 0.02, 0.5)  # see `cloud_motion`
OPEN = (math.inf, math.inf, 12.0, 0.0, 0.0, 0.0, 0.02, 0.5)
SENSOR = SensorModel(max_range=6.0, field_of_view=2.0, detection_probability=0.9, landmark_radius=0.5)


@jit
def _detection(x, y, pose, pose_cov, models, mapped, landmark, landmark_cov, out):
    detection(0, x, y, pose, pose_cov, models[0], mapped, landmark, landmark_cov, out)


@jit
def _weigh(w, p_d, settings):
    return weigh(w, p_d, settings)


@jit
def _move(rows, noise, key, step, models, dt, settings):
    move_points(rows, noise, key, step, models[0], dt, settings)


@jit
def _anywhere(rows, key, models, settings):
    for p in range(rows.shape[1]):
        draw_anywhere(p, rows, key, 0, models[0], 0.0, 0.0, settings)


@jit
def _resample(rows, w, key, models, settings, whole):
    resample(rows, w, key, 3, models[0], 0.0, 0.0, settings, whole[0], whole[1], whole[2])


def _models(sensor=SENSOR, target=None):
    return np.array([pack_models(MotionModel(), sensor, target or TargetModel())])


def _seen(points, pose_cov=None, pillars=((3.0, 0.5),), landmark_cov=0.0):
    """Detection probability from (1, -1) facing along +y; `pillars` in the robot's frame."""
    x, y = np.ascontiguousarray(points.T)
    out = np.zeros(len(x))
    marks = np.array([pillars], dtype=float)
    cov = np.zeros((1, 3, 3)) if pose_cov is None else np.array([pose_cov])
    _detection(
        x, y, np.array([[1.0, -1.0, 0.5 * math.pi]]), cov, _models(), np.ones(marks.shape[:2], dtype=np.bool_), marks,
        np.tile(landmark_cov * np.eye(2), (*marks.shape[:2], 1, 1)), out,
    )  # fmt: skip
    return out


def test_a_sharp_sensor_sees_what_geometry_says():
    points = np.random.default_rng(0).uniform(-8.0, 8.0, (4000, 2))
    dx, dy = points[:, 1] + 1.0, -(points[:, 0] - 1.0)  # in the robot's frame: it looks along +y
    r = np.hypot(dx, dy)
    pillar = np.array([3.0, 0.5])
    share = np.clip((dx * pillar[0] + dy * pillar[1]) / r**2, 0.0, 1.0)  # nearest place of the line of sight
    gap = np.hypot(share * dx - pillar[0], share * dy - pillar[1])
    visible = (r < 6.0) & (np.abs(np.arctan2(dy, dx)) < 1.0) & (gap > 0.5)
    sharp = (np.abs(r - 6.0) > 0.01) & (np.abs(np.abs(np.arctan2(dy, dx)) - 1.0) > 0.01) & (np.abs(gap - 0.5) > 0.01)
    assert np.allclose(_seen(points)[sharp], 0.9 * visible[sharp])
    assert 0.02 < visible.mean() < 0.5


@pytest.mark.parametrize("cov", [np.diag([0.04, 0.04, 0.0]), np.diag([0.0, 0.0, 0.01])])
def test_soft_edges_are_the_mean_over_uncertain_poses(cov):
    """Against sampling of the pose, with errors as the kernel takes them: uniform with the believed deviation."""
    points = np.array([[1.0, 4.9], [1.0, 5.1], [1.0 + 4.0 * math.sin(0.95), -1.0 + 4.0 * math.cos(0.95)], [1.0, 2.0]])
    draws = math.sqrt(3.0) * np.random.default_rng(1).uniform(-1.0, 1.0, (40000, 3)) * np.sqrt(np.diag(cov))
    expected = []
    for point in points:
        offset = point - [1.0, -1.0] - draws[:, :2]
        off = np.arctan2(offset[:, 1], offset[:, 0]) - 0.5 * math.pi - draws[:, 2]
        expected.append(0.9 * np.mean((np.hypot(*offset.T) < 6.0) & (np.abs(off) < 1.0)))
    assert np.allclose(_seen(points, cov, pillars=((-3.0, 0.0),)), expected, atol=0.06)


def test_an_uncertain_pillar_hides_with_less_certainty():
    behind = np.array([[1.0, 4.0]])
    assert _seen(behind, pillars=((3.0, 0.0),))[0] == 0.0
    assert 0.0 < _seen(behind, pillars=((3.0, 0.0),), landmark_cov=0.25)[0] < 0.9


def test_weights_follow_bayes_and_never_vanish():
    p_d = np.array([0.0, 0.5, 0.9, 1.0])
    w = np.array([0.1, 0.2, 0.3, 0.4])
    expected = w * np.maximum(1.0 - p_d, 0.02)
    expected /= expected.sum()
    assert _weigh(w, p_d, SETTINGS) == pytest.approx(1.0 / (expected**2).sum())
    assert np.allclose(w, expected)


def test_resampling_keeps_the_mean_and_roughens_copies_alone():
    rng = np.random.default_rng(2)
    rows, w = rng.standard_normal((ROWS, 4000)), rng.random(4000) ** 4
    w /= w.sum()
    mean, before = rows[:2] @ w, rows[X].copy()
    settings = (*OPEN[:5], 0.5, *OPEN[6:])
    _resample(rows, w, KEY, _models(), settings, np.zeros((3, 4000), dtype=np.int64))
    assert np.all(w == 1.0 / 4000)
    assert np.allclose(rows[:2].mean(axis=1), mean, atol=0.05)
    assert np.isin(rows[X], before).mean() > 0.2  # those that stay are not moved
    assert len(np.unique(rows[X])) == 4000


def test_a_lost_point_keeps_its_speed_and_turns_at_the_rate():
    rows, noise = np.zeros((ROWS, 20000)), np.zeros((3, 20000))
    rows[COSINE], rows[SPEED] = 1.0, 0.8
    still = _models(target=TargetModel(acceleration_density=0.0))
    for step in range(20):
        _move(rows, noise, KEY, step, still, 0.1, SETTINGS)
    assert np.allclose(rows[SPEED], 0.8)
    assert np.allclose(np.hypot(rows[COSINE], rows[SINE]), 1.0)
    straight = np.abs(rows[SINE]) < 1e-12
    assert straight.mean() == pytest.approx(math.exp(-0.25 * 2.0), abs=0.01)
    assert np.allclose(rows[X][straight], 1.6)


def test_a_constant_velocity_point_has_the_models_variance():
    rows, noise = np.zeros((ROWS, 20000)), np.zeros((3, 20000))
    rows[COSINE], rows[SPEED] = 1.0, 0.8
    for step in range(50):
        _move(rows, noise, KEY, step, _models(), 0.1, OPEN)
    velocity = rows[SPEED] * rows[[COSINE, SINE]]
    assert np.allclose(velocity.mean(axis=1), [0.8, 0.0], atol=0.03)
    assert np.allclose(velocity.var(axis=1), 0.3**2 * 5.0, rtol=0.05)
    steps = np.arange(50)
    assert np.allclose(rows[:2].var(axis=1), 0.3**2 * 0.1**3 * np.sum(steps**2), rtol=0.05)


def test_a_twist_point_drives_the_circle_of_its_model():
    rows, noise = np.zeros((ROWS, 4)), np.zeros((3, 4))
    rows[COSINE], rows[SPEED] = 1.0, 0.5
    model = TargetModel(kind="twist", speed=0.5, turn_rate=0.4, speed_std=0.0, turn_std=0.0)
    for step in range(30):
        _move(rows, noise, KEY, step, _models(target=model), 0.1, OPEN)
    angles = 0.04 * np.arange(1, 31)
    assert np.allclose(rows[X], 0.05 * np.cos(angles).sum())
    assert np.allclose(rows[Y], 0.05 * np.sin(angles).sum())


def test_points_stay_in_the_arena_and_without_one_begin_on_a_disc():
    rows, noise = np.zeros((ROWS, 2000)), np.zeros((3, 2000))
    _anywhere(rows, KEY, _models(), SETTINGS)
    for step in range(200):
        _move(rows, noise, KEY, step, _models(), 0.1, SETTINGS)
        assert np.abs(rows[X]).max() <= 10.5 and np.abs(rows[Y]).max() <= 8.5
    _anywhere(rows, KEY, _models(), OPEN)
    r = np.hypot(rows[X], rows[Y])
    assert r.max() <= 12.0
    assert np.mean(r < 6.0) == pytest.approx(0.25, abs=0.03)


def _run(num_lanes, seeds, kind="constant-velocity", restore_at=None):
    target = TargetModel(kind=kind, **({"speed": 0.5} if kind == "twist" else {}))
    estimator = estimators.make("ekf", MotionModel(), SENSOR, target, num_lanes=num_lanes, max_landmarks=4)
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=seeds)
    cloud = TargetCloud(estimator, 64, arena=(20.0, 20.0))
    cloud.reset(None, seeds)
    scan = Scan.empty(num_lanes, 4)
    for step in range(30):
        if step == restore_at:
            state, filtered = cloud.get_state(), estimator.get_state()
            cloud.reset(None, np.asarray(seeds) + 9)
            cloud.set_state(state)
            estimator.set_state(filtered)
        scan.count[:] = 1
        scan.ranges[:, 0], scan.bearings[:, 0] = 4.0, 0.1
        scan.labels[:, 0] = estimators.TARGET if 5 <= step < 10 else 0
        estimator.predict(np.tile([0.5, 0.3], (num_lanes, 1)), 0.1)
        cloud.predict(0.1)
        estimator.update(scan)
        cloud.update(scan)
    points, weights = estimator.belief.target_cloud
    return points.copy(), weights.copy()


@pytest.mark.parametrize("kind", ["constant-velocity", "twist"])
def test_lanes_equal_single_runs_bit_for_bit_and_states_are_restored(kind):
    points, weights = _run(3, [7, 8, 9], kind)
    again, weights_again = _run(3, [7, 8, 9], kind, restore_at=20)
    assert np.array_equal(points, again) and np.array_equal(weights, weights_again)
    for lane, seed in enumerate([7, 8, 9]):
        alone, weights_alone = _run(1, [seed], kind)
        assert np.array_equal(points[lane], alone[0]) and np.array_equal(weights[lane], weights_alone[0])
    assert not np.array_equal(points[0], points[1])
