"""All of the benchmark's measurements, as one dictionary of rows that JSON can hold."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from slam_gym.benchmark import maps, scaling
from slam_gym.benchmark.drives import DRIVES, drive_rows
from slam_gym.benchmark.environment import environment_rows
from slam_gym.benchmark.filters import blas_rows, compressed_rows, filter_rows, installed
from slam_gym.benchmark.floors import peak_gflops
from slam_gym.benchmark.machine import machine

Progress = Callable[[str, int, int], None]  # (what is being measured, measurements done, in all)


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    rounds: int = 30
    lanes: tuple[int, ...] = (1, 4, 16, 64, 256, 1024, 4096)
    compared_lanes: tuple[int, ...] = (1, 64, 256, 1024)
    landmarks: tuple[int, ...] = (10, 20, 50, 100, 200, 500, 1000)
    particles: tuple[int, ...] = (10, 30, 100, 300, 1000, 3000, 10000)
    blas_landmarks: tuple[int, ...] = (20, 50, 100, 500)
    compressed_landmarks: tuple[int, ...] = (100, 1000)
    gaussian: tuple[str, ...] = ("ekf", "fej-ekf", "ri-ekf", "cdkf", "ri-cdkf", "taylor-ekf")
    scaled: tuple[str, ...] = ("ekf", "ri-ekf", "cdkf")
    particle: tuple[str, ...] = ("slamto", "fastslam2")
    drives: tuple[str, ...] = tuple(DRIVES)
    drive_steps: int | None = None  # of each; None: all
    stored_landmarks: tuple[int, ...] = (100, 800, 6400)  # in the maps of particles
    others: bool = True  # Gymnasium's own vector environments, other packages' filters
    training: bool = True  # where Stable-Baselines3 is installed


QUICK = Size(
    rounds=5, lanes=(1, 64, 256), compared_lanes=(1, 256), landmarks=(10, 100), particles=(10, 100),
    blas_landmarks=(20, 100), compressed_landmarks=(100,), gaussian=("ekf", "ri-ekf"), scaled=("ekf",),
    particle=("fastslam2",), drives=("geng-hu",), stored_landmarks=(100, 800), training=False,
)  # fmt: skip


def measure(size: Size, progress: Progress) -> dict[str, Any]:
    """Every table, each measured in one stretch; the keys are what `slam_gym.benchmark.page` reads."""
    steps = (
        6
        + size.training
        + len(size.drives)
        + len(size.stored_landmarks)
        + len(size.scaled) * len(size.landmarks)
        + len(size.particle) * len(size.particles)
        + len(size.lanes)
    )
    count = [0]

    def note(what: str) -> None:
        progress(what, count[0], steps)

    def done() -> None:
        count[0] += 1

    def take(what: str, work: Callable[..., Any], *arguments: Any) -> Any:
        note(what)
        found = work(*arguments)
        done()
        return found

    found: dict[str, Any] = {"machine": machine()}
    found["peak_gflops"] = take("peak of the processor", peak_gflops)
    found["environment"] = take("environments", environment_rows, size.compared_lanes, size.rounds, size.others)
    found["filters"] = take("filters", filter_rows, size.gaussian, 20, size.rounds, size.others)
    found["blas"] = take("filter and BLAS", blas_rows, size.blas_landmarks, size.rounds)
    found["compressed"] = take("compressed filter and BLAS", compressed_rows, size.compressed_landmarks, size.rounds)
    few = max(3, size.rounds // 3)
    found["drives"] = [
        row for name in size.drives for row in take(name, drive_rows, name, DRIVES[name], few, size.drive_steps)
    ]
    found["returns"] = take("returns in particles", maps.return_rows, size.particle, size.rounds)
    found["maps"] = [take("maps of particles", maps.map_row, "lazy", count) for count in size.stored_landmarks]
    if size.training:
        found["training"] = take("training", training_rows)
    note("growth with the map")
    found["landmarks"] = scaling.landmark_rows(size.scaled, size.landmarks, few, done)
    note("growth with the particles")
    found["particles"] = scaling.particle_rows(size.particle, size.particles, few, done)
    note("growth with the lanes")
    found["lanes"] = scaling.lane_rows(size.lanes, few, done)
    progress("done", steps, steps)
    return found


def training_rows() -> list[dict[str, Any]]:
    """What `agents.sb3.throughput` measures; nothing where Stable-Baselines3 is not installed."""
    if not installed("stable_baselines3"):
        return []
    return list(import_module("agents.sb3.throughput").training_rows())


def growth(rows: Sequence[dict[str, Any]], key: str, name: str) -> float:
    """The exponent of one filter's cost in `key`."""
    mine = [row for row in rows if row.get("name", name) == name]
    return scaling.exponent([row[key] for row in mine], [row["microseconds"] for row in mine])
