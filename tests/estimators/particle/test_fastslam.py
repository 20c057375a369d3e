"""FastSLAM 2 against the textbook in NumPy, one particle at a time; FastSLAM 1 against SLAMTO."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from estimators._recording import MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.interface import TARGET, UNKNOWN
from estimators.models import MotionModel
from estimators.particle.fastslam import FastSLAM1, FastSLAM2
from estimators.particle.layout import DRAW_POSE
from estimators.particle.proposal import draw_normals
from estimators.particle.slamto import SLAMTO
from estimators.testing import checks

PRIOR_COV = np.array([[0.02, 0.004, 0.001], [0.004, 0.01, -0.002], [0.001, -0.002, 0.003]])


@pytest.mark.parametrize("check", checks("fastslam2"), ids=str)
def test_contract(check):
    check()


@pytest.mark.parametrize("check", checks("fastslam2", association="nearest"), ids=str)
def test_contract_with_unknown_association(check):
    check()


def test_fastslam1_is_slamto_resampled_at_every_update():
    recording, filters = record(2, 12), {}
    options = {"num_lanes": 2, "max_landmarks": 12, "particles": 31}
    for name, cls, extra in (("slamto", SLAMTO, {}), ("same", FastSLAM1, {"resample_threshold": 0.5}),
                             ("default", FastSLAM1, {})):  # fmt: skip
        filters[name] = cls(MOTION, SENSOR, TARGET_MODEL, **options, **extra)
        start(filters[name], recording)
        feed(filters[name], recording)
    np.testing.assert_array_equal(filters["same"].belief.pose, filters["slamto"].belief.pose)
    np.testing.assert_array_equal(filters["same"].belief.landmark_cov, filters["slamto"].belief.landmark_cov)
    assert (filters["default"].counts["resampled"] > filters["slamto"].counts["resampled"]).all()


def full(rows, p):
    """[3, 3] from the upper triangle of one particle's covariance."""
    cov = np.zeros((3, 3))
    cov[np.triu_indices(3)] = rows[:, p]
    return cov + np.triu(cov, 1).T


def moved(model, pose, control, dt):
    v, w = control
    if model.kind == "bicycle":
        return pose + v * dt * np.array([np.cos(pose[2] + w), np.sin(pose[2] + w), np.sin(w) / model.wheelbase])
    end = pose[2] + w * dt
    return pose + np.array([v * dt * np.cos(end), v * dt * np.sin(end), w * dt])


