"""What enters the joint state: new landmarks, and the target at its first sightings.

Both keep the full cross covariance with everything else. A twist target's heading cannot be seen at the first
sighting, and a Gaussian as wide as the circle breaks every EKF; so the first return is held as a fixed point, and the
target starts at the sighting that makes the chord between the two points a usable heading.

`pending` [L, 4] describes the held point: sightings so far (0: nothing held), the displacement since then in the axes
of the target's present heading (two numbers), steps since then.
"""

import math

from estimators.gaussian.sweep import DROPPED_RETURN, OVERFLOW
from estimators.kernels.angles import wrap
from estimators.kernels.association import NEW, TARGET_SLOT, slot_of
from estimators.kernels.gaussian import ROBOT, append_point, clear_rows, innovation_cov, rows_in_use, shear
from estimators.kernels.jit import inline, subroutine
from estimators.kernels.range_bearing import noise_std, offset, offset_noise
from estimators.models import TWIST

MAX_HEADING_VARIANCE = 0.5**2  # [rad^2] of the chord, above which a twist target waits for a longer one
MAX_SIGHTINGS = 20  # after so many it starts whatever the chord is worth (a target that hardly moves)


@inline
def add_landmark(mu, P, lane, n_t, count, ids, first, label, dx, dy, g0, g1, n00, n01, n11):
    """A new landmark at offset (dx, dy) from the robot's mean, in the next free slot, which is returned."""
    slot = count[lane]
    count[lane] = slot + 1
    x, y = mu[lane, 0] + dx, mu[lane, 1] + dy
    ids[lane, slot] = label
    first[lane, slot, 0] = x
    first[lane, slot, 1] = y
    append_point(mu, P, lane, rows_in_use(n_t, slot + 1), ROBOT + n_t + 2 * slot, x, y, g0, g1, n00, n01, n11)
    return slot


@inline
def advance_pending(pending, lane, speed, turn):
    """One step of the displacement since the held sighting, in the axes of the heading at the step's end."""
    c, s = math.cos(turn), math.sin(turn)
    x, y = pending[lane, 1], pending[lane, 2]
    pending[lane, 1] = c * x + s * y + speed
    pending[lane, 2] = -s * x + c * y
    pending[lane, 3] += 1.0


@subroutine
def start_target(mu, P, lane, n, model, target_known, pending, dx, dy, g0, g1, n00, n01, n11, anchor_x, anchor_y, dt):
    """Take a return into a target that is not yet known.

    Args:
        dx: with dy, the return's offset from the robot's mean, world axes.
        g0: with g1, heading column of the offset's Jacobian. n00: with n01, n11, the return's noise in world axes.
        anchor_x: with anchor_y, where the held point is linearised (its mean, but for FEJ).
        dt: the last step [s].
    """
    x, y = mu[lane, 0] + dx, mu[lane, 1] + dy
    if model.target_kind != TWIST:
        append_point(mu, P, lane, n, ROBOT, x, y, g0, g1, n00, n01, n11)
        P[lane, 5, 5] = P[lane, 6, 6] = model.initial_speed_std * model.initial_speed_std
        target_known[lane] = True
        return
    if pending[lane, 0] == 0.0:
        append_point(mu, P, lane, n, ROBOT, x, y, g0, g1, n00, n01, n11)
        pending[lane, 0] = 1.0
        pending[lane, 1] = pending[lane, 2] = pending[lane, 3] = 0.0
        return
    _start_from_chord(mu, P, lane, n, model, target_known, pending, x, y, g0, g1, n00, n01, n11, anchor_x, anchor_y, dt)


