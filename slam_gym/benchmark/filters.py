"""One step of a filter, predict and nine updates, against other packages and against BLAS."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from slam_gym.benchmark.floors import dsyrk_work
from slam_gym.benchmark.foreign import FilterPyEKF, StoneSoupEKF
from slam_gym.benchmark.stream import DT, SEEN, STEPS, Stream, make_stream, settled
from slam_gym.benchmark.timing import Work, least_seconds

FOREIGN: dict[str, tuple[str, Callable[..., Any]]] = {
    "FilterPy": ("filterpy", FilterPyEKF),
    "Stone Soup": ("stonesoup", StoneSoupEKF),
}
RANK = 2 * (SEEN + 1)  # of a step's change of the covariance
SLOW_ROUNDS = 3  # of what takes milliseconds a step
LONG_WAY, FEW_SWEEPS = 320, 2  # steps of a whole circle, so that new landmarks keep coming; sweeps that make the map


def filter_rows(
    names: Sequence[str], landmarks: int = 20, rounds: int = 20, others: bool = True
) -> list[dict[str, Any]]:
    """Rows (name, microseconds per step, times as long as the first) of our estimators and those of other packages.

    A package that is not installed has no row, nor has any without `others`.
    """
    stream = make_stream(landmarks)
    seconds = least_seconds({name: our_work(name, stream) for name in names}, rounds=rounds)
    slow: dict[str, Work] = {}
    for name, (module, adapter) in FOREIGN.items():
        if others and installed(module):
            slow[name] = _foreign_work(adapter, stream)
    if others and installed("gtsam") and _known("isam2"):
        slow["GTSAM iSAM2, this package's `isam2`"] = our_work("isam2", stream)
    seconds |= least_seconds(slow, rounds=SLOW_ROUNDS)
    first = seconds[names[0]]
    return [
        {"name": name, "microseconds": 1e6 * second / STEPS, "times_ours": second / first}
        for name, second in seconds.items()
    ]


def blas_rows(landmarks: Sequence[int] = (20, 50, 100, 500), rounds: int = 20) -> list[dict[str, Any]]:
    """Rows (landmarks, microseconds of an EKF step, of BLAS's update of that rank, their ratio)."""
    return [_against_blas("ekf", n, make_stream(n), rounds) for n in landmarks]


def compressed_rows(landmarks: Sequence[int] = (100, 1000), rounds: int = 20) -> list[dict[str, Any]]:
    """As `blas_rows` for `compressed-ekf` on a way of `LONG_WAY` steps, all that it postpones in them included."""
    streams = {n: make_stream(n, before=FEW_SWEEPS, steps=LONG_WAY) for n in landmarks}
    return [_against_blas("compressed-ekf", n, stream, rounds) for n, stream in streams.items()]


def _against_blas(name: str, landmarks: int, stream: Stream, rounds: int) -> dict[str, Any]:
    works = {name: our_work(name, stream), "blas": dsyrk_work(7 + 2 * landmarks, RANK)}
    seconds = least_seconds(works, rounds=rounds)
    step = seconds[name] / len(stream.rest)
    return {"landmarks": landmarks, "microseconds": 1e6 * step, "blas_microseconds": 1e6 * seconds["blas"],
            "times_blas": step / seconds["blas"]}  # fmt: skip


def our_work(name: str, stream: Stream, num_lanes: int = 1, **options: Any) -> Work:
    """The stream's later steps once through one of our estimators, from the settled state on."""
    estimator = settled(name, stream, num_lanes, **options)
    state = estimator.get_state() if _has_state(estimator) else None
    steps = np.full(num_lanes, DT)
    sweeps = [(np.tile(sweep.control, (num_lanes, 1)), sweep.scan(num_lanes)) for sweep in stream.rest]
    bound = [estimator.bound_calls(control, steps, scan) for control, scan in sweeps]

    def work() -> None:
        if state is not None:
            estimator.set_state(state)
        for (control, scan), calls in zip(sweeps, bound, strict=True):
            if calls is None:
                estimator.predict(control, DT)
                estimator.update(scan)
            else:
                calls.predict(estimator.all_lanes)
                calls.update(estimator.all_lanes)

    return work


def _foreign_work(adapter: Callable[..., Any], stream: Stream) -> Work:
    start = settled("ekf", stream)

    def work() -> None:
        other = adapter(start)
        for sweep in stream.rest:
            other.step(sweep)

    return work


def installed(module: str) -> bool:
    """Whether a package can be imported."""
    from importlib.util import find_spec

    return find_spec(module) is not None


def _known(name: str) -> bool:
    from estimators import registry

    return name in registry.names()


def _has_state(estimator: Any) -> bool:
    try:
        estimator.get_state()
    except NotImplementedError:
        return False
    return True
