"""A landmark budget: keep the landmarks that were seen lately, marginalise the others out.

Eqs. (32)-(36), Tian et al. 2010. Of the last m sweeps the newest counts m, the oldest 1; a landmark weighs the sum over
the sweeps that held it. Above the budget the lightest goes, of two equally light ones the one unseen for longer. Its
rows and columns are deleted, so what it taught the others stays; seen again, it is a new landmark.

A budget below the number of landmarks visible at once would drop each as it is seen: in such a sweep all that are seen
stay, and the sweep is counted.
"""

from typing import TYPE_CHECKING

import numpy as np

from estimators.interface import Ints, Scan
from estimators.kernels.bound import LATER
from estimators.kernels.gaussian import remove_landmark
from estimators.kernels.jit import inline, jit

if TYPE_CHECKING:
    from estimators.gaussian.layout import Call, GaussianEstimator

WINDOW = 10  # m, sweeps that count
MAX_WINDOW = 62  # one bit of an integer per sweep
COUNTERS = (
    "marginalised",  # a landmark dropped to keep within the budget
    "budget_widened",  # a sweep that held more landmarks than the budget
)
MARGINALISED, WIDENED = range(len(COUNTERS))


class LandmarkBudget:
    """What a budget remembers: which of the last sweeps held each landmark of each lane.

    Args:
        owner: the filter whose map it keeps small.
        limit: MAXLM, landmarks to keep.
        window: m, sweeps that count.

    Raises:
        ValueError: a limit or a window outside its range.
    """

    def __init__(self, owner: "GaussianEstimator", limit: int, window: int = WINDOW) -> None:
        if isinstance(limit, bool) or not isinstance(limit, int | np.integer) or limit < 1:
            raise ValueError(f"budget must be a whole number of landmarks, at least 1, or None; got {limit!r}")
        if not 1 <= window <= MAX_WINDOW:
            raise ValueError(f"the budget's window must be 1 to {MAX_WINDOW} sweeps; got {window!r}")
        self.owner, self.limit, self.window = owner, int(limit), int(window)
        shape = (owner.num_lanes, owner.max_landmarks)
        self.seen: Ints = np.zeros(shape, dtype=np.int64)  # [L, M] bit k: in the sweep k sweeps ago
        self.unseen: Ints = np.zeros(shape, dtype=np.int64)  # [L, M] sweeps since the last sighting
        self.counters: Ints = np.zeros((owner.num_lanes, len(COUNTERS)), dtype=np.int64)

    def reset(self, lanes: Ints) -> None:
        """Forget everything about these lanes."""
        for array in (self.seen, self.unseen, self.counters):
            array[lanes] = 0

    def keeping(self, scan: Scan) -> "Call":
        """Takes note of a sweep, whose landmarks stand in the owner's `slots`, and drops what is too much."""
        own = self.owner
        return (
            keep_within, self.limit, self.window, self.seen, self.unseen, self.counters, own.mu, own.P, own.count,
            own.ids, own.first, own.n_t, own.slots, scan.count, LATER,
        )  # fmt: skip

    @property
    def counts(self) -> dict[str, Ints]:
        """What the budget did since `reset`, by name: [L] integers."""
        return {name: self.counters[:, i].copy() for i, name in enumerate(COUNTERS)}

    def get_state(self) -> dict[str, Ints]:
        """Everything that changes between calls, as copies."""
        return {"seen": self.seen.copy(), "unseen": self.unseen.copy(), "counters": self.counters.copy()}

    def set_state(self, state: dict[str, Ints]) -> None:
        """Restore what `get_state` returned."""
        for name, array in state.items():
            getattr(self, name)[...] = array


@inline
def weight(bits, window):
    """Eq. (35) of one landmark: m for the newest sweep, 1 for the oldest."""
    total = 0
    for k in range(window):
        if bits & (1 << k):
            total += window - k
    return total


@inline
def note_sweep(seen, unseen, lane, count, window, slots, num_returns):
    """Age every landmark by a sweep and mark those seen in it; returns how many were."""
    for slot in range(count):
        seen[lane, slot] = (seen[lane, slot] << 1) & ((1 << window) - 1)
        unseen[lane, slot] += 1
    seen_now = 0
    for k in range(num_returns):
        slot = slots[lane, k]
        if slot >= 0 and not seen[lane, slot] & 1:
            seen[lane, slot] |= 1
            unseen[lane, slot] = 0
            seen_now += 1
    return seen_now


@inline
def lightest(seen, unseen, lane, count, window, spare_seen):
    """The slot to drop: least weight, then longest unseen, then first; -1 where all are to be spared."""
    best, best_weight, best_unseen = -1, 0, 0
    for slot in range(count):
        if spare_seen and unseen[lane, slot] == 0:
            continue
        w = weight(seen[lane, slot], window)
        if best < 0 or w < best_weight or (w == best_weight and unseen[lane, slot] > best_unseen):
            best, best_weight, best_unseen = slot, w, unseen[lane, slot]
    return best


@jit
def keep_within(limit, window, seen, unseen, counters, mu, P, count, ids, first, n_t, slots, num_returns, lanes):
    """Take note of a sweep and drop landmarks down to the budget. Eqs. (32)-(36), Tian et al. 2010.

    Args:
        seen, unseen: [L, M] see `LandmarkBudget`. counters: [L, 2] by `COUNTERS`.
        slots: [L, K] the slot of each return, negative where it is no landmark's.
    """
    for i in range(lanes.size):
        lane = lanes[i]
        seen_now = note_sweep(seen, unseen, lane, count[lane], window, slots, num_returns[lane])
        widened = seen_now > limit and count[lane] > limit
        if widened:
            counters[lane, WIDENED] += 1
        while count[lane] > max(limit, seen_now):
            slot = lightest(seen, unseen, lane, count[lane], window, widened)
            last = count[lane] - 1
            remove_landmark(mu, P, count, ids, first, lane, slot, n_t)
            seen[lane, slot], unseen[lane, slot] = seen[lane, last], unseen[lane, last]
            seen[lane, last], unseen[lane, last] = 0, 0
            counters[lane, MARGINALISED] += 1


def numbers_stored(
    method: str, num_landmarks: int, *, budget: int = 10, window: int = WINDOW, particles: int = 10
) -> int:
    """How many numbers a filter keeps at most in a world of LN landmarks. Eqs. (40)-(42), Tian et al. 2010.

    Args:
        method: "cdkf" (a budget of landmarks and its ring of sweeps), "ekf" or "fastslam".
        num_landmarks: LN. budget: MAXLM. window: m. particles: PMAX.

    Raises:
        ValueError: another method.
    """
    if method == "cdkf":
        n = 3 + 2 * budget
        return n + n * n + window * num_landmarks
    if method == "ekf":
        n = 3 + 2 * num_landmarks
        return n + n * n
    if method == "fastslam":
        return particles * ((3 + 9) + num_landmarks * (2 + 4))
    raise ValueError(f"method must be 'cdkf', 'ekf' or 'fastslam'; got {method!r}")
