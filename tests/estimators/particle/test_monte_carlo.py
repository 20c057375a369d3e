"""The world of Wu and Sun 2013 in NumPy, many runs at once, for all filters the same: their experiment 1, and a gap."""

import numpy as np
import pytest

from estimators.interface import TARGET, Scan
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.registry import make

pytestmark = pytest.mark.slow

MOTION = MotionModel(speed_std=0.4, turn_std=0.0872)
SENSOR = SensorModel(max_range=7.0, field_of_view=np.pi, range_std=0.1, bearing_std=0.008)
TARGET_MODEL = TargetModel(kind="twist", speed=3.0, turn_rate=1.0, speed_std=0.8, turn_std=0.6)
DT, STEPS, EVERY, LANDMARKS = 0.02, 320, 8, 20


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def move(state, v, w):
    heading = state[:, 2] + w * DT
    return np.column_stack([state[:, 0] + v * DT * np.cos(heading), state[:, 1] + v * DT * np.sin(heading), heading])


def on_the_circle(angle):
    """A circle of 3 m about the middle of the arena of 10 x 10 m, driven anticlockwise."""
    return np.column_stack([5.0 + 3.0 * np.cos(angle), 5.0 + 3.0 * np.sin(angle), wrap(angle + np.pi / 2)])


def follow(robot, target):
    """Towards the target, 1.5 m behind it."""
    away = target[:, :2] - robot[:, :2]
    bearing = wrap(np.arctan2(away[:, 1], away[:, 0]) - robot[:, 2])
    speed = 3.0 + 4.0 * (np.hypot(away[:, 0], away[:, 1]) - 1.5)
    return np.column_stack([np.clip(speed, 0.0, 4.0), np.clip(4.0 * bearing, -2.0, 2.0)])


def sweep(robot, target, landmarks, rng, *, hidden=False):
    points = np.concatenate([landmarks, target[:, None, :2]], axis=1)
    away = points - robot[:, None, :2]
    r = np.hypot(away[..., 0], away[..., 1])
    b = wrap(np.arctan2(away[..., 1], away[..., 0]) - robot[:, 2:])
    seen = (r < 7.0) & (abs(b) < np.pi / 2)
    seen[:, -1] &= not hidden
    order = np.argsort(~seen, axis=1, kind="stable")
    scan = Scan.empty(*r.shape)
    scan.count[:] = seen.sum(axis=1)
    scan.ranges[:] = np.take_along_axis(r + 0.1 * rng.standard_normal(r.shape), order, 1)
    scan.bearings[:] = np.take_along_axis(wrap(b + 0.008 * rng.standard_normal(r.shape)), order, 1)
    scan.labels[:] = np.append(np.arange(LANDMARKS), TARGET)[order]
    return scan


FILTERS = {
    "slamto": ("slamto", {"particles": 200}),
    "fastslam1": ("fastslam1", {"particles": 200}),
    "fastslam2-20": ("fastslam2", {"particles": 20}),
    "fastslam2": ("fastslam2", {"particles": 200}),
    "fastslam2-50": ("fastslam2", {"particles": 50}),
    "rbpf-50": ("rbpf", {"particles": 50}),
}


def nees(error, cov):
    return np.einsum("li,li->l", error, np.linalg.solve(cov, error[..., None])[..., 0])


def inside(values, low, high):
    return ((values > low) & (values < high)).mean()


@pytest.fixture(scope="module")
def experiment():
    """By filter: robot's and target's position error, the pose's and the target's NEES, each [steps, runs]."""
    runs, rng = 400, np.random.default_rng(0)
    landmarks = rng.uniform(0.0, 10.0, (runs, LANDMARKS, 2))
    angle = rng.uniform(-np.pi, np.pi, runs)
    target, robot = on_the_circle(angle), on_the_circle(angle - 4.0 / 3.0)
    filters, results = {}, {name: [] for name in FILTERS}
    for name, (estimator, options) in FILTERS.items():
        filters[name] = make(
            estimator, MOTION, SENSOR, TARGET_MODEL, num_lanes=runs, max_landmarks=LANDMARKS, **options
        )
        filters[name].reset(robot, np.zeros((3, 3)), seeds=np.arange(runs), target=target, target_cov=np.zeros((3, 3)))
    for step in range(1, STEPS + 1):
        control = follow(robot, target)
        robot = move(robot, *(control + [0.4, 0.0872] * rng.standard_normal((runs, 2))).T)
        target = move(target, *([3.0, 1.0] + [0.8, 0.6] * rng.standard_normal((runs, 2))).T)
        scan = sweep(robot, target, landmarks, rng) if step % EVERY == 0 else None
        for name, f in filters.items():
            f.predict(control, DT)
            if scan is not None:
                f.update(scan)
            e, d = f.belief.pose - robot, f.belief.target_position - target[:, :2]
            e[:, 2] = wrap(e[:, 2])
            pose_nees = nees(e, f.belief.pose_cov + 1e-9 * np.eye(3))
            errors = np.hypot(*e[:, :2].T), np.hypot(*d.T)
            results[name].append([*errors, pose_nees, nees(d, f.belief.target_position_cov)])
    return {name: np.moveaxis(np.array(rows), 1, 0) for name, rows in results.items()}


def test_errors_of_experiment_1(experiment):
    robot, target, _, _ = experiment["slamto"]
    assert 0.036 < robot.mean() < 0.044
    assert 0.063 < target.mean() < 0.073


def test_the_target_is_nearly_consistent_and_the_pose_known_to_be_overconfident(experiment):
    _, _, pose, target = experiment["slamto"]
    assert 0.82 < inside(target, 0.0506, 7.378) < 0.93
    assert inside(pose, 0.2158, 9.348) < 0.75


