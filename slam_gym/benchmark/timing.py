"""The least time of each of several calls, measured in turn: what a machine can do, whoever else uses it.

Two calls measured one after the other may meet different loads and clock rates. Measured in turn, many times, the least
of each has met the same best moments, so their ratio holds where their times do not. BLAS is held to one thread, as
everything else is: with two it would wait for a core that another program has.
"""

import gc
from collections.abc import Callable, Mapping
from time import perf_counter

from threadpoolctl import threadpool_limits

Work = Callable[[], object]


def least_seconds(
    works: Mapping[str, Work], *, rounds: int = 30, slice_seconds: float = 0.01, renew: Work | None = None
) -> dict[str, float]:
    """Seconds per call of each, the least over the rounds.

    Args:
        works: the calls by name.
        rounds: how often each is measured.
        slice_seconds: how long one measurement lasts, about; at least one call.
        renew: called before every fifth round, for works that change as they go.
    """
    counts: dict[str, int] = {}
    best = dict.fromkeys(works, float("inf"))
    gc_was_on = gc.isenabled()
    gc.disable()
    try:
        with threadpool_limits(1):
            for round_ in range(rounds):
                if renew is not None and round_ % 5 == 0:
                    renew()
                for name, work in works.items():
                    count = counts.get(name) or _calls_in(work, slice_seconds)
                    counts[name] = count
                    began = perf_counter()
                    for _ in range(count):
                        work()
                    best[name] = min(best[name], (perf_counter() - began) / count)
    finally:
        if gc_was_on:
            gc.enable()
    return best


def _calls_in(work: Work, seconds: float) -> int:
    """How many calls last about that long; the first, which may compile, does not count."""
    work()
    began = perf_counter()
    work()
    return max(1, int(seconds / max(perf_counter() - began, 1e-7)))
