"""Wang and Wang 2019, "the improved algorithm computes faster": the whole, and the tree alone."""

import numpy as np

from slam_gym.reproduce.experiment import Choice, Drawing, Experiment, Grid, Outcome
from slam_gym.reproduce.figures import against
from slam_gym.reproduce.rbpf_maps import FILTER, STORES, drive_round
from slam_gym.reproduce.rbpf_world import DRIVER, ROBOT, choices, world
from slam_gym.reproduce.study import Sample, Study
from slam_gym.reproduce.verdict import Claim, faster, with_interval
from slam_gym.specs import Spec

TRADITIONAL = Spec(
    "traditional", "fastslam1", {"particles": 100, "resample_threshold": 1.0, "map_storage": "dense"}
)  # five times the particles, which still err more: see rbpf-proposal
IMPROVED = Spec("improved", "rbpf", {"particles": 20, "map_storage": "tree"})
LARGE = 100  # landmarks from which the tree is put to the test
BATCHES, RUNS, QUICK_RUNS = 5, 20, 8
LANDMARKS, QUICK_LANDMARKS = (30, 100, 300, 1000), (30, 100, 300)
PARTICLES, ROUNDS, QUICK_ROUNDS = 100, 5, 2


def run(study: Study) -> Outcome:
    """Both algorithms on the same short runs; three storages on ever larger maps."""
    number = study.size(BATCHES, 3)
    samples = [
        study.measure(f"batch {b + 1} of {number}", world(), [TRADITIONAL, IMPROVED, DRIVER], seed=b, driver=DRIVER,
                      runs=study.size(RUNS, QUICK_RUNS), fields=(ROBOT,))
        for b in range(number)
    ]  # fmt: skip
    sizes = QUICK_LANDMARKS if study.quick else LANDMARKS
    times = {size: _times(study, size) for size in sizes}
    means = {STORES[storage]: [float(np.mean(times[size][storage])) for size in sizes] for storage in STORES}
    figure = against(sizes, means, "landmarks in the map", "time per step [us]", log="xy")
    caption = f"Time per step of {FILTER} with {PARTICLES} particles against the size of the map"
    return Outcome(
        claims=_claims(samples, times),
        choices=[*choices(), Choice("time", "prediction, update and resampling of one robot; all variants step by step "
                                    "in turn in one process; a step's median over the last quarter of a round",
                                    "so that what else the machine does falls on all alike")],
        grids=[_whole(samples), _storages(times)],
        drawings=[Drawing("storages", caption, figure)],
    )  # fmt: skip


def _times(study: Study, size: int) -> dict[str, list[float]]:
    rounds = study.size(ROUNDS, QUICK_ROUNDS)
    found: dict[str, list[float]] = {storage: [] for storage in STORES}
    for seed in range(rounds):
        study.progress(f"{size} landmarks", seed, rounds)
        driven = drive_round(size, PARTICLES, seed)
        for storage, values in found.items():
            values.append(driven.microseconds(storage))
    return found


def _claims(samples: list[Sample], times: dict[int, dict[str, list[float]]]) -> list[Claim]:
    whole = faster(
        f"With {IMPROVED.options['particles']} particles the improved algorithm is faster than the traditional one "
        f"with {TRADITIONAL.options['particles']}",
        [sample.microseconds(IMPROVED.label) for sample in samples],
        [sample.microseconds(TRADITIONAL.label) for sample in samples],
    )
    trees = [
        faster(f"The tree alone makes it faster than one array per particle, {size} landmarks", found["tree"],
               found["dense"])
        for size, found in times.items() if size >= LARGE
    ]  # fmt: skip
    return [whole, *trees]


def _whole(samples: list[Sample]) -> Grid:
    rows = []
    for spec in (TRADITIONAL, IMPROVED):
        errors = np.concatenate([sample.of_runs(spec.label, ROBOT) for sample in samples])
        times = [sample.microseconds(spec.label) for sample in samples]
        options = ", ".join(f"{key}={value}" for key, value in spec.options.items())
        rows.append([f"{spec.label}: {spec.name}, {options}", with_interval(times, 1), with_interval(errors, 4)])
    columns = ("algorithm", "time per step [us]", "robot error [m]")
    return Grid("The whole algorithm, 20 landmarks", columns, rows, "In brackets 95 % intervals over batches and runs.")


def _storages(times: dict[int, dict[str, list[float]]]) -> Grid:
    rows = [
        [str(size), *(with_interval(found[storage], 0) for storage in STORES),
         f"{np.mean(found['dense']) / np.mean(found['tree']):.2f}"]
        for size, found in times.items()
    ]  # fmt: skip
    columns = ("landmarks", *(f"{words} [us]" for words in STORES.values()), "arrays over tree")
    return Grid(
        "Storages", columns, rows, f"Time per step of {FILTER} with {PARTICLES} particles, about ten landmarks seen."
    )


EXPERIMENT = Experiment(
    "rbpf-time",
    "wang-2019",
    "Section 4: computing time",
    "time of the improved algorithm, and what the tree gives",
    run,
)
