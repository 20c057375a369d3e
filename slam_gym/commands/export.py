"""`slam-gym export`: a simulated run in the formats that `slam-gym replay` reads."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from slam_gym.recording import Recording


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What every export can be told."""

    out: Annotated[Path, tyro.conf.Positional]
    """Where to write."""
    scenario: str = "mrclam"
    """Name or TOML file."""
    policy: str | None = None
    """Who drives, as NAME or NAME:key=value; none: the scenario's own."""
    seed: int = 0
    """Of the world."""
    steps: int | None = None
    """Simulation steps; none: all of the scenario's."""

    def record(self) -> "Recording":
        """Simulate.

        Raises:
            FileExistsError: the output is there already.
        """
        from slam_gym.export import record
        from slam_gym.scenario import Scenario

        if self.out.exists() and (not self.out.is_dir() or any(self.out.iterdir())):
            raise FileExistsError(f"{str(self.out)!r} is there already, and nothing is overwritten; name another")
        return record(Scenario.load(self.scenario), policy=self.policy, seed=self.seed, steps=self.steps)


@dataclass(frozen=True, kw_only=True)
class Mrclam(Settings):
    """Write a data set in the layout of MRCLAM: the robot is robot 1, the target robot 2.

    Example: slam-gym export mrclam small-set --steps 600
             slam-gym replay mrclam small-set --robot 1 --target 2
    """

    compress: bool = False
    """Write .dat.gz files."""

    def run(self) -> int:
        """Simulate and write."""
        from slam_gym import mrclam
        from slam_gym.export import mrclam_files

        recording = self.record()
        return _tell(mrclam.save(self.out, mrclam_files(recording), compress=self.compress), recording)


@dataclass(frozen=True, kw_only=True)
class Log(Settings):
    """Write the plain log format: a folder of CSV files, or one NPZ file if OUT ends in .npz.

    Example: slam-gym export log my-log --scenario open --steps 500
             slam-gym replay log my-log --scenario open
    """

    def run(self) -> int:
        """Simulate and write."""
        from slam_gym import log_format

        recording = self.record()
        return _tell(log_format.save(self.out, recording), recording)


@dataclass(frozen=True)
class Export:
    """Write a simulated run as if a robot had recorded it, for `slam-gym replay` or for other software.

    Example: slam-gym export mrclam small-set --scenario mrclam --seed 0 --steps 600
    """

    format: Annotated[
        Annotated[Mrclam, tyro.conf.subcommand("mrclam", prefix_name=False)]
        | Annotated[Log, tyro.conf.subcommand("log", prefix_name=False)],
        tyro.conf.arg(name=""),
    ]
    """Layout to write."""

    def run(self) -> int:
        """Whichever was chosen."""
        return self.format.run()


def _tell(path: Path, recording: "Recording") -> int:
    duration = recording.command_times[-1] - recording.command_times[0]
    print(f"{path}: {duration:.1f} s, {len(recording.sweep_times)} sweeps, {len(recording.ranges)} returns")
    return 0
