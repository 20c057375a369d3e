"""Lanes shared out among threads: each takes a run of them, and the same calls with scratch of its own."""

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.kernels.bound import Bound

Ints = NDArray[np.int64]
WORTH_IT = 32  # lanes, below which handing over costs more than it saves
BLOCK = 32  # lanes that go through all calls together: half a megabyte of covariances, that a second cache holds


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
    """Bound kernels that take lanes, one after the other for some lanes at a time, by a crew where there is one.

    Args:
        calls: each takes lanes [n] and touches theirs alone, but for the scratch. A lane's next call follows while
            what the last one left is still near the processor.
        scratch: arrays that they write and nobody reads.
        num_lanes: L. crew: who runs them.
    """

    def __init__(self, calls: Sequence[Bound], scratch: Iterable[Any], num_lanes: int, crew: Crew) -> None:
        self._crew, self._num_lanes = crew, num_lanes
        scratch = tuple(scratch)
        self._calls = [tuple(calls), *(tuple(call.apart(scratch) for call in calls) for _ in range(crew.count - 1))]
        self._all = [_blocks(part) for part in np.array_split(np.arange(num_lanes), crew.count)]

    def __call__(self, lanes: Ints) -> bool:
        """Whether all calls returned True; in a block of lanes, one that did not was the last."""
        if len(lanes) < WORTH_IT or self._crew.count == 1:
            whole = len(lanes) == self._num_lanes and self._crew.count == 1
            return _run_blocks((self._calls[0], self._all[0] if whole else _blocks(lanes)))
        parts = self._all
        if len(lanes) < self._num_lanes:
            parts = [_blocks(part) for part in np.array_split(lanes, self._crew.count)]
        return all(self._crew.run([(_run_blocks, job) for job in zip(self._calls, parts, strict=True)]))


def _blocks(lanes: Ints) -> list[Ints]:
    return [lanes[i : i + BLOCK] for i in range(0, len(lanes), BLOCK)]


def _run_blocks(job: tuple[tuple[Bound, ...], list[Ints]]) -> bool:
    calls, blocks = job
    return all([all(call(block) for call in calls) for block in blocks])
