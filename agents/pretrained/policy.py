"""The trained policy of each scenario, under one name."""

from importlib.resources import files
from pathlib import Path

from agents.sb3.policy import Learned
from agents.sb3.policy_file import SETTINGS
from estimators.registry import unknown_name
from slam_gym.policies import PolicyContext

FOLDER = Path(str(files("agents.pretrained")))
OTHERWISE = "default"  # where there is no policy for the scenario


def zones() -> list[str]:
    """Scenarios that a policy was trained for."""
    return sorted(file.parent.name for file in FOLDER.glob(f"*/{SETTINGS}"))


class Pretrained(Learned):
    """Drives as a policy that comes with slam-gym, trained with PPO for the scenario at hand, else for `default`.

    There are three, of `default`, `discovery` and `evasive-hard`; agents/pretrained/README.md has the commands, and
    what came of them there and in the other scenarios. Each is two layers of 128 tanh units on the flat observation
    (`slam-gym list SlamTarget-v0`) with the cloud of a lost target (`slam_gym.observation_cloud`), on the belief of
    ri-ekf; an action lasts 0.4 s. The cloud learns whether the target flees. `slam-gym train` first had it imitate a
    policy that looks for lost targets, `pursuit-hunt`, then try for itself in 256 worlds at once, paid by the default
    reward.

    It knows what it was trained in: with other pillars, a shorter range or a target that behaves otherwise it may do
    worse than `pursuit`, and only `slam-gym evaluate ppo` can tell. It knows the target about as well as `pursuit-hunt`
    and loses it longer in `revisit` and where it flees; its longest decision takes a seventh of the hunt's. A policy of
    one's own: `slam-gym train`.

    Args:
        context: models and limits.
        num_lanes: L.
        zone: name of the scenario whose policy drives; empty: the scenario's own, else that of `default`.

    Raises:
        ValueError: no policy for that zone, or a robot that is not driven by speed and turn rate.
    """

    summary = "a trained policy (PPO) for the scenario at hand; comes with slam-gym"

    def __init__(self, context: PolicyContext, num_lanes: int = 1, *, zone: str = "") -> None:
        known = zones()
        scenario = context.scenario.partition(" ")[0]  # without what a sweep has changed in it
        chosen = zone or (scenario if scenario in known else OTHERWISE)
        if chosen not in known:
            raise ValueError(f"policy 'ppo': {unknown_name('zone', chosen, known)}")
        super().__init__(context, num_lanes, path=str(FOLDER / chosen))
