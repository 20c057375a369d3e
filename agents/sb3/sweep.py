"""Several trainings that differ in their seed alone, side by side: in processes of this machine or on a Ray cluster.

One training says what came of one seed; what to expect of the next takes several, and the training seed as the unit.
"""

import csv
import dataclasses
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from agents.sb3.callbacks import CHECKPOINT, EVALUATIONS, Row
from agents.sb3.training import Trained, check_folder_is_free, load_scenario, read_hyperparameters, train
from slam_gym.evaluation_backend import Workers

if TYPE_CHECKING:
    from agents.sb3.train import Train

SeedReport = Callable[[int, int, int, Row | None], None]  # (seed, decisions so far, altogether, evaluation)
POLL = 1.0  # [s] between two looks at what the workers have written


def seed_folder(out: Path, seed: int) -> Path:
    """Where a sweep keeps the training of one seed."""
    return out / f"seed-{seed}"


def sweep(
    settings: "Train", out: Path, workers: Workers, *, command: str = "", report: SeedReport = lambda *_: None
) -> list[Trained]:
    """Train every seed of `settings.seeds`, each as `train` does it alone: the same weights, wherever it is done.

    With `settings.resume` a seed goes on from its checkpoint, and one that was not begun begins.

    Args:
        settings: see `agents.sb3.train.Train`.
        out: folder of the seeds' folders; on a Ray cluster one that all machines share.
        workers: who does the work.
        command: as typed, to be kept.
        report: told of progress.

    Returns:
        In the order of the seeds.

    Raises:
        ValueError: impossible settings, the same seed twice, or a folder that is in use.
    """
    seeds = settings.seeds
    if len(set(seeds)) < len(seeds):
        raise ValueError(f"--seeds names a seed twice: {' '.join(map(str, seeds))}")
    total = read_hyperparameters(settings, load_scenario(settings)).n_timesteps
    folders = {seed: seed_folder(out.absolute(), seed) for seed in seeds}
    if not settings.resume:
        for folder in folders.values():
            check_folder_is_free(folder)
    alone = {seed: dataclasses.replace(settings, seed=seed, seeds=()) for seed in seeds}
    done: dict[int, Trained] = {}
    if workers.is_here:
        for seed, own in alone.items():
            done[seed] = _train(own, folders[seed], command, lambda *told, seed=seed: report(seed, *told))
    else:
        with _watching(folders, total, report):
            for seed, trained in workers.results([(_in_worker, (own, folders[own.seed], command)) for own in
                                                  alone.values()]):  # fmt: skip
                done[seed] = trained
    return [done[seed] for seed in seeds]


def _train(settings: "Train", folder: Path, command: str, report: Callable[[int, int, Row | None], None]) -> Trained:
    """Begin, or go on where a checkpoint is: one that is not to be resumed has been refused before."""
    resumed = dataclasses.replace(settings, resume=(folder / CHECKPOINT).is_file())
    return train(resumed, folder, command=command, report=report)


def _in_worker(settings: "Train", folder: Path, command: str) -> tuple[int, Trained]:
    return settings.seed, _train(settings, folder, command, lambda *_: None)


@contextmanager
def _watching(folders: dict[int, Path], total: int, report: SeedReport) -> Iterator[None]:
    """Report the evaluations that workers write, until the block ends; those of an earlier run are not news."""
    known = {seed: len(_evaluations(folder)) for seed, folder in folders.items()}
    over = threading.Event()

    def look() -> None:
        for seed, folder in folders.items():
            rows = _evaluations(folder)
            for row in rows[known[seed] :]:
                report(seed, int(row["steps"]), total, row)
            known[seed] = max(known[seed], len(rows))

    def watch() -> None:
        while not over.wait(POLL):
            look()

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()
        look()


def _evaluations(folder: Path) -> Sequence[Row]:
    try:
        with (folder / EVALUATIONS).open(encoding="utf-8", newline="") as file:
            return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
    except FileNotFoundError:
        return []
