"""The robocentric EKF: everything is estimated in the robot's own frame, the world's origin as one more thing in it.

The state, in the frame of the robot at its last sweep:

    frame_mu [L, n_f], frame_P [L, n_f, n_f]   the displacement since (x, y, heading), the target (n_t), the world's
                                               origin and axes as a pose (3), landmark of slot j at 3 + n_between + 2 j,
                                               n_between = n_t + 3

In that frame a sweep is an EKF's: the displacement has the robot's place. Then everything is seen from where the robot
has come to. `mu` and `P` are the same in the world's frame, computed when the belief is read.
"""

from typing import Any, ClassVar

import numpy as np

from estimators.gaussian.ekf import predict, take_returns
from estimators.gaussian.existence import revise_map
from estimators.gaussian.frames import (
    ORIGIN,
    carry_covariance,
    lift_shrunk,
    see_heading,
    see_nothing,
    see_point,
    see_vector,
)
from estimators.gaussian.growth import grow
from estimators.gaussian.landmark_budget import keep_within
from estimators.gaussian.layout import Call, GaussianEstimator
from estimators.gaussian.sweep import DROPPED_RETURN, REINITIALISED, associate, forget_target
from estimators.interface import BoundCalls, Floats, Ints, Scan
from estimators.kernels.association import DROPPED, KNOWN, TARGET_SLOT
from estimators.kernels.bound import LATER, bind, chain
from estimators.kernels.existence import log_odds
from estimators.kernels.gaussian import ROBOT, rows_in_use
from estimators.kernels.jit import inline, jit
from estimators.kernels.simd import aligned_zeros

BODY = 3  # rows of the world's origin and axes


@inline
def see_target(x, out, lane, n_t, at, coef, known, pending, body):
    """The target's rows: its point, and velocity or heading once it is known."""
    if not known and not pending:
        see_nothing(out, lane, at, coef, ROBOT, n_t)
        return
    see_point(x, out, lane, at, coef, ROBOT, ROBOT, body)
    if not known:
        see_nothing(out, lane, at, coef, ROBOT + 2, n_t - 2)
    elif n_t == 4:
        see_vector(x, out, lane, at, coef, ROBOT + 2, ROBOT + 2, body)
    else:
        see_heading(x, out, lane, at, coef, ROBOT + 2, ROBOT + 2, body)


@inline
def see_rest(out, lane, at, coef, begin, end):
    """Padding."""
    see_nothing(out, lane, at, coef, begin, end - begin)


@inline
def enter_frame(mu, P, frame_mu, frame_P, half, at, coef, lane, n_t, known):
    """From a prior in the world's frame to the robot's: no landmarks yet, no displacement."""
    world, n = ROBOT + n_t, rows_in_use(n_t + BODY, 0)
    see_nothing(frame_mu, lane, at, coef, 0, ROBOT)
    if n_t > 0:
        see_target(mu, frame_mu, lane, n_t, at, coef, known, False, 0)
    see_point(mu, frame_mu, lane, at, coef, world, ORIGIN, 0)
    see_heading(mu, frame_mu, lane, at, coef, world + 2, ORIGIN, 0)
    see_rest(frame_mu, lane, at, coef, world + BODY, n)
    carry_covariance(P, frame_P, half, lane, world, n, at, coef)


@inline
def compose(frame_mu, frame_P, moved, half, at, coef, lane, n_t, count, known, pending):
    """See everything from where the robot has come to; the displacement is nothing again. `moved` [1, n_f]: scratch."""
    world, n = ROBOT + n_t, rows_in_use(n_t + BODY, count)
    for i in range(n):
        moved[lane, i] = frame_mu[lane, i]
    see_nothing(frame_mu, lane, at, coef, 0, ROBOT)
    if n_t > 0:
        see_target(moved, frame_mu, lane, n_t, at, coef, known, pending, 0)
    see_point(moved, frame_mu, lane, at, coef, world, world, 0)
    see_heading(moved, frame_mu, lane, at, coef, world + 2, world + 2, 0)
    begin = world + BODY
    for slot in range(count):
        see_point(moved, frame_mu, lane, at, coef, begin + 2 * slot, begin + 2 * slot, 0)
    see_rest(frame_mu, lane, at, coef, begin + 2 * count, n)
    carry_covariance(frame_P, frame_P, half, lane, n, n, at, coef)