def jacobian(function, at, step=1e-6):
    columns = [(function(at + e) - function(at - e)) / (2 * step) for e in step * np.eye(len(at))]
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("kind", ["unicycle", "bicycle"])
def test_the_poses_covariance_grows_with_the_motion(make, kind):
    model = MotionModel(kind=kind, speed_std=0.4, turn_std=0.3, wheelbase=2.0)
    f = make(None, cls=FastSLAM2, motion=model, particles=3)
    mean, cov = np.array([1.0, 2.0, 3.0]), PRIOR_COV
    f.reset(mean, cov, seeds=[0])
    for control in (np.array([1.2, 0.5]), np.array([0.7, -0.3])):
        F = jacobian(lambda x, u=control: moved(model, x, u, 0.2), mean)
        G = jacobian(lambda u, x=mean: moved(model, x, u, 0.2), control)
        mean, cov = moved(model, mean, control, 0.2), F @ cov @ F.T + G @ np.diag([0.16, 0.09]) @ G.T
        f.predict(control[None], 0.2)
    mean[2] = (mean[2] + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(f.belief.pose[0], mean, atol=1e-12)
    np.testing.assert_allclose(f.belief.pose_cov[0], cov, atol=1e-9)


def textbook(oracle, state, p, returns):
    """Mean, covariance and log likelihood of one pose conditioned on the returns in their order."""
    mean, cov, log_likelihood = state["pose"][0, :, p].copy(), full(state["pose_cov"][0], p), 0.0
    for r, b, label in returns:
        column = state["target"][0, 0, :, p] if label == TARGET else state["maps"][0, label, :, p]
        point, point_cov = oracle.unpack(column, 4 if label == TARGET else 2)
        joint = np.zeros((5, 5))
        joint[:3, :3], joint[3:, 3:] = cov, point_cov[:2, :2]
        h, Hm = oracle.measurement(mean, point, 2)
        H = np.hstack([-Hm, [[0.0], [-1.0]], Hm])
        nu = np.array([r, b]) - h
        nu[1] = oracle.wrap(nu[1])
        S = H @ joint @ H.T + np.diag([(0.1 + 0.02 * r) ** 2, 0.05**2])
        K = joint @ H.T @ np.linalg.inv(S)
        mean, cov = mean + (K @ nu)[:3], (joint - K @ S @ K.T)[:3, :3]
        log_likelihood += multivariate_normal.logpdf(nu, cov=S)
    return mean, cov, log_likelihood


def drawn(state, mean, cov, p):
    """The draw that the filter makes from N(mean, cov)."""
    normals = np.empty((4, state["pose"].shape[2]))
    draw_normals(state["state"]["key"][0], state["state"]["step"][0], DRAW_POSE, normals)
    return mean + np.linalg.cholesky(cov) @ normals[:3, p]


@pytest.mark.parametrize(("association", "kind"), [("known", "constant-velocity"), ("nearest", None)])
def test_one_update_is_the_textbooks(make, oracle, association, kind):
    f = make(kind, cls=FastSLAM2, association=association, particles=12)
    prior, prior_cov = oracle.priors[kind] if kind else (None, None)
    f.reset(np.zeros(3), PRIOR_COV, seeds=[4], target=prior, target_cov=prior_cov)
    rng, target = np.random.default_rng(0), np.array([3.0, 1.0])
    labels = [TARGET, 0, 1, 2, 3] if kind else [0, 1, 2, 3]

    def look(pose):
        return sorted((r for r in oracle.sweep(pose, target, rng) if r[2] in labels), key=lambda r: r[2])

    f.update(oracle.scan_of(look(np.zeros(3))))
    f.predict(np.array([[1.0, 0.4]]), 0.1)
    f.predict(np.array([[1.0, 0.4]]), 0.1)
    before, returns = f.get_state(), look(np.array([0.2, 0.01, 0.08]))
    f.update(oracle.scan_of(returns))
    after, log_w = f.get_state(), before["log_w"][0].copy()
    for p in range(f.num_particles):
        mean, cov, log_likelihood = textbook(oracle, before, p, returns)
        log_w[p] += log_likelihood
        pose = drawn(before, mean, cov, p)
        np.testing.assert_allclose(after["pose"][0, :, p], pose, atol=1e-8)
        for r, b, label in returns:
            R = np.diag([(0.1 + 0.02 * r) ** 2, 0.05**2])
            name, slot, n = ("target", 0, 4) if label == TARGET else ("maps", label, 2)
            new = oracle.ekf_update(pose, *oracle.unpack(before[name][0, slot, :, p], n), np.array([r, b]), R)
            for got, expected in zip(oracle.unpack(after[name][0, slot, :, p], n), new[:2], strict=True):
                np.testing.assert_allclose(got, expected, atol=1e-7)
    np.testing.assert_allclose(after["log_w"][0], log_w - log_w.max(), atol=1e-8)
    assert not after["pose_cov"].any()


def robot_frame(pose, point):
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, s], [-s, c]]) @ (point - pose[:2])