@inline
def _start_from_chord(
    mu, P, lane, n, model, target_known, pending, x, y, g0, g1, n00, n01, n11, anchor_x, anchor_y, dt
):
    """Heading = direction of the chord less that of the displacement expected in the target's own axes.

    With d the chord, the heading's Jacobian by its end is u = J d / |d|^2, by its start -u. Of the turn noise of K
    steps the chord carries the mean, which leaves sigma^2 (K - 1)(2K - 1) / (6K) for the heading at the end.
    """
    pending[lane, 0] += 1.0
    cx, cy = x - anchor_x, y - anchor_y
    square = cx * cx + cy * cy
    steps = pending[lane, 3]
    if steps == 0.0 or not square > 0.0:
        return
    u0, u1 = -cy / square, cx / square
    noise = u0 * u0 * n00 + 2.0 * u0 * u1 * n01 + u1 * u1 * n11
    variance = innovation_cov(P, lane, ROBOT, u0, u1, 0.0, 0.0, -(u0 * g0 + u1 * g1), 0.0, noise, 1.0)[0]
    turn_noise = (model.target_turn_std * dt) ** 2 * (steps - 1.0) * (2.0 * steps - 1.0) / (6.0 * steps)
    if not variance + turn_noise <= MAX_HEADING_VARIANCE and pending[lane, 0] < MAX_SIGHTINGS:
        return
    chord = math.atan2(y - mu[lane, 4], x - mu[lane, 3])
    expected = math.atan2(pending[lane, 2], pending[lane, 1])
    heading = ROBOT + 2
    shear(P, lane, n, heading, ROBOT, -u0)
    shear(P, lane, n, heading, ROBOT + 1, -u1)
    clear_rows(mu, P, lane, n, ROBOT, 2)
    append_point(mu, P, lane, n, ROBOT, x, y, g0, g1, n00, n01, n11)
    shear(P, lane, n, heading, ROBOT, u0)
    shear(P, lane, n, heading, ROBOT + 1, u1)
    P[lane, heading, heading] += turn_noise
    mu[lane, heading] = wrap(chord - expected)
    target_known[lane] = True
    pending[lane, 0] = 0.0


@inline
def admits(slot, label, lane, count, ids, target_known, counters):
    """Whether a return with this slot enters the state: a new landmark with room, or a target not yet known."""
    if slot == TARGET_SLOT:
        return not target_known[lane]
    if slot != NEW:
        return False
    if slot_of(ids, lane, count[lane], label) != NEW:
        counters[lane, DROPPED_RETURN] += 1  # seen twice in its first sweep
        return False
    if count[lane] == ids.shape[1]:
        counters[lane, OVERFLOW] += 1
        return False
    return True


@subroutine
def enter(
    mu, P, lane, model, n_t, count, ids, first, next_id, target_known, pending, slot, label, dx, dy, g0, g1, n00, n01,
    n11, anchor_x, anchor_y, dt,
):  # fmt: skip
    """Take an admitted return into the state; the slot it then has. Arguments as in `start_target`."""
    if slot == TARGET_SLOT:
        n = rows_in_use(n_t, count[lane])
        start_target(
            mu, P, lane, n, model, target_known, pending, dx, dy, g0, g1, n00, n01, n11, anchor_x, anchor_y, dt
        )
        return slot
    next_id[lane] += 1
    return add_landmark(mu, P, lane, n_t, count, ids, first, label, dx, dy, g0, g1, n00, n01, n11)


@subroutine
def grow(
    lane, mu, P, model, n_t, count, ids, first, next_id, target_known, pending, counters, ranges, bearings, labels,
    num_returns, nearest, slots, linear_x, linear_y, anchor_x, anchor_y, dt,
):  # fmt: skip
    """Take in the returns of one lane's sweep that are not yet in the state; writes their slots into `slots`.

    Args:
        nearest: whether association ignores labels: ids are then 0, 1, 2, ... in order of creation.
        linear_x: with linear_y, the robot's position in the initialisation Jacobian [I, J(l - p)].
        anchor_x: with anchor_y, see `start_target`.
    """
    for k in range(num_returns):
        label = next_id[lane] if nearest else labels[lane, k]
        if not admits(slots[lane, k], label, lane, count, ids, target_known, counters):
            continue
        dx, dy = offset(ranges[lane, k], bearings[lane, k], mu[lane, 2])
        range_std, bearing_std = noise_std(model, ranges[lane, k])
        n00, n01, n11 = offset_noise(dx, dy, range_std, bearing_std)
        g0, g1 = linear_y - mu[lane, 1] - dy, mu[lane, 0] + dx - linear_x
        slots[lane, k] = enter(
            mu, P, lane, model, n_t, count, ids, first, next_id, target_known, pending, slots[lane, k], label, dx, dy,
            g0, g1, n00, n01, n11, anchor_x, anchor_y, dt,
        )  # fmt: skip
