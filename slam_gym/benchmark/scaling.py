"""How cost and memory grow: with the map, with the particles, with the lanes."""

from collections.abc import Sequence
from contextlib import closing
from typing import Any

import numpy as np

from estimators.interface import Estimator
from slam_gym.benchmark.environment import native, vector_work
from slam_gym.benchmark.filters import our_work
from slam_gym.benchmark.stream import STEPS, make_stream, settled
from slam_gym.benchmark.timing import least_seconds


def landmark_rows(name: str, count: int, rounds: int) -> list[dict[str, Any]]:
    """A row (name, landmarks, microseconds per step, bytes): a filter's step with a map of that size."""
    stream = make_stream(count)
    seconds = least_seconds({name: our_work(name, stream)}, rounds=rounds)[name] / STEPS
    return [{"name": name, "landmarks": count, "microseconds": 1e6 * seconds,
             "bytes": state_bytes(settled(name, stream))}]  # fmt: skip


def particle_rows(name: str, count: int, rounds: int) -> list[dict[str, Any]]:
    """A row (name, particles, microseconds per step, bytes) with 20 landmarks."""
    stream = make_stream(20)
    seconds = least_seconds({name: our_work(name, stream, particles=count)}, rounds=rounds)[name] / STEPS
    return [{"name": name, "particles": count, "microseconds": 1e6 * seconds,
             "bytes": state_bytes(settled(name, stream, particles=count))}]  # fmt: skip


def lane_rows(count: int, rounds: int) -> list[dict[str, Any]]:
    """A row (lanes, microseconds per lane and step) of the vector environment."""
    with closing(native(count)) as env:
        env.reset(seed=0)
        seconds = least_seconds({"env": vector_work(env)}, rounds=rounds)["env"] / count
    return [{"lanes": count, "microseconds": 1e6 * seconds}]


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
