"""New points of linearisation for an FEJ filter, where the estimate has been torn away from the old ones.

An outlier that is believed can move the estimate by many metres. From the old points the next returns then look as if
the heading could explain them, each correction makes it worse, and the filter runs away. So there it linearises at the
present estimate again, as an EKF does always: it gains a little heading out of nothing once, and stays sane.
"""

from estimators.kernels.gaussian import ROBOT
from estimators.kernels.jit import inline

STALE = 20.0  # shift of a point against the robot since its linearisation, by its distance, above which it is renewed
ROUGH_NIS = 100.0  # of a return that was believed (2 dof; a consistent belief sees one in 1e21), and
TORN = 0.5  # such a shift after it
A_T = 2  # where the target's state begins in `anchor`, see `fej`


@inline
def linear_point(lane, slot, is_target, first, anchor):
    """Where the target, or the landmark of a slot, is linearised."""
    if is_target:
        return anchor[lane, A_T], anchor[lane, A_T + 1]
    return first[lane, slot, 0], first[lane, slot, 1]


@inline
def has_shifted(mu, lane, j, anchor, first_x, first_y, share):
    """Whether a point has moved against the robot, since both were linearised, by that share of its distance."""
    dx, dy = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1]
    off_x, off_y = first_x - anchor[lane, 0] - dx, first_y - anchor[lane, 1] - dy
    return off_x * off_x + off_y * off_y > share * share * (dx * dx + dy * dy)


@inline
def renew(mu, lane, n_t, count, first, anchor):
    """Linearise robot, target and all landmarks of a lane at their present estimates from now on."""
    anchor[lane, 0], anchor[lane, 1] = mu[lane, 0], mu[lane, 1]
    for i in range(n_t):
        anchor[lane, A_T + i] = mu[lane, ROBOT + i]
    for slot in range(count):
        j = ROBOT + n_t + 2 * slot
        first[lane, slot, 0], first[lane, slot, 1] = mu[lane, j], mu[lane, j + 1]
