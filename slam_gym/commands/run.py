"""`slam-gym run`: one episode."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

if TYPE_CHECKING:
    from collections.abc import Iterator

    from slam_gym.episode import Episode
    from slam_gym.render import Renderer
    from slam_gym.video import VideoWriter

VIDEO_FPS = 30.0  # [1/s] at most


@dataclass(frozen=True)
class Run:
    """Run one episode and print how every estimator did.

    The policy drives on the first estimator's belief; the others process the same data.

    Examples:
      slam-gym run
      slam-gym run discovery --estimators ri-ekf ekf dead-reckoning --png last.png
      slam-gym run --policy pursuit:stand_off=2 --video chase.mp4
      slam-gym run open --set landmarks.count=8 sensor.max_range=4
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
    """The same seed gives the same world and noise, whatever drives and estimates."""
    steps: int | None = None
    """Simulation steps; default: the scenario's."""
    png: Path | None = None
    """Write the last picture here."""
    video: Path | None = None
    """Write a video here, .mp4 or .gif."""
    plot: Path | None = None
    """Write a figure of paths and errors here, .png, .pdf or .svg."""
    size: tuple[int, int] = (800, 600)
    """Width and height of pictures and video [px]."""
    speed: float = 1.0
    """How many times faster than real time the video plays."""

    def run(self) -> int:
        """Run, print, write."""
        from rich.console import Console

        from slam_gym.commands.watch import CLOUD_POINTS
        from slam_gym.episode import Episode
        from slam_gym.episode_log import EpisodeLog
        from slam_gym.render import Renderer
        from slam_gym.scenario import Scenario
        from slam_gym.specs import parse_settings

        self._check()
        overrides = parse_settings(self.set)
        if self.steps is not None:
            overrides["max_steps"] = self.steps
        scenario = Scenario.load(self.scenario, **overrides)
        drawn = self.png is not None or self.video is not None
        points = CLOUD_POINTS if drawn else 0  # pictures as `watch` shows them
        episode = Episode(scenario, self.estimators, policy=self.policy, seed=self.seed, cloud_points=points)
        renderer = Renderer("rgb_array", self.size) if drawn else None
        log = EpisodeLog(episode)
        with self._video_writer(episode) as video:
            for _ in self._steps(episode, renderer, video):
                log.record()
        console = Console()
        console.print(log.table())
        for file in self._write(log, renderer):
            console.print(f"Wrote {file}")
        return 0

    def _check(self) -> None:
        """What would otherwise fail only when all is done."""
        from slam_gym.video import check_file

        if not self.speed > 0.0:
            raise ValueError(f"--speed must be positive; got {self.speed}")
        if self.png is not None:
            check_file(self.png, "picture", (".png", ".jpg"))
        if self.plot is not None:
            check_file(self.plot, "figure", (".png", ".pdf", ".svg"))

    def _steps(self, episode: "Episode", renderer: "Renderer | None", video: "VideoWriter | None") -> "Iterator[None]":
        """Step to the end, drawing what has to be drawn."""
        from slam_gym.render import Frame

        every = self._steps_per_picture(episode)
        while not episode.finished:
            episode.step()
            if renderer is not None and (episode.step_count % every == 0 or episode.finished):
                frame = Frame.from_simulation(episode.simulation, label=episode.names[0])
                if video is None and not episode.finished:
                    renderer.history.record(frame)  # only the last picture is wanted
                elif (picture := renderer.draw(frame)) is not None and video is not None:
                    video.write(picture)
            yield

    def _steps_per_picture(self, episode: "Episode") -> int:
        return max(1, round(self.speed / (VIDEO_FPS * episode.context.step_dt)))

    def _video_writer(self, episode: "Episode") -> Any:
        from contextlib import nullcontext

        from slam_gym.video import VideoWriter

        if self.video is None:
            return nullcontext()
        fps = self.speed / (self._steps_per_picture(episode) * episode.context.step_dt)
        return VideoWriter(self.video, self.size, fps)

    def _write(self, log: Any, renderer: "Renderer | None") -> "Iterator[Path]":
        if self.png is not None and renderer is not None:
            from slam_gym.render_pygame import pygame

            pygame.image.save(renderer.surface, str(self.png))
            yield self.png
        if self.video is not None:
            yield self.video
        if self.plot is not None:
            log.figure().savefig(self.plot)
            yield self.plot
