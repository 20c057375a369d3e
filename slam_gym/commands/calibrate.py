"""`slam-gym calibrate`: fit a recorded robot's numbers against the recorded truth."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from slam_gym.calibrate import Fit
    from slam_gym.recording import Recording

ROWS = {
    # what it is about: fields of the calibration
    "range": ("range_offset", "range_bearing2", "range_bearing4", "range_inverse", "target_offset"),
    "range noise": ("range_std", "range_time", "range_scale_std"),
    "bearing": ("bearing_offset", "bearing_std", "bearing_correlated_std", "bearing_time", "bearing_bias_std"),
    "delays": ("measurement_delay", "command_delay"),
    "odometry": ("speed_scale", "turn_scale", "speed_noise", "turn_noise", "turn_noise_per_angle"),
    "target": ("target_speed_std", "target_time", "target_pull", "target_centre_x", "target_centre_y"),
}


@dataclass(frozen=True, kw_only=True)
class Calibrate:
    """Fit the numbers of a recorded robot against its recorded truth, for `slam-gym replay --calibration`.

    PATHs are recordings of one kind of robot: MRCLAM folders (every robot in them is used), folders of CSV files or
    NPZ files as `slam-gym replay log` reads them, with truth and surveyed landmarks, 200 s or longer. Fitted are the
    systematic errors of range and bearing, the delays, the odometry's scales, the noise of both, how long it persists,
    and how the target wanders. Writes a TOML file, and a picture of the same name that shows the errors before and
    after.

    Example: slam-gym calibrate MRCLAM_Dataset7 --out my_robot.toml
             slam-gym replay mrclam MRCLAM_Dataset7 --robot 5 --target 1 --calibration my_robot.toml
    """

    paths: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """MRCLAM folders, folders of CSV files, or NPZ files."""
    out: Path = Path("calibration.toml")
    """File to write; never overwritten."""

    def run(self) -> int:
        """Load, fit, show."""
        from rich.console import Console

        from slam_gym.calibrate import calibrate
        from slam_gym.calibrate_plot import draw

        if not self.paths:
            raise ValueError("name at least one recording: an MRCLAM folder, a folder of CSV files or an NPZ file")
        if self.out.exists():
            raise FileExistsError(f"{str(self.out)!r} is there already, and nothing is overwritten; name another")
        console = Console()
        with console.status("loading") as status:
            recordings = [recording for path in self.paths for recording in load_all(path, status.update)]
            fit = calibrate(recordings, lambda step: status.update(f"fitting {step}"))
        fit.calibration.save(self.out)
        picture = draw(fit, self.out.with_suffix(".png"))
        console.print(table(fit, len(recordings)), markup=False, highlight=False)
        console.print(f"Calibration: {self.out}\nPicture: {picture}", soft_wrap=True, highlight=False)
        return 0


def load_all(path: Path, tell: "Callable[[str], Any]") -> "list[Recording]":
    """The recordings at a path: each robot of an MRCLAM folder with the next one as its target, or one log."""
    from slam_gym import log_format, mrclam

    if not (path.is_dir() and any(path.glob("Barcodes.dat*"))):
        return [log_format.load(path)]
    robots = mrclam.robots(path)
    found = []
    for robot, following in zip(robots, [*robots[1:], robots[0]], strict=True):
        tell(f"loading {path.name}: robot {robot}")
        if not any(path.glob(f"Robot{robot}_Measurement.dat*")):  # a target only
            continue
        found.append(mrclam.load(path, robot, None if robot == following else following))
    return found


def table(fit: "Fit", number: int) -> str:
    """The numbers by subject, and the errors before and after."""
    lines = [f"{len(fit.returns.range)} returns of {number} recordings, {fit.outliers} outliers left out"]
    for subject, names in ROWS.items():
        lines.append(subject)
        lines += [f"  {name:<24}{getattr(fit.calibration, name):>10.4g}" for name in names]
    lines.append("standard deviations         as logged  corrected")
    for what, before, after in (
        ("relative range error", fit.range_before, fit.range_after),
        ("bearing error [rad]", fit.bearing_before, fit.bearing_after),
    ):
        lines.append(f"  {what:<24}{before.std():>11.4f}{after.std():>11.4f}")
    return "\n".join(lines)
