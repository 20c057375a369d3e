"""A trained policy that drives like any other."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from agents.sb3.policy_file import find_policy, load_policy
from estimators.interface import Belief
from slam_gym.policies import Floats, Ints, Policy, PolicyContext


class Learned(Policy):
    """Drives as a policy file says, on the observation alone.

    The file is what `slam-gym train` writes: weights and JSON, no code; neither torch nor Stable-Baselines3 is needed.
    An action lasts as long as it did in training, also where decisions are asked for more often. Where a policy is
    named, the folder alone will do: `slam-gym watch --policy runs/mine`.

    Args:
        context: models and limits.
        num_lanes: L.
        path: folder of a training (its best policy is taken) or of a policy, with policy.json and weights.safetensors.

    Raises:
        ValueError: no path, a pickle or a zip (refused: loading one runs code), or a policy of another kind of action.
        OSError: nothing there.
    """

    summary = "drives as a policy trained with `slam-gym train`: name its folder, runs/mine"
    needs_observation: ClassVar[bool] = True

    def __init__(self, context: PolicyContext, num_lanes: int = 1, *, path: str = "") -> None:
        super().__init__(context, num_lanes)
        if not path:
            raise ValueError(
                "the policy 'learned' needs a folder, as `slam-gym train` writes one: learned:path=runs/mine"
            )
        self.path = find_policy(Path(str(path)))
        self.settings, self.network = load_policy(self.path)
        self.weights = self.settings["sha256"]
        kind = self.settings["action"]
        if context.action_map.kind != kind:
            raise ValueError(
                f"the policy in {str(self.path)!r} was trained to give {kind!r} actions; this robot is driven with "
                f"{context.action_map.kind!r}"
            )
        shown = self.settings["observation"]
        self.observation_options = {"nearest": shown["nearest_landmarks"], "sectors": shown["sectors"]}
        self.needs_target_cloud = shown.get("target_cloud", 0)
        self.target_cloud_options = dict(shown.get("target_cloud_options", {}))
        self.hold = max(1, round(self.settings["decision_dt"] / context.dt))
        self._calls: Ints = np.zeros(self.num_lanes, dtype=np.int64)
        self._action: Floats = np.zeros((self.num_lanes, 2))

    def reset(self, lanes: Ints, seeds: Ints) -> None:
        """The next call decides anew."""
        self._calls[lanes] = 0

    def act(self, observation: Any, belief: Belief) -> Floats:
        """What the network says, or what it said last while that action lasts; see `Policy.act`.

        Raises:
            ValueError: no observation, or one of another size.
        """
        expected = (self.num_lanes, self.network.size)
        if observation is None or np.shape(observation) != expected:
            got = "none" if observation is None else f"one of shape {np.shape(observation)}"
            raise ValueError(f"the policy 'learned' acts on a flat observation of shape {expected}; got {got}")
        deciding = np.flatnonzero(self._calls % self.hold == 0)
        if len(deciding):
            self.network.act(np.ascontiguousarray(observation, dtype=np.float32), deciding, self._action)
        self._calls += 1
        return self._action.copy()
