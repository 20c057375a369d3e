"""Between a policy's actions in [-1, 1] and the robot's physical commands."""

import numpy as np
from numpy.typing import NDArray

from estimators.registry import unknown_name
from slam_gym.scenario import Scenario
from slam_gym.scenario_fields import middle

Floats = NDArray[np.float64]

KINDS = ("twist", "wheels", "steering")


class ActionMap:
    """One kind of action for one scenario.

    twist: (forward, turn): a >= 0 scales to speed_max, a < 0 to speed_min (0 is a stop); turn_max.
    wheels: (left, right) wheel speeds, 1 is the fastest forward speed.
    steering: (forward, steering angle), the bicycle's only kind.

    Args:
        scenario: whose limits count (the middle where one is a range).
        kind: "twist", "wheels" or "steering".

    Raises:
        ValueError: an unknown kind, or one that the robot cannot follow.
    """

    def __init__(self, scenario: Scenario, kind: str = "twist") -> None:
        if kind not in KINDS:
            raise ValueError(unknown_name("action", kind, list(KINDS)))
        bicycle = scenario.robot.kind == "bicycle"
        if bicycle != (kind == "steering"):
            allowed = "'steering'" if bicycle else "'twist' or 'wheels'"
            raise ValueError(f"a {scenario.robot.kind} takes the action {allowed}; got {kind!r}")
        robot = scenario.robot
        self.kind = kind
        self.speed_min, self.speed_max = middle(robot.speed_min), middle(robot.speed_max)
        self.turn_max = middle(robot.steering_max if bicycle else robot.turn_max)
        self.wheel_track = middle(robot.wheel_track)

    @property
    def names(self) -> tuple[str, str]:
        """What the two components are."""
        return {"twist": ("forward", "turn"), "wheels": ("left", "right"), "steering": ("forward", "steering")}[
            self.kind
        ]

    def to_command(self, action: Floats, out: Floats | None = None) -> Floats:
        """Physical commands [L, 2] (speed [m/s], turn rate [rad/s] or steering angle [rad]) of actions [L, 2]."""
        command = np.empty(action.shape) if out is None else out
        if self.kind == "wheels":
            left, right = action[:, 0] * self.speed_max, action[:, 1] * self.speed_max
            command[:, 0] = 0.5 * (left + right)
            command[:, 1] = (right - left) / self.wheel_track
            return command
        np.multiply(action[:, 0], self.speed_max, out=command[:, 0])
        backward = action[:, 0] < 0.0
        if backward.any():
            command[backward, 0] = action[backward, 0] * -min(self.speed_min, 0.0)
        np.multiply(action[:, 1], self.turn_max, out=command[:, 1])
        return command

    def to_action(self, command: Floats) -> Floats:
        """Actions [L, 2] of physical commands [L, 2]; beyond [-1, 1] where a command is beyond the limits."""
        action = np.empty(command.shape)
        if self.kind == "wheels":
            half = 0.5 * self.wheel_track * command[:, 1]
            action[:, 0], action[:, 1] = command[:, 0] - half, command[:, 0] + half
            return action / self.speed_max
        back = -min(self.speed_min, 0.0)
        forward = command[:, 0] / self.speed_max
        backward = command[:, 0] / back if back > 0.0 else np.zeros(len(command))
        action[:, 0] = np.where(command[:, 0] >= 0.0, forward, backward)
        action[:, 1] = command[:, 1] / self.turn_max
        return action
