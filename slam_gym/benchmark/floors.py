"""What the processor can do at best, as BLAS does it: its peak, and an update's arithmetic."""

from typing import Any

import numpy as np
from scipy.linalg.blas import dgemm, dsyrk

from slam_gym.benchmark.timing import Work, least_seconds

SIDE = 512  # of the matrices whose product is as near to the peak as anything


def peak_gflops(rounds: int = 20) -> float:
    """Multiplications and additions per nanosecond of one core, as BLAS reaches them in a product of large matrices."""
    rng = np.random.default_rng(0)
    a, b, out = (np.asfortranarray(rng.standard_normal((SIDE, SIDE))) for _ in range(3))
    work = {"peak": lambda: dgemm(1.0, a, b, beta=0.0, c=out, overwrite_c=1)}
    return 2.0 * SIDE**3 / least_seconds(work, rounds=rounds)["peak"] / 1e9


def dsyrk_work(n: int, rank: int) -> Work:
    """A symmetric update of an n x n matrix by a product of that rank, in place: an update's arithmetic."""
    rng = np.random.default_rng(0)
    rows: Any = np.asfortranarray(1e-9 * rng.standard_normal((n, rank)))
    matrix: Any = np.asfortranarray(np.eye(n))
    return lambda: dsyrk(-1.0, rows, beta=1.0, c=matrix, overwrite_c=1, lower=1)
