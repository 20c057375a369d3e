"""`slam-gym watch`: an episode in a window."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

CLOUD_POINTS = 256  # where a lost target may be


@dataclass(frozen=True)
class Watch:
    """Watch robot, target and estimators live in a window; its keys are listed on screen.

    Every estimator processes the same data: `tab` shows the next one. The policy drives on the first one's belief,
    until you take over with the arrow keys.

    Examples:
      slam-gym watch
      slam-gym watch discovery --estimators ri-ekf ekf dead-reckoning
      slam-gym watch slamto --estimators slamto ekf --policy pursuit:stand_off=2
    """

    scenario: Annotated[str, tyro.conf.Positional] = "default"
    """Name of a scenario (`slam-gym list scenarios`) or path of a TOML file."""
    estimators: tuple[str, ...] = ("ri-ekf",)
    """Estimators (`slam-gym list estimators`), options as slamto:particles=500; the policy acts on the first."""
    policy: str | None = None
    """A policy (`slam-gym list policies`), with options as pursuit:stand_off=2, or the folder of a training; default:
    the scenario's own."""
    set: tuple[str, ...] = ()
    """Scenario settings to change, such as sensor.max_range=5."""
    seed: int = 0
    """Of the first world; `enter` goes on to the next."""
    size: tuple[int, int] = (1200, 800)
    """Width and height of the window [px]; it can be resized."""
    folder: Path = Path()
    """Where `s` and `m` save pictures and videos."""

    def run(self) -> int:
        """Open the window and run until it is closed."""
        from slam_gym.episode import Episode
        from slam_gym.render import Renderer
        from slam_gym.scenario import Scenario
        from slam_gym.specs import parse_settings
        from slam_gym.viewer import FPS, Viewer, check_display

        check_display()
        scenario = Scenario.load(self.scenario, **parse_settings(self.set))
        print("Loading (the first time compiles: up to a minute for each estimator) ...", flush=True)
        episode = Episode(scenario, self.estimators, policy=self.policy, seed=self.seed, cloud_points=CLOUD_POINTS)
        episode.warm_up()
        renderer = Renderer("human", self.size, title=f"slam-gym: {scenario.name}", fps=FPS)
        viewer = Viewer(episode, renderer, self.folder)
        try:
            viewer.loop()
        except KeyboardInterrupt:
            return 130
        finally:
            viewer.close()
            renderer.close()
        return 0
