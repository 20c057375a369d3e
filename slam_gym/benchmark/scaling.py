"""How cost and memory grow: with the map, with the particles, with the lanes."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from estimators.interface import Estimator
from slam_gym.benchmark.environment import native, vector_work
from slam_gym.benchmark.filters import our_work
from slam_gym.benchmark.stream import STEPS, make_stream, settled
from slam_gym.benchmark.timing import least_seconds

Bar = Callable[[], None]  # called when a measurement is done


def landmark_rows(names: Sequence[str], counts: Sequence[int], rounds: int, done: Bar) -> list[dict[str, Any]]:
    """Rows (name, landmarks, microseconds per step, bytes): a filter's step against the size of its map."""
    rows = []
    for name in names:
        for count in counts:
            stream = make_stream(count)
            seconds = least_seconds({name: our_work(name, stream)}, rounds=rounds)[name] / STEPS
            rows.append({"name": name, "landmarks": count, "microseconds": 1e6 * seconds,
                         "bytes": state_bytes(settled(name, stream))})  # fmt: skip
            done()
    return rows


def particle_rows(names: Sequence[str], counts: Sequence[int], rounds: int, done: Bar) -> list[dict[str, Any]]:
    """Rows (name, particles, microseconds per step, bytes) with 20 landmarks."""
    rows, stream = [], make_stream(20)
    for name in names:
        for count in counts:
            seconds = least_seconds({name: our_work(name, stream, particles=count)}, rounds=rounds)[name] / STEPS
            rows.append({"name": name, "particles": count, "microseconds": 1e6 * seconds,
                         "bytes": state_bytes(settled(name, stream, particles=count))})  # fmt: skip
            done()
    return rows


def lane_rows(counts: Sequence[int], rounds: int, done: Bar) -> list[dict[str, Any]]:
    """Rows (lanes, microseconds per lane and step) of the vector environment."""
    rows = []
    for count in counts:
        env = native(count)
        env.reset(seed=0)
        work = vector_work(env)
        seconds = least_seconds({"env": work}, rounds=rounds)["env"] / count
        rows.append({"lanes": count, "microseconds": 1e6 * seconds})
        env.close()
        done()
    return rows


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """P of the power law cost ~ size^p through the upper half of the points, by least squares of the logarithms."""
    half = min(len(sizes) // 2, len(sizes) - 2)
    return float(np.polyfit(np.log(sizes[half:]), np.log(costs[half:]), 1)[0])


def state_bytes(estimator: Estimator) -> int:
    """What an estimator keeps between calls, in bytes of one lane."""
    return _bytes(estimator.get_state()) // estimator.num_lanes


def _bytes(value: Any) -> int:
    if isinstance(value, np.ndarray):
        return int(value.nbytes)
    if isinstance(value, dict):
        return sum(map(_bytes, value.values()))
    if isinstance(value, (list, tuple)):
        return sum(map(_bytes, value))
    return 0
