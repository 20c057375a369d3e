"""Between a policy's actions in [-1, 1] and the robot's physical commands."""

import numpy as np
from numpy.typing import NDArray

from estimators.kernels.bound import LATER, Bound, bind
from estimators.kernels.jit import jit
from estimators.registry import unknown_name
from slam_gym.scenario import Scenario
from slam_gym.scenario_fields import middle

Floats = NDArray[np.float64]

COMPONENTS = {"twist": ("forward", "turn"), "wheels": ("left", "right"), "steering": ("forward", "steering")}
KINDS = tuple(COMPONENTS)


@jit
def _to_command(lanes, action, wheels, speed_min, speed_max, turn_max, track, command):
    """Command [L, 2] of action [L, 2] in the lanes [n], cut to [-1, 1]; False where one is no finite number."""
    finite = True
    for i in range(lanes.shape[0]):
        lane = lanes[i]
        a, b = action[lane, 0], action[lane, 1]
        if not (abs(a) < np.inf and abs(b) < np.inf):
            finite = False
        a, b = min(max(a, -1.0), 1.0), min(max(b, -1.0), 1.0)
        if wheels:
            command[lane, 0] = 0.5 * speed_max * (a + b)
            command[lane, 1] = speed_max * (b - a) / track
        else:
            command[lane, 0] = a * speed_max if a >= 0.0 else -a * min(speed_min, 0.0)
            command[lane, 1] = b * turn_max
    return finite


def not_finite(action: Floats) -> ValueError:
    """The error for actions [L, 2] of which some are no finite numbers: it names the first lane's."""
    lane, *others = np.flatnonzero(~np.isfinite(action).all(axis=1)).tolist()
    where = f" in lane {lane}" if len(action) > 1 else ""
    more = f", and {len(others)} more lanes' are not finite either" if others else ""
    return ValueError(f"actions must be finite numbers in [-1, 1]; got {action[lane].tolist()}{where}{more}")


class ActionMap:
    """One kind of action for one scenario.

    twist: (forward, turn). Forward 1 is `speed_max`, -1 is `speed_min` (0: the robot cannot reverse), 0 stands still;
        turn 1 is `turn_max` to the left.
    wheels: (left, right) wheel speeds; 1 is the fastest forward speed, -1 the same backwards. The world cuts the
        resulting twist to the robot's limits.
    steering: (forward, steering angle): the bicycle's only kind.

    Args:
        scenario: whose limits count (the middle where one is a range).
        kind: "twist", "wheels" or "steering"; None: the robot's usual one.

    Attributes:
        kind, names: the kind, and what its two components are called.

    Raises:
        ValueError: an unknown kind, or one that the robot cannot follow.
    """

    def __init__(self, scenario: Scenario, kind: str | None = "twist") -> None:
        robot = scenario.robot
        bicycle = robot.kind == "bicycle"
        if kind is None:
            kind = "steering" if bicycle else "twist"
        if kind not in KINDS:
            raise ValueError(unknown_name("action", str(kind), list(KINDS)))
        if bicycle != (kind == "steering"):
            allowed = "'steering'" if bicycle else "'twist' or 'wheels'"
            raise ValueError(f"a {robot.kind} takes the action {allowed}; got {kind!r}")
        self.kind, self.names = kind, COMPONENTS[kind]
        self.speed_min, self.speed_max = middle(robot.speed_min), middle(robot.speed_max)
        self.turn_max = middle(robot.steering_max if bicycle else robot.turn_max)
        self.wheel_track = middle(robot.wheel_track)
        self._numbers = (kind == "wheels", self.speed_min, self.speed_max, self.turn_max, self.wheel_track)

    def bound(self, action: Floats, command: Floats) -> Bound:
        """`fill` of ever the same arrays, for the lanes that it is given."""
        return bind(_to_command, LATER, action, *self._numbers, command)

    def fill(self, action: Floats, command: Floats) -> bool:
        """Write the commands [L, 2] of actions [L, 2], cut to [-1, 1]; False where one is not a finite number."""
        return bool(_to_command(np.arange(len(action)), action, *self._numbers, command))

    def to_command(self, action: Floats) -> Floats:
        """Physical commands [L, 2] (speed [m/s], turn rate [rad/s] or steering angle [rad]) of actions [L, 2].

        Raises:
            ValueError: an action that is not a finite number, or not two per lane.
        """
        action = np.asarray(action, dtype=np.float64)
        if action.ndim != 2 or action.shape[1] != 2:
            raise ValueError(f"actions are an array [lanes, 2], also of a single lane; got shape {action.shape}")
        command = np.empty(action.shape)
        if not self.fill(action, command):
            raise not_finite(action)
        return command

    def to_action(self, command: Floats) -> Floats:
        """Actions [L, 2] of physical commands [L, 2]; beyond [-1, 1] where a command is beyond the limits."""
        action = np.empty(command.shape)
        if self.kind == "wheels":
            half = 0.5 * self.wheel_track * command[:, 1]
            action[:, 0], action[:, 1] = command[:, 0] - half, command[:, 0] + half
            return action / self.speed_max
        back = -min(self.speed_min, 0.0)
        backward = command[:, 0] / back if back > 0.0 else np.zeros(len(command))
        action[:, 0] = np.where(command[:, 0] >= 0.0, command[:, 0] / self.speed_max, backward)
        action[:, 1] = command[:, 1] / self.turn_max
        return action
