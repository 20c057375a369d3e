"""What the processor can do at best: its peak of fused multiply-adds, and BLAS for an update's arithmetic."""

from typing import Any

import numpy as np
from scipy.linalg.blas import dsyrk

from estimators.kernels.jit import jit
from slam_gym.benchmark.timing import Work, least_seconds

CHAINS = 16  # independent sums of eight numbers, so that no addition waits for another
LENGTH = 20_000


@jit
def _multiply_add(sums, factor, count):
    """Sums [CHAINS * 8] <- sums * factor + 1, count times; all of them stay in registers or the first cache."""
    for _ in range(count):
        for i in range(sums.shape[0]):
            sums[i] = sums[i] * factor + 1.0


def peak_gflops(rounds: int = 20) -> float:
    """Multiplications and additions per nanosecond of one core, as compiled code reaches them."""
    sums = np.ones(CHAINS * 8)
    seconds = least_seconds({"peak": lambda: _multiply_add(sums, 0.5, LENGTH)}, rounds=rounds)["peak"]
    return 2.0 * sums.size * LENGTH / seconds / 1e9


def dsyrk_work(n: int, rank: int) -> Work:
    """A symmetric update of an n x n matrix by a product of that rank, in place: an update's arithmetic."""
    rng = np.random.default_rng(0)
    rows: Any = np.asfortranarray(1e-9 * rng.standard_normal((n, rank)))
    matrix: Any = np.asfortranarray(np.eye(n))
    return lambda: dsyrk(-1.0, rows, beta=1.0, c=matrix, overwrite_c=1, lower=1)
