"""Moments of a weighted cloud against NumPy, and where one particle has nearly all the weight."""

import numpy as np
import pytest

from estimators.particle.moments import (
    pose_moments,
    relative_mean,
    relative_origin,
    relative_spread,
    target_moments,
    write_relative,
)


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def pose_cloud(poses, w):
    mean, cov = np.zeros(3), np.zeros((3, 3))
    pose_moments(poses, np.zeros((0, len(w))), w, np.cos(poses[2]), np.sin(poses[2]), mean, cov)
    return mean, cov


def twist_cloud(target, w):
    mean, cov = np.zeros(3), np.zeros((3, 3))
    target_moments(target[None], 1, w[None], True, np.zeros((4, len(w))), mean, cov)
    return mean, cov


def numpy_moments(poses, w):
    centre = np.arctan2(w @ np.sin(poses[2]), w @ np.cos(poses[2]))
    straight = np.vstack([poses[:2], wrap(poses[2] - centre)])
    mean = straight @ w
    away = straight - mean[:, None]
    mean[2] = wrap(mean[2] + centre)
    return mean, (w * away) @ away.T


@pytest.fixture
def cloud():
    """Poses about a heading beside the cut, with weights."""
    rng = np.random.default_rng(3)
    poses = rng.standard_normal((3, 40))
    poses[2] = wrap(3.0 + 0.4 * poses[2])
    w = rng.exponential(size=40)
    return poses, w / w.sum()


def test_of_poses_and_of_a_twist_target(cloud):
    poses, w = cloud
    mean, cov = numpy_moments(poses, w)
    target = np.vstack([poses, np.zeros((6, 40))])
    for found_mean, found_cov in (pose_cloud(poses, w), twist_cloud(target, w)):
        np.testing.assert_allclose(found_mean, mean, atol=1e-12)
        np.testing.assert_allclose(found_cov, cov, atol=1e-12)


@pytest.mark.parametrize("least", [1e-18, 1e-40, 1e-155])
def test_a_covariance_stays_one_however_little_the_other_weighs(least):
    """Of two particles: of a rounding error of the mean direction nothing may be left that outweighs the small one."""
    rng, w = np.random.default_rng(3), np.array([1.0 - least, least])
    for poses in rng.standard_normal((500, 3, 2)):
        poses[2] = wrap(3.0 * poses[2])
        target = np.vstack([poses, np.zeros((6, 2))])
        for _, cov in (pose_cloud(poses, w), twist_cloud(target, w)):
            assert np.linalg.eigvalsh(cov / np.abs(cov).max())[0] > -1e-12


def relative_cloud(poses, points, covs, w, pose_cov=None):
    """Mean [2] and covariance [2, 2] of a point [2, N], with covariances [3, N], in each particle's frame."""
    pose_cov = np.zeros((0, len(w))) if pose_cov is None else pose_cov
    mean, cov = np.zeros(2), np.zeros((2, 2))
    c, s = np.cos(poses[2]), np.sin(poses[2])
    x, y = relative_origin(points[0, 0], points[1, 0], poses, c, s)
    a, b = relative_mean(*points, w, poses, c, s, x, y)
    spread = relative_spread(*points, *covs, w, poses, pose_cov, c, s, x + a, y + b)
    write_relative(x + a, y + b, *spread, mean, cov)
    return mean, cov


def test_of_a_point_in_each_particles_frame(cloud):
    poses, w = cloud
    rng = np.random.default_rng(4)
    points, covs = rng.standard_normal((2, 40)), np.array([[0.3], [0.1], [0.2]]) * np.ones(40)
    turn = np.array([[np.cos(poses[2]), np.sin(poses[2])], [-np.sin(poses[2]), np.cos(poses[2])]])
    seen = np.einsum("ijn,jn->in", turn, points - poses[:2])
    own = np.einsum("ijn,jk,lkn,n->il", turn, np.array([[0.3, 0.1], [0.1, 0.2]]), turn, w)
    away = seen - (seen @ w)[:, None]
    mean, cov = relative_cloud(poses, points, covs, w)
    np.testing.assert_allclose(mean, seen @ w, atol=1e-12)
    np.testing.assert_allclose(cov, (w * away) @ away.T + own, atol=1e-12)


def test_an_uncertain_pose_adds_what_it_makes_of_the_point(cloud):
    """J P J', J the derivative of R(-h) (point - position) by position and heading."""
    poses, w = cloud
    rng = np.random.default_rng(6)
    points, root = rng.standard_normal((2, 40)), rng.standard_normal((3, 3))
    P = root @ root.T
    rows = np.repeat(P[np.triu_indices(3)][:, None], 40, axis=1)
    extra = np.zeros((2, 2))
    for p in range(40):
        c, s = np.cos(poses[2, p]), np.sin(poses[2, p])
        u, v = np.array([[c, s], [-s, c]]) @ (points[:, p] - poses[:2, p])
        J = np.array([[-c, -s, v], [s, -c, -u]])
        extra += w[p] * J @ P @ J.T
    plain, known = np.zeros((3, 40)), relative_cloud(poses, points, np.zeros((3, 40)), w)
    mean, cov = relative_cloud(poses, points, plain, w, rows)
    np.testing.assert_array_equal(mean, known[0])
    np.testing.assert_allclose(cov, known[1] + extra, atol=1e-12)


def test_a_relative_covariance_keeps_its_digits_though_the_first_particle_is_far_away():
    """It has next to no weight: what it sees is no part of the spread of the others, ten micrometres."""
    rng, w = np.random.default_rng(5), np.array([1e-300, *np.full(20, 0.05)])
    poses, points = np.zeros((3, 21)), 1e-5 * rng.standard_normal((2, 21))
    points[:, 0] = 1e4
    _, cov = relative_cloud(poses, points, np.zeros((3, 21)), w)
    expected = np.cov(points[:, 1:], bias=True)
    np.testing.assert_allclose(cov, expected, rtol=1e-6)