@jit
def leave_frame(frame_mu, frame_P, mu, P, half, at, coef, n_t, count, target_known, pending, lanes):
    """`mu` and `P` of the named lanes: everything seen from the world's origin and axes."""
    for i in range(lanes.size):
        lane = lanes[i]
        body, n_in = ROBOT + n_t, rows_in_use(n_t + BODY, count[lane])
        n = mu.shape[1]
        see_point(frame_mu, mu, lane, at, coef, 0, 0, body)
        see_heading(frame_mu, mu, lane, at, coef, 2, 2, body)
        if n_t > 0:
            see_target(frame_mu, mu, lane, n_t, at, coef, target_known[lane], pending[lane, 0] > 0.0, body)
        for slot in range(count[lane]):
            see_point(frame_mu, mu, lane, at, coef, body + 2 * slot, body + BODY + 2 * slot, body)
        see_rest(mu, lane, at, coef, body + 2 * count[lane], n)
        carry_covariance(frame_P, P, half, lane, n_in, n, at, coef)
        lift_shrunk(frame_P, P, lane, n, at, coef)


@inline
def forget_if_vague(
    frame_mu, frame_P, lane, n, n_t, model, target_known, pending, counters, ranges, slots, num_returns
):
    """`vague_target.forget_vague` in the robot's frame."""
    for k in range(num_returns):
        limit = model.reinitialise_spread * ranges[lane, k]
        variance = frame_P[lane, ROBOT, ROBOT] + frame_P[lane, ROBOT + 1, ROBOT + 1]
        if slots[lane, k] == TARGET_SLOT and target_known[lane] and variance > limit * limit:
            counters[lane, REINITIALISED] += 1
            forget_target(frame_mu, frame_P, lane, n, n_t, target_known, pending)


@inline
def update_one(
    lane, frame_mu, frame_P, model, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, ranges,
    bearings, labels, num_returns, code, gates, slots, cost, work, moved, half, at, coef,
):  # fmt: skip
    """One lane's sweep in the frame of the last one: an EKF's; then the change to the new frame."""
    between = n_t + BODY
    associate(
        lane, frame_mu, frame_P, model, between, count, ids, target_known, counters, ranges, bearings, labels,
        num_returns, code, gates, cost, slots,
    )  # fmt: skip
    for k in range(num_returns):
        if n_t == 0 and slots[lane, k] == TARGET_SLOT:
            slots[lane, k] = DROPPED
            counters[lane, DROPPED_RETURN] += 1
    if n_t > 0:
        n = rows_in_use(between, count[lane])
        forget_if_vague(
            frame_mu, frame_P, lane, n, n_t, model, target_known, pending, counters, ranges, slots, num_returns
        )
    take_returns(
        lane, frame_mu, frame_P, model, n_t, between, count, target_known, pending, counters, ranges, bearings,
        num_returns, gates, slots, work,
    )  # fmt: skip
    grow(
        lane, frame_mu, frame_P, model, between, count, ids, first, next_id, target_known, pending, counters, ranges,
        bearings, labels, num_returns, code != KNOWN, slots, frame_mu[lane, 0], frame_mu[lane, 1],
        frame_mu[lane, ROBOT], frame_mu[lane, ROBOT + 1], last_dt[lane],
    )  # fmt: skip
    compose(
        frame_mu, frame_P, moved, half, at, coef, lane, n_t, count[lane], target_known[lane], pending[lane, 0] > 0.0
    )


@jit
def update(
    frame_mu, frame_P, models, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, ranges,
    bearings, labels, counts, code, gates, slots, cost, work, moved, half, at, coef, lanes,
):  # fmt: skip
    """One sweep of the named lanes: see `update_one`."""
    for i in range(lanes.size):
        lane = lanes[i]
        update_one(
            lane, frame_mu, frame_P, models[lane], n_t, count, ids, first, next_id, target_known, pending, counters,
            last_dt, ranges, bearings, labels, counts[lane], code, gates, slots, cost, work, moved, half, at, coef,
        )  # fmt: skip


@jit
def start(mu, P, frame_mu, frame_P, half, at, coef, n_t, target_known, lanes):
    """The named lanes' priors, seen from the robot."""
    for i in range(lanes.size):
        lane = lanes[i]
        enter_frame(mu, P, frame_mu, frame_P, half, at, coef, lane, n_t, target_known[lane])


