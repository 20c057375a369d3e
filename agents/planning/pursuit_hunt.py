"""Look for a lost target along the way on which it is expected to be found soonest."""

import math

import numpy as np

from agents.planning.hunt import best_hunt
from agents.planning.limits import NO_LIMIT, check_counts
from agents.scripted.follower import Follower
from estimators.interface import Belief
from slam_gym.policies import Ints, PolicyContext

COMMANDS = ((1.0, 0.0), (1.0, 0.5), (1.0, -0.5), (1.0, 1.0), (1.0, -1.0), (0.0, 1.0), (0.0, -1.0), (0.0, 0.0))
"""What a segment may do, as shares of the highest speed and turn rate; a bicycle those that drive."""


class PursuitHunt(Follower):
    """Pursuit that looks for a lost target along the way on which it should find it soonest.

    While the target is known well enough it does what `pursuit` does. Where it is lost, every `replan` seconds the
    robot plans `segments` segments of `looks` looks, one each `look` seconds, with one of 8 commands per segment
    (straight on, arcs, turns on the spot, standing still), on the target's cloud (`estimators.TargetCloud`). Its points
    are moved ahead as the cloud moves them, so that the robot can wait for what comes and cut off what leaves. A look
    takes the share `detection_probability` of the weight of each point that is in range, in view and behind no pillar
    of the map. With u(t) the weight that no look has found by then, a plan costs

        integral of u dt + patience sum over points of u (seconds to turn and drive until it is in view)
        + clearance integral of (depth into `margin` around a pillar / margin) dt:

    the expected time to find within the plan, and a guess at the rest. A beam of `beam` plans that end at different
    poses searches them (`agents.planning.hunt`).

    A cloud with `evasive` learns from the courses it sees whether the target flees from a robot that sees it, and
    so many of its points do. A target that flees stays behind the pillar or in the corner that it was driven to.

    Where it helps: wherever targets are lost. Weakness: it knows the map and the arena that it has been told of, but no
    pillar that it has not seen.

    Args:
        context: models and limits.
        num_lanes: L.
        segments: of a plan.
        looks: of a segment.
        look: [s] between two looks.
        beam: plans that go on from each segment.
        patience: worth of what is not found within the plan.
        clearance: of a plan's nearness to pillars.
        margin: [m] around pillars that a plan keeps out of.
        replan: [s] between two plans.
        evasive: whether the cloud learns that targets flee.
        stand_off: [m] distance to keep.
        speed_gain: [1/s], speed per metre of distance error.
        turn_gain: [1/s], turn rate per radian of bearing.
        lead: share of the target's believed velocity that is anticipated.
        lost_std: [m] uncertainty at which the target counts as lost.

    Raises:
        ValueError: an impossible number.
    """

    name = "pursuit-hunt"
    summary = "pursuit; looks for a lost target along the way that should find it soonest"
    needs_target_cloud = 256

    def __init__(
        self,
        context: PolicyContext,
        num_lanes: int = 1,
        *,
        segments: int = 8,
        looks: int = 2,
        look: float = 0.4,
        beam: int = 5,
        patience: float = 1.0,
        clearance: float = 0.3,
        margin: float = 0.2,
        replan: float = 0.4,
        evasive: bool = True,
        stand_off: float = 1.5,
        speed_gain: float = 1.5,
        turn_gain: float = 3.0,
        lead: float = 1.0,
        lost_std: float = 0.3,
    ) -> None:
        super().__init__(
            context, num_lanes, stand_off=stand_off, speed_gain=speed_gain, turn_gain=turn_gain, lead=lead,
            lost_std=lost_std,
        )  # fmt: skip
        check_counts(self.name, segments=segments, looks=looks, beam=beam)
        self._check(patience=patience, clearance=clearance, margin=margin, replan=replan)
        if not 0.0 < look < math.inf:
            raise ValueError(f"{self.name}: look must be a finite number above zero; got {look!r}")
        self.target_cloud_options = {"evasive": bool(evasive)}
        self._look, self._keep = float(look), max(1, round(replan / context.dt))
        self._beam, self._looks = int(beam), int(looks)
        self._settings = (float(patience), float(clearance), float(margin))
        sensor = context.sensor
        self._sensor = (
            float(sensor.max_range), math.cos(min(0.5 * sensor.field_of_view, math.pi)), float(sensor.landmark_radius),
            float(sensor.detection_probability),
        )  # fmt: skip
        self._set_commands()
        self._pillars, self._near = np.zeros((0, 2)), np.zeros((0, 2))
        self._number = np.zeros(num_lanes, dtype=np.int64)  # [L] of the command that is driven
        self._age = np.zeros(num_lanes, dtype=np.int64)  # [L] decisions since it was chosen
        self._steps = int(segments) * int(looks)
        self._allocate(self.needs_target_cloud)

    def _set_commands(self) -> None:
        context, commands = self.context, np.array(COMMANDS)
        speed, turn = min(context.speed_max, NO_LIMIT), min(context.turn_max, NO_LIMIT)
        if context.is_bicycle:
            commands = commands[commands[:, 0] > 0.0]
            turn = speed * math.sin(context.steering_max) / context.motion.wheelbase
        self._pace = (float(speed), float(turn))
        self._commands = commands * self._pace

    def _allocate(self, points: int) -> None:
        """Scratch for a cloud of so many points."""
        steps, beam, plans = self._steps, self._beam, self._beam * len(self._commands)
        self._ahead, self._rows = np.zeros((steps, points, 2)), np.zeros((steps, 2, points))
        self._scratch = (
            np.zeros((2, plans, 3)), np.zeros((2, plans, points)), np.zeros((2, plans)), np.zeros(plans),
            np.zeros((2, plans), dtype=np.int64), np.zeros(beam, dtype=np.int64), np.zeros(beam, dtype=np.int64),
        )  # fmt: skip
        self._in_view = (np.zeros(points, dtype=np.int64), np.zeros((4, points)))

    def reset(self, lanes: Ints, seeds: Ints) -> None:
        """Forget where the target was."""
        super().reset(lanes, seeds)
        self._age[lanes] = 0

    def _seek(self, belief: Belief) -> None:
        self._age[~self._lost] = 0
        if self.context.target is None:
            self.command[self._lost] = 0.0
            return
        for lane in np.flatnonzero(self._lost):
            if self._age[lane] % self._keep == 0:
                self._number[lane] = self._best(int(lane), belief)
            self._age[lane] += 1
            self.command[lane] = self._commands[self._number[lane]]

    def _best(self, lane: int, belief: Belief) -> int:
        """Number of the command that the best plan begins with."""
        mapped, weights = belief.landmark_mapped[lane], belief.target_cloud[1][lane]
        if len(weights) != self._ahead.shape[1]:
            self._allocate(len(weights))
        if len(self._pillars) != len(mapped):
            self._pillars, self._near = np.zeros((len(mapped), 2)), np.zeros((len(mapped), 2))
        count = int(mapped.sum())
        self._pillars[:count] = belief.landmark_mean[lane, mapped]
        belief.foresee_target(lane, self._look, self._ahead)
        self._rows[:] = self._ahead.transpose(0, 2, 1)
        return int(best_hunt(
            belief.pose[lane], weights, self._rows, self._look, self._pillars, count,
            self._commands, self._looks, self._beam, self._sensor, self._pace, self._settings, *self._scratch,
            self._near, *self._in_view,
        ))  # fmt: skip
