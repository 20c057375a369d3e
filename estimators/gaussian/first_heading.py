"""A twist target at its first sighting: its place is known, its heading is not. A Gaussian sum over the circle.

A Gaussian as wide as the circle breaks every filter that linearises. Eight headings, each with the deviation of a
uniform sector, do not: Alspach and Sorenson, "Nonlinear Bayesian estimation using Gaussian sum approximations", 1972.
Every hypothesis is a joint Gaussian of its own (`estimators.gaussian.bank`); returns weigh them, and once the direction
is settled they are merged into one, with the moments of the mixture.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from estimators.gaussian.bank import Bank
from estimators.interface import Ints
from estimators.kernels.gaussian import ROBOT

if TYPE_CHECKING:
    from estimators.gaussian.layout import GaussianEstimator

HEADINGS = 8
SETTLED = 0.98  # length of the mixture's mean direction above which it is merged: a deviation of about 0.2 rad
_HEADING = ROBOT + 2


class HeadingBank(Bank):
    """Hypotheses of the target's heading, from its first sighting until they agree."""

    def __init__(self, owner: "GaussianEstimator") -> None:
        super().__init__(owner, HEADINGS)

    def _build(self) -> "GaussianEstimator":
        return self.owner.like(self.owner.num_lanes * self.size, self.owner.target)

    def _candidates(self, lanes: Ints) -> Ints:
        return lanes[~self.owner.target_known[lanes] & (self.owner.pending[lanes, 0] > 0.0)]

    def _tell_apart(self, lanes: Ints) -> None:
        members, rows = self._grown(), self.rows(lanes)
        sector = 2.0 * math.pi / self.size
        members.models[rows] = np.repeat(self.owner.models[lanes], self.size)
        members.models["reinitialise_nis"][rows] = members.models["reinitialise_spread"][rows] = math.inf
        # Counted from the robot's heading: what is believed must not depend on how the world's axes lie.
        turns = members.mu[rows, 2] + np.tile(sector * (np.arange(self.size) + 0.5), len(lanes))
        members.mu[rows, _HEADING] = (turns + math.pi) % (2.0 * math.pi) - math.pi
        members.P[rows, _HEADING, _HEADING] = sector * sector / 12.0
        members.target_known[rows] = True
        members.pending[rows] = 0.0
        members.after_change(rows)
        self.w[lanes] = 1.0 / self.size

    def _switch(self, members: "GaussianEstimator", lanes: Ints) -> None:
        """Nothing: a target keeps to the hypothesis that it started under."""

    def _settled(self, lanes: Ints) -> Ints:
        members = self._grown()
        rows = self.rows(lanes).reshape(-1, self.size)
        share = self.w[lanes] * np.exp(-0.5 * members.P[rows, _HEADING, _HEADING])
        heading = members.mu[rows, _HEADING]
        length = np.hypot((share * np.cos(heading)).sum(axis=1), (share * np.sin(heading)).sum(axis=1))
        return lanes[length > SETTLED]
