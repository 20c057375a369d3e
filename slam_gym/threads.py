"""Lanes shared out among threads: each takes a run of them, and the same call with scratch of its own."""

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.kernels.bound import Bound

Ints = NDArray[np.int64]
WORTH_IT = 32  # lanes, below which handing over costs more than it saves


class Crew:
    """Some threads, the calling one among them; a forked process starts its own when it needs them.

    Args:
        count: T, at least 1.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool: ThreadPoolExecutor | None = None
        self._process = 0

    def run(self, jobs: Sequence[tuple[Callable[..., Any], Any]]) -> list[Any]:
        """What each function returns for its argument; the calling thread does the first job, and what is left over."""
        if len(jobs) == 1:
            return [jobs[0][0](jobs[0][1])]
        if self._pool is None or self._process != os.getpid():  # a fork copies the pool, but not its threads
            self._pool = ThreadPoolExecutor(self.count - 1, thread_name_prefix="slam-gym")
            self._process = os.getpid()
        others = [self._pool.submit(function, argument) for function, argument in jobs[1:]]
        results = [jobs[0][0](jobs[0][1])]
        for (function, argument), one in zip(jobs[1:], others, strict=True):
            # Where a neighbour holds the other core, a thread may not have begun: it is not waited for.
            results.append(function(argument) if one.cancel() else one.result())
        return results


class Shared:
    """A bound kernel that takes lanes, run by a crew.

    Args:
        call: takes lanes [n] and touches theirs alone, but for the scratch.
        scratch: arrays that it writes and nobody reads.
        num_lanes: L. crew: who runs it.
    """

    def __init__(self, call: Bound, scratch: Iterable[Any], num_lanes: int, crew: Crew) -> None:
        self._crew, self._num_lanes = crew, num_lanes
        scratch = tuple(scratch)
        self._calls = [call, *(call.apart(scratch) for _ in range(crew.count - 1))]
        self._all = np.array_split(np.arange(num_lanes), crew.count)

    def __call__(self, lanes: Ints) -> bool:
        """Whether all parts returned True."""
        if len(lanes) < WORTH_IT:
            return bool(self._calls[0](lanes))
        parts = self._all if len(lanes) == self._num_lanes else np.array_split(lanes, self._crew.count)
        return all(self._crew.run(list(zip(self._calls, parts, strict=True))))
