"""Moments of a weighted cloud against NumPy, and where one particle has nearly all the weight."""

import numpy as np
import pytest

from estimators.particle.moments import pose_moments, target_moments


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