def test_fastslam2_with_200_particles_is_accurate_and_nearly_consistent(experiment):
    robot, target, pose_nees, target_nees = experiment["fastslam2"]
    assert robot.mean() <= 0.037
    assert target.mean() <= 0.067
    assert inside(pose_nees, 0.2158, 9.348) >= 0.85
    assert inside(target_nees, 0.0506, 7.378) >= 0.92


@pytest.mark.parametrize("baseline", ["slamto", "fastslam1"])
def test_fastslam2_with_20_particles_is_not_worse_than_fastslam1_with_200(experiment, baseline):
    """The 95 % interval of the paired difference excludes any loss above a tenth of the error."""
    for few, many in zip(experiment["fastslam2-20"][:2], experiment[baseline][:2], strict=True):
        difference = (few - many).mean(axis=0)
        assert difference.mean() + 1.96 * difference.std() / np.sqrt(difference.size) < 0.1 * many.mean()


def test_the_improved_proposal_does_what_fastslam2_does_at_equal_particles(experiment):
    """Paired differences of both errors: the 95 % interval lies within a tenth of the error on either side."""
    for sampled, gaussian in zip(experiment["rbpf-50"][:2], experiment["fastslam2-50"][:2], strict=True):
        difference = (sampled - gaussian).mean(axis=0)
        half = 1.96 * difference.std() / np.sqrt(difference.size)
        assert abs(difference.mean()) + half < 0.1 * gaussian.mean()
    assert (
        abs(inside(experiment["rbpf-50"][2], 0.2158, 9.348) - inside(experiment["fastslam2-50"][2], 0.2158, 9.348))
        < 0.03
    )


GAP = {
    "ekf": ("ekf", {}),
    "slamto": ("slamto", {}),
    "slamto-8-islands": ("slamto", {"islands": 8}),
    "slamto-islands": ("slamto", {"islands": 20}),
    "fastslam2": ("fastslam2", {}),
    "fastslam2-islands": ("fastslam2", {"islands": 20}),
}
SEEN, HIDDEN, SEEN_AGAIN = 20, 80, 12  # sweeps


@pytest.fixture(scope="module")
def after_a_gap():
    """By filter, over the sweeps after the gap: NEES of pose and target, and of the target in the robot's frame."""
    runs, rng = 200, np.random.default_rng(1)
    landmarks = rng.uniform(0.0, 10.0, (runs, LANDMARKS, 2))
    angle = rng.uniform(-np.pi, np.pi, runs)
    target, robot = on_the_circle(angle), on_the_circle(angle - 4.0 / 3.0)
    filters, results = {}, {name: [] for name in GAP}
    for name, (estimator, options) in GAP.items():
        filters[name] = make(
            estimator, MOTION, SENSOR, TARGET_MODEL, num_lanes=runs, max_landmarks=LANDMARKS, **options
        )
        filters[name].reset(robot, np.zeros((3, 3)), seeds=np.arange(runs), target=target, target_cov=np.zeros((3, 3)))
    for step in range(1, EVERY * (SEEN + HIDDEN + SEEN_AGAIN) + 1):
        control = follow(robot, target)
        robot = move(robot, *(control + [0.4, 0.0872] * rng.standard_normal((runs, 2))).T)
        target = move(target, *([3.0, 1.0] + [0.8, 0.6] * rng.standard_normal((runs, 2))).T)
        number = step // EVERY
        scan = None
        if step % EVERY == 0:
            scan = sweep(robot, target, landmarks, rng, hidden=SEEN < number <= SEEN + HIDDEN)
        for name, f in filters.items():
            f.predict(control, DT)
            if scan is not None:
                f.update(scan)
            if scan is not None and number > SEEN + HIDDEN:
                e, d = f.belief.pose - robot, f.belief.target_position - target[:, :2]
                e[:, 2] = wrap(e[:, 2])
                c, s, away = np.cos(robot[:, 2]), np.sin(robot[:, 2]), target[:, :2] - robot[:, :2]
                away = np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], -1)
                results[name].append([
                    nees(e, f.belief.pose_cov), nees(d, f.belief.target_position_cov),
                    nees(f.belief.target_rel - away, f.belief.target_rel_cov),
                ])  # fmt: skip
    found = {name: np.moveaxis(np.array(rows), 1, 0) for name, rows in results.items()}
    print({name: np.round(values.mean(axis=(1, 2)), 2).tolist() for name, values in found.items()})
    return found


@pytest.mark.parametrize("name", list(GAP))
def test_a_target_out_of_sight_for_80_sweeps_is_found_as_the_filter_expects_it_from_the_robot(after_a_gap, name):
    """NEES of two dimensions; the target's own filter is honest in every particle."""
    relative = after_a_gap[name][2]
    assert 1.5 < relative.mean() < 2.5


@pytest.mark.parametrize("name", ["ekf", "slamto-islands", "fastslam2-islands"])
def test_and_in_the_world_where_the_pose_is_known_as_well_as_the_filter_says(after_a_gap, name):
    pose, target, _ = after_a_gap[name]
    assert 1.5 < target.mean() <= 2.5
    assert pose.mean() < 4.0


def test_one_cloud_that_resamples_as_a_whole_has_lost_its_pose_by_then(after_a_gap):
    """What the islands mend: in 100 sweeps the particles have come to share one past."""
    pose, target, _ = after_a_gap["slamto"]
    assert np.median(pose) > 15.0
    assert target.mean() > 5.0