def test_the_belief_between_sweeps_contains_each_poses_own_covariance(make, oracle):
    f = make("constant-velocity", cls=FastSLAM2)
    rng, target = np.random.default_rng(0), oracle.priors["constant-velocity"][0][:2]
    f.update(oracle.scan_of(oracle.sweep(np.zeros(3), target, rng)))
    for _ in range(4):
        f.predict(np.array([[1.0, 0.4]]), 0.2)
    state, belief = f.get_state(), f.belief
    w, poses = state["w"][0], state["pose"][0].T
    own = np.array([full(state["pose_cov"][0], p) for p in range(len(w))])
    mean = w @ poses
    d = poses - mean
    np.testing.assert_allclose(belief.pose[0], mean, atol=1e-12)
    np.testing.assert_allclose(
        belief.pose_cov[0], np.einsum("p,pij->ij", w, own + d[:, :, None] * d[:, None]), atol=1e-12
    )
    for column, n, got_mean, got_cov in (
        (state["target"][0, 0], 4, belief.target_rel[0], belief.target_rel_cov[0]),
        (state["maps"][0, 1], 2, belief.landmark_rel[0, 1], belief.landmark_rel_cov[0, 1]),
    ):
        means, covs = [], []
        for p, pose in enumerate(poses):
            point, point_cov = oracle.unpack(column[:, p], n)
            point = point[:2]
            A = jacobian(lambda x, m=point: robot_frame(x, m), pose)
            B = jacobian(lambda m, x=pose: robot_frame(x, m), point)
            means.append(robot_frame(pose, point))
            covs.append(A @ own[p] @ A.T + B @ point_cov[:2, :2] @ B.T)
        centre = w @ np.array(means)
        d = np.array(means) - centre
        np.testing.assert_allclose(got_mean, centre, atol=1e-11)
        np.testing.assert_allclose(got_cov, np.einsum("p,pij->ij", w, covs + d[:, :, None] * d[:, None]), atol=1e-8)


def test_an_empty_sweep_draws_nothing(make, oracle):
    f = make(None, cls=FastSLAM2)
    f.predict(np.array([[1.0, 0.4]]), 0.2)
    before = f.belief.pose_cov.copy()
    f.update(oracle.scan_of([]))
    f.update(oracle.scan_of([(2.0, 0.0, UNKNOWN)]))
    np.testing.assert_array_equal(f.belief.pose_cov, before)
    f.update(oracle.scan_of([(2.0, 0.0, 3)]))
    assert not f.get_state()["pose_cov"].any()
    assert np.ptp(f.belief.particles(0)[0][:, 0]) > 0.0


def test_a_known_pose_stays_known(make, oracle):
    f = make(None, cls=FastSLAM2, motion=MotionModel(speed_std=0.0, turn_std=0.0))
    f.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    for _ in range(3):
        f.predict(np.array([[1.0, 0.0]]), 0.1)
        f.update(oracle.scan_of([(2.0, 0.3, 0), (3.0, -0.4, 1)]))
    np.testing.assert_allclose(f.belief.particles(0)[0], np.tile([0.3, 0.0, 0.0], (30, 1)), atol=1e-15)


def test_odometry_of_rank_two_is_drawn_along_its_two_directions(make, oracle):
    f = make(None, cls=FastSLAM2, particles=4000, motion=MotionModel(speed_std=0.3, turn_std=0.0))
    f.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    f.predict(np.array([[1.0, 0.0]]), 0.1)
    f.update(oracle.scan_of([(2.0, 0.3, 0)]))
    pose = f.belief.particles(0)[0]
    assert pose[:, 0].std() == pytest.approx(0.03, rel=0.05)
    assert not pose[:, 1:].any()


def test_a_mislabelled_return_moves_nothing(make, oracle):
    f = make(None, cls=FastSLAM2, gate=14.0)
    f.update(oracle.scan_of([(2.8, 0.8, 0), (4.1, -0.3, 1)]))
    f.predict(np.array([[0.1, 0.0]]), 0.1)
    before = f.belief.landmark_mean.copy()
    f.update(oracle.scan_of([(4.1, -0.3, 0), (2.8, 0.8, 1)]))
    assert f.counts["gated"][0] == 2
    np.testing.assert_array_equal(f.belief.landmark_mean, before)


@pytest.mark.parametrize("association", ["known", "nearest"])
def test_lanes_are_single_runs_bit_for_bit(association):
    recording = record(3, 12, labelled=association == "known")
    options = {"particles": 31, "max_landmarks": 12, "association": association}
    together = FastSLAM2(MOTION, SENSOR, TARGET_MODEL, num_lanes=3, **options)
    start(together, recording)
    feed(together, recording)
    for lane in range(3):
        single = FastSLAM2(MOTION, SENSOR, TARGET_MODEL, **options)
        start(single, recording.lane(lane))
        feed(single, recording.lane(lane))
        for name in ("pose", "pose_cov", "target_mean", "landmark_mean", "landmark_rel_cov"):
            np.testing.assert_array_equal(getattr(single.belief, name)[0], getattr(together.belief, name)[lane])
