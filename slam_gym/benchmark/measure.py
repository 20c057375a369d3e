"""All of the benchmark's measurements, as one dictionary of rows that JSON can hold."""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from itertools import product
from typing import Any

from slam_gym import policies
from slam_gym.benchmark import maps, scaling
from slam_gym.benchmark.decisions import decision_row
from slam_gym.benchmark.drives import DRIVES, drive_rows
from slam_gym.benchmark.environment import environment_rows
from slam_gym.benchmark.filters import blas_rows, compressed_rows, filter_rows, installed
from slam_gym.benchmark.floors import peak_gflops
from slam_gym.benchmark.machine import machine

Progress = Callable[[str, int, int], None]  # (what is being measured, measurements done, in all)
Job = tuple[str, str, Callable[[], list[dict[str, Any]]]]  # a table, what is being measured, what returns its rows


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
    policies: tuple[str, ...] = (
        "pursuit", "pursuit-search", "pursuit-hunt", "search", "pursuit-revisit", "explore", "greedy-info",
        "receding-horizon", "ppo",
    )  # fmt: skip
    decision_runs: int = 10  # of one lane
    decision_lanes: int = 64  # in one run
    decision_steps: int | None = None  # of a run; None: all
    others: bool = True  # Gymnasium's own vector environments, other packages' filters
    training: bool = True  # where Stable-Baselines3 is installed

    @property
    def few(self) -> int:
        """Rounds of what takes long, or of many sizes."""
        return max(3, self.rounds // 3)


QUICK = Size(
    rounds=5, lanes=(1, 64, 256), compared_lanes=(1, 256), landmarks=(10, 100), particles=(10, 100),
    blas_landmarks=(20, 100), compressed_landmarks=(100,), gaussian=("ekf", "ri-ekf"), scaled=("ekf",),
    particle=("fastslam2",), drives=("geng-hu",), stored_landmarks=(100, 800), policies=("pursuit", "receding-horizon"),
    decision_runs=3, decision_lanes=16, training=False,
)  # fmt: skip


def measure(size: Size, progress: Progress, only: Collection[str] = ()) -> dict[str, Any]:
    """Every table, each measured in one stretch; the keys are what `slam_gym.benchmark.page` reads.

    Args:
        size: how much.
        progress: told of each measurement.
        only: names of `SECTIONS` that are measured; none: all.
    """
    jobs = [job for name, section in SECTIONS.items() if not only or name in only for job in section(size)]
    found: dict[str, Any] = {"machine": machine(), "peak_gflops": peak_gflops()}
    for count, (key, what, work) in enumerate(jobs):
        progress(what, count, len(jobs))
        found.setdefault(key, []).extend(work())
    progress("done", len(jobs), len(jobs))
    return found


def _environment(size: Size) -> Iterator[Job]:
    yield "environment", "environments", partial(environment_rows, size.compared_lanes, size.rounds, size.others)


def _filters(size: Size) -> Iterator[Job]:
    yield "filters", "filters", partial(filter_rows, size.gaussian, 20, size.rounds, size.others)


def _blas(size: Size) -> Iterator[Job]:
    yield "blas", "filter and BLAS", partial(blas_rows, size.blas_landmarks, size.rounds)
    large = partial(compressed_rows, size.compressed_landmarks, size.rounds)
    yield "compressed", "compressed filter and BLAS", large
    for name in size.drives:
        yield "drives", name, partial(drive_rows, name, DRIVES[name], size.few, size.drive_steps)
    yield "returns", "returns in particles", partial(maps.return_rows, size.particle, size.rounds)
    yield "maps", "maps of particles", partial(maps.map_rows, [("lazy", count) for count in size.stored_landmarks])


def _decisions(size: Size) -> Iterator[Job]:
    """Of the policies that are installed: this package names them, and needs none."""
    for name in size.policies:
        if name in policies.names():
            arguments = size.decision_runs, size.decision_lanes, size.decision_steps
            yield "decisions", f"decisions of {name}", partial(_row, decision_row, name, *arguments)


def _training(size: Size) -> Iterator[Job]:
    if size.training:
        yield "training", "training", training_rows


def _growth(size: Size) -> Iterator[Job]:
    for name, count in product(size.scaled, size.landmarks):
        yield "landmarks", "growth with the map", partial(scaling.landmark_rows, name, count, size.few)
    for name, count in product(size.particle, size.particles):
        yield "particles", "growth with the particles", partial(scaling.particle_rows, name, count, size.few)
    for count in size.lanes:
        yield "lanes", "growth with the lanes", partial(scaling.lane_rows, count, size.few)


def _row(work: Callable[..., dict[str, Any]], *arguments: Any) -> list[dict[str, Any]]:
    return [work(*arguments)]


SECTIONS: dict[str, Callable[[Size], Iterator[Job]]] = {
    "environment": _environment, "filters": _filters, "blas": _blas, "decisions": _decisions, "training": _training,
    "growth": _growth,
}  # fmt: skip
"""Parts of the page by name, and what each measures."""


def training_rows() -> list[dict[str, Any]]:
    """What `agents.sb3.throughput` measures; nothing where Stable-Baselines3 is not installed."""
    if not installed("stable_baselines3"):
        return []
    return list(import_module("agents.sb3.throughput").training_rows())


def growth(rows: Sequence[dict[str, Any]], key: str, name: str) -> float:
    """The exponent of one filter's cost in `key`."""
    mine = [row for row in rows if row.get("name", name) == name]
    return scaling.exponent([row[key] for row in mine], [row["microseconds"] for row in mine])
