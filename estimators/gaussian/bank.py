"""A bank: several copies of a filter side by side, each under one hypothesis about the target; one Gaussian to the eye.

Composition, not a filter of its own: the members are lanes of a second filter of the owner's class, so every filter of
the family can carry hypotheses, with its own linearisation and landmark budget. Each member holds a whole joint
Gaussian, so the target's cross covariances with robot and landmarks are those of its hypothesis. While a lane is open,
the owner's mean and covariance are the mixture's moments; when it is closed, the owner goes on from them.

A prediction costs O(n) per member, as ever; a sweep an update per member and the moments, O(n^2) each.
"""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np

from estimators.gaussian.mixture import collapse, weigh
from estimators.gaussian.sweep import REINITIALISED
from estimators.interface import Floats, Ints, Scan
from estimators.kernels.gaussian import ROBOT

if TYPE_CHECKING:
    from estimators.gaussian.layout import GaussianEstimator

_OF_THE_MIXTURE = ("mu", "P", "models")  # arrays of a filter's state that are not simply a member's


class Bank(ABC):
    """Hypotheses about the target in those lanes of a filter that are `open`.

    Args:
        owner: the filter. size: G, hypotheses.

    Attributes:
        open: [L] lanes under hypotheses. w: [L, G] their weights. elapsed: [L] seconds predicted since the last sweep.
        members: the filter with L G lanes, member g of lane l in lane l G + g; None until a lane is opened.
    """

    def __init__(self, owner: "GaussianEstimator", size: int) -> None:
        self.owner, self.size = owner, size
        L = owner.num_lanes
        self.open = np.zeros(L, dtype=np.bool_)
        self.w: Floats = np.zeros((L, size))
        self.elapsed: Floats = np.zeros(L)
        self.members: GaussianEstimator | None = None
        self._stale = np.zeros(L, dtype=np.bool_)  # lanes predicted since their moments were taken
        self._restart = np.zeros(L, dtype=np.bool_)  # scratch
        self._score: Floats = np.zeros(size)  # scratch
        self._dev: Floats = np.zeros((size + 1, owner.n_max))  # scratch

    @abstractmethod
    def _build(self) -> "GaussianEstimator":
        """The members."""

    @abstractmethod
    def _candidates(self, lanes: Ints) -> Ints:
        """Which of these closed lanes are to be opened."""

    @abstractmethod
    def _tell_apart(self, lanes: Ints) -> None:
        """Give the members of freshly opened lanes their hypotheses and weights."""

    @abstractmethod
    def _switch(self, members: "GaussianEstimator", lanes: Ints) -> None:
        """What happens to the hypotheses themselves between two sweeps."""

    def _settled(self, lanes: Ints) -> Ints:
        """Which of these open lanes one Gaussian describes well enough for good."""
        return lanes[:0]

    def _grown(self) -> "GaussianEstimator":
        """The members, built where there are none yet."""
        if self.members is None:
            self.members = self._build()
        return self.members

    def rows(self, lanes: Ints) -> Ints:
        """The members of these lanes: [n G]."""
        return np.asarray((lanes[:, None] * self.size + np.arange(self.size)).ravel())

    def admit(self, lanes: Ints) -> None:
        """Open lanes whose target has come to need hypotheses."""
        closed = lanes[~self.open[lanes]]
        fresh = self._candidates(closed) if closed.size else closed
        if not fresh.size:
            return
        members, own, rows = self._grown(), self.owner, self.rows(fresh)
        for theirs, ours in zip(_arrays(members), _arrays(own), strict=True):
            theirs[rows] = np.repeat(ours[fresh], self.size, axis=0)
        self.open[fresh] = True
        self.elapsed[fresh] = 0.0
        self._tell_apart(fresh)
        self._take_moments(fresh)

    def close(self, lanes: Ints) -> None:
        """End the hypotheses in these lanes; the owner goes on alone."""
        self.open[lanes] = self._stale[lanes] = False

    def predict(self, control: Floats, dt: Floats, lanes: Ints) -> Ints:
        """Move the members of open lanes; the lanes that are left to the owner."""
        is_open = self.open[lanes]
        members = self.members
        if members is None or not is_open.any():
            return lanes
        chosen = lanes[is_open]
        members.predict(np.repeat(control, self.size, 0), np.repeat(dt, self.size), lanes=self.rows(chosen))
        self.elapsed[chosen] += dt[chosen]
        self._stale[chosen] = True
        return lanes[~is_open]

    def update(self, scan: Scan, lanes: Ints) -> Ints:
        """Take a sweep in open lanes; the lanes left to the owner, those whose target starts anew among them."""
        is_open = self.open[lanes]
        members = self.members
        if members is None or not is_open.any():
            return lanes
        chosen = lanes[is_open]
        self._switch(members, chosen)
        self.elapsed[chosen] = 0.0
        points, at, _ = members.linear_points()
        weigh(
            members.mu, members.P, members.models, self.owner.models, self.w, points, at, scan.ranges, scan.bearings,
            scan.labels, scan.count, self._restart, self._score, chosen,
        )  # fmt: skip
        anew = chosen[self._restart[chosen]]
        if anew.size:
            self._start_anew(anew)
            chosen = chosen[~self._restart[chosen]]
        members.update(_repeated(scan, self.size), lanes=self.rows(chosen))
        self._take_moments(chosen)
        self.close(self._settled(chosen))
        return np.concatenate([lanes[~is_open], anew])

    def _start_anew(self, lanes: Ints) -> None:
        """The target of these lanes could not have caused its return: back to one not yet seen."""
        own, end = self.owner, ROBOT + self.owner.n_t
        self._take_moments(lanes)
        own.mu[lanes, ROBOT:end] = own.P[lanes, ROBOT:end] = own.P[lanes, :, ROBOT:end] = 0.0
        own.target_known[lanes] = False
        own.pending[lanes] = 0.0
        own.counters[lanes, REINITIALISED] += 1
        self.close(lanes)

    def _take_moments(self, lanes: Ints) -> None:
        """Everything the owner shows of these lanes: the mixture's moments, the rest as the heaviest member has it."""
        own, members = self.owner, self.members
        if members is None or not lanes.size:
            return
        best = lanes * self.size + self.w[lanes].argmax(axis=1)
        for theirs, ours in zip(_arrays(members), _arrays(own), strict=True):
            ours[lanes] = theirs[best]
        self._stale[lanes] = True
        self.refresh()

    def refresh(self) -> None:
        """Bring the owner's mean and covariance up to date with the members."""
        lanes = np.flatnonzero(self._stale)
        own, members = self.owner, self.members
        if members is None or not lanes.size:
            return
        self._stale[lanes] = False
        collapse(
            members.mu, members.P, self.w, members.models, members.n_t, members.count, own.mu, own.P, self._dev, lanes
        )

    def get_state(self) -> dict[str, Any]:
        """Everything that changes between calls, as copies."""
        state: dict[str, Any] = {name: getattr(self, name).copy() for name in ("open", "w", "elapsed", "_stale")}
        return state | {"members": None if self.members is None else self.members.get_state()}

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` returned."""
        for name in ("open", "w", "elapsed", "_stale"):
            getattr(self, name)[...] = state[name]
        if state["members"] is not None:
            self._grown().set_state(state["members"])


def _repeated(scan: Scan, size: int) -> Scan:
    """Every lane's sweep as often as it has members."""
    return Scan(
        np.repeat(scan.ranges, size, 0), np.repeat(scan.bearings, size, 0), np.repeat(scan.labels, size, 0),
        np.repeat(scan.count, size), np.repeat(scan.complete, size),
    )  # fmt: skip


def _arrays(one: "GaussianEstimator") -> list[Any]:
    """The arrays of a filter that a member and its owner share row by row, means and covariances first."""
    names = ["mu", "P", *(name for name in one._state_names if name not in _OF_THE_MIXTURE)]
    found = [getattr(one, name) for name in names]
    return found if one.budget is None else [*found, one.budget.seen, one.budget.unseen, one.budget.counters]
