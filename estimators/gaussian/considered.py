"""A pose that an update does not touch, though its uncertainty counts: Schmidt's "considered" state."""

from estimators.kernels.gaussian import ROBOT
from estimators.kernels.jit import inline


@inline
def keep_pose(mu, P, lane, kept):
    """Copy pose and pose covariance of a lane into `kept` [4, 3]."""
    for i in range(ROBOT):
        kept[3, i] = mu[lane, i]
        for k in range(ROBOT):
            kept[i, k] = P[lane, i, k]


@inline
def put_pose_back(mu, P, lane, kept):
    """Undo what an update did to the pose, but not to the target's covariance with it: Schmidt's update."""
    for i in range(ROBOT):
        mu[lane, i] = kept[3, i]
        for k in range(ROBOT):
            P[lane, i, k] = kept[i, k]
