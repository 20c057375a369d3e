"""Wang and Wang 2019, Figure 5: memory of the map in arrays and in a tree, against landmarks and particles."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from slam_gym.evaluation_backend import workers
from slam_gym.palette import styles
from slam_gym.plots import new_figure
from slam_gym.reproduce.experiment import Choice, Drawing, Experiment, Grid, Outcome
from slam_gym.reproduce.rbpf_maps import FILTER, STORES, Round, drive_round
from slam_gym.reproduce.rbpf_world import choices
from slam_gym.reproduce.study import Study
from slam_gym.reproduce.verdict import Claim, faster, with_interval

LANDMARKS, QUICK_LANDMARKS = (10, 30, 100, 300, 1000), (10, 30, 100, 300)
PARTICLES, QUICK_PARTICLES = (20, 50, 100, 200, 500), (20, 100)
FIXED_PARTICLES, FIXED_LANDMARKS = 100, 300
ROUNDS, QUICK_ROUNDS = 5, 2
LARGE = 100  # landmarks from which the paper's claim is put to the test; smaller maps are in the table

Sizes = dict[int, dict[str, list[float]]]  # landmarks or particles -> storage -> megabytes of each round


def run(study: Study) -> Outcome:
    """Rounds past more and more landmarks, and with more and more particles."""
    by_landmarks = {n: _sizes(study, n, FIXED_PARTICLES) for n in (QUICK_LANDMARKS if study.quick else LANDMARKS)}
    by_particles = {m: _sizes(study, FIXED_LANDMARKS, m) for m in (QUICK_PARTICLES if study.quick else PARTICLES)}
    along = drive_round(FIXED_LANDMARKS, FIXED_PARTICLES, 0)
    return Outcome(
        claims=_claims(by_landmarks),
        choices=[*choices(), Choice("memory", "bytes that hold all particles' maps (`map_bytes()`), mean over the last "
                                    "quarter of a round", "the paper plots its process's memory, without a scale in "
                                    "the text; room kept for later is not counted")],
        grids=[_table("landmarks", by_landmarks, f"{FIXED_PARTICLES} particles"),
               _table("particles", by_particles, f"{FIXED_LANDMARKS} landmarks")],
        drawings=[Drawing("memory", "Memory of all particles' maps: along one round, against landmarks, against "
                          "particles", _figure(along, by_landmarks, by_particles))],
        remarks=[_crossing(by_landmarks)],
    )  # fmt: skip


def _sizes(study: Study, landmarks: int, particles: int) -> dict[str, list[float]]:
    """Rounds side by side: memory, unlike time, does not mind."""
    rounds = study.size(ROUNDS, QUICK_ROUNDS)
    found: dict[int, Sequence[float]] = {}
    with workers(study.jobs) as crew:
        for seed, megabytes in crew.results([(_megabytes, (landmarks, particles, seed)) for seed in range(rounds)]):
            found[seed] = megabytes
            study.progress(f"{landmarks} landmarks, {particles} particles", len(found), rounds)
    by_storage = zip(*(found[seed] for seed in range(rounds)), strict=True)
    return {storage: list(values) for storage, values in zip(STORES, by_storage, strict=True)}


def _megabytes(landmarks: int, particles: int, seed: int) -> tuple[int, list[float]]:
    """The round's seed, and the maps' size by storage, in the order of `STORES`."""
    driven = drive_round(landmarks, particles, seed)
    return seed, [driven.megabytes(storage) for storage in STORES]


def _claims(by_landmarks: Sizes) -> list[Claim]:
    return [
        faster(f"Figure 5: the tree needs less memory than one array per particle, {size} landmarks", found["tree"],
               found["dense"], paper="two curves")
        for size, found in by_landmarks.items() if size >= LARGE
    ]  # fmt: skip


def _crossing(by_landmarks: Sizes) -> str:
    """Where the tree begins to pay."""
    means = {size: (np.mean(found["tree"]), np.mean(found["dense"])) for size, found in by_landmarks.items()}
    more = [size for size, (tree, dense) in means.items() if tree >= dense]
    less = [size for size, (tree, dense) in means.items() if tree < dense]
    return (
        f"The tree's links cost more than it shares up to {max(more, default=0)} landmarks; from "
        f"{min(less, default=0)} on it needs less than arrays do."
    )


def _table(what: str, sizes: Sizes, note: str) -> Grid:
    rows = [
        [str(size), *(with_interval(found[storage], 1, 1e3) for storage in STORES),
         f"{np.mean(found['dense']) / np.mean(found['tree']):.1f}"]
        for size, found in sizes.items()
    ]  # fmt: skip
    columns = (what, *(f"{words} [kB]" for words in STORES.values()), "arrays over tree")
    return Grid(
        f"Memory against the number of {what}",
        columns,
        rows,
        f"{FILTER}, {note}; in brackets 95 % intervals over rounds.",
    )


def _figure(along: Round, by_landmarks: Sizes, by_particles: Sizes) -> Figure:
    figure, axes = new_figure(11.0, 3.8, ncols=3)
    for storage, (colour, dash) in styles(STORES).items():
        look = {"color": colour, "linestyle": dash, "label": STORES[storage]}
        axes[0].plot(along.mapped, 1e-3 * along.map_bytes[storage], **look)
        for axis, sizes in zip(axes[1:], (by_landmarks, by_particles), strict=True):
            axis.plot(list(sizes), [1e3 * np.mean(found[storage]) for found in sizes.values()], marker="o",
                      markersize=4, **look)  # fmt: skip
            axis.set_xscale("log")
            axis.set_yscale("log")
            axis.set_xticks(list(sizes), [str(size) for size in sizes])
            axis.tick_params(axis="x", which="minor", bottom=False, labelbottom=False)
    axes[0].set_xlabel(f"landmarks mapped so far, {FIXED_PARTICLES} particles")
    axes[1].set_xlabel(f"landmarks, {FIXED_PARTICLES} particles")
    axes[2].set_xlabel(f"particles, {FIXED_LANDMARKS} landmarks")
    axes[0].set_ylabel("memory of the maps [kB]")
    axes[0].legend(frameon=False, fontsize=9)
    return figure


EXPERIMENT = Experiment(
    "rbpf-memory", "wang-2019", "Figure 5", "memory of the maps: arrays, the paper's tree, shared columns", run
)