class RobocentricEKF(GaussianEstimator):
    """Robocentric EKF of robot, target and landmarks: the map moves past the robot.

    **State.** Landmarks, target and the world's origin and axes, in the robot's frame at its last sweep; the
    displacement d = (x, y, heading) since, appended with the covariance of the controls.

    **Motion.** Only d (and the target) moves: F and Q of `EKF`, in the frame of the last sweep.

    **Measurement.** As `EKF`, d in the robot's place: h = (|D|, atan2(D) - d_heading), D = l - d. Linearisation errors
    are those of one step's displacement, and not of the whole way from the world's origin.

    **Composition.** Then everything is seen from d: q+ = R(-d_heading)(q - d), headings less d_heading, by the
    improved d; Jacobian [R', -R', -J q+] over point, displacement and heading.

    **Belief.** The world's frame, by the same change of frame to the world's origin, with its Jacobian. After a
    sweep, the robot's pose is the inverse of the origin's.

    Args:
        motion: how the robot moves. sensor, target: see `GaussianEstimator`, as all options.

    When to use: where the robot's heading against the world is poorly known, and what is around it matters most.

    Known weakness: its consistency lies between `ekf`'s and `ri-ekf`'s: the linearisation points of a landmark still
    differ from sweep to sweep. A change of frame touches the whole covariance: twice the time of `ekf`.

    Reference: Castellanos, Martinez-Cantin, Tardos and Neira, "Robocentric map joining: improving the consistency of
    EKF-SLAM", Robotics and Autonomous Systems 2007.
    """

    name: ClassVar[str] = "robocentric-ekf"
    summary: ClassVar[str] = "EKF in the robot's own frame: small linearisation errors"
    mean_is_all: ClassVar[bool] = False

    def _allocate(self) -> None:
        super()._allocate()
        L = self.num_lanes
        self.n_between = self.n_t + BODY
        n_f = rows_in_use(self.n_between, self.max_landmarks)
        self.frame_mu: Floats = np.zeros((L, n_f))
        self.frame_P: Floats = aligned_zeros(L, n_f, n_f)
        self.work = aligned_zeros(self.work.shape[0], max(n_f, self.work.shape[1]))
        self.moved: Floats = np.zeros((L, n_f))  # scratch, as the three below
        self.half: Floats = np.zeros((n_f, n_f))
        self.at: Ints = np.zeros((n_f, 5), dtype=np.int64)
        self.coef: Floats = np.zeros((n_f, 5))
        self._world = bind(
            leave_frame, self.frame_mu, self.frame_P, self.mu, self.P, self.half, self.at, self.coef, self.n_t,
            self.count, self.target_known, self.pending, LATER,
        )  # fmt: skip

    def _after_reset(self, lanes: Ints) -> None:
        self.frame_mu[lanes], self.frame_P[lanes] = 0.0, 0.0
        start(
            self.mu, self.P, self.frame_mu, self.frame_P, self.half, self.at, self.coef, self.n_t, self.target_known,
            lanes,
        )  # fmt: skip

    @property
    def _state_names(self) -> tuple[str, ...]:
        return (*super()._state_names, "frame_mu", "frame_P")

    def bound_calls(self, control: Floats, dt: Floats, scan: Scan) -> BoundCalls | None:
        """See `Estimator.bound_calls`."""
        self.make_room(scan.ranges.shape[1])
        return BoundCalls(
            bind(*self._prediction(control, dt)),
            chain(*(bind(*call) for call in self._corrections(scan))),
            chain(self._world, self._core, self._map),
            self._scratch(),
        )

    def _scratch(self) -> tuple[Any, ...]:
        return (*super()._scratch(), self.half, self.at, self.coef)

    def _prediction(self, control: Floats, dt: Floats) -> Call:
        return (
            predict, self.frame_mu, self.frame_P, self.models, self.n_between, self.count, self.target_known,
            self.pending, control, dt, self.last_dt, LATER,
        )  # fmt: skip

    def _corrections(self, scan: Scan) -> list[Call]:
        """The base's calls, on the robot's frame; the target is forgotten within the update."""
        calls = [self._correction(scan)]
        if self.remove_below > 0.0:
            calls.append((
                revise_map, self.frame_mu, self.frame_P, self.models, self.n_between, self.count, self.ids, self.first,
                self.counters, scan.ranges, scan.bearings, scan.count, scan.complete, float(self.gates[2]),
                log_odds(self.remove_below), self.slots, LATER,
            ))  # fmt: skip
        if self.budget is not None:
            own = self.budget
            calls.append((
                keep_within, own.limit, own.window, own.seen, own.unseen, own.counters, self.frame_mu, self.frame_P,
                self.count, self.ids, self.first, self.n_between, self.slots, scan.count, LATER,
            ))  # fmt: skip
        return calls

    def _correction(self, scan: Scan) -> Call:
        return (
            update, self.frame_mu, self.frame_P, self.models, self.n_t, self.count, self.ids, self.first, self.next_id,
            self.target_known, self.pending, self.counters, self.last_dt, scan.ranges, scan.bearings, scan.labels,
            scan.count, self.association_code, self.gates, self.slots, self.cost, self.work, self.moved, self.half,
            self.at, self.coef, LATER,
        )  # fmt: skip

    def _fill_core(self, buffers: dict[str, Any]) -> None:
        self._world(self.all_lanes)
        super()._fill_core(buffers)

    def _fill_map(self, buffers: dict[str, Any]) -> None:
        self._world(self.all_lanes)
        super()._fill_map(buffers)

    def joint(self, lane: int) -> tuple[Floats, Floats]:
        """See `Belief.joint`."""
        self._world(self.all_lanes)
        return super().joint(lane)
