"""What an experiment is, and what comes out of one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from matplotlib.figure import Figure

from slam_gym.reproduce.study import Study
from slam_gym.reproduce.verdict import Claim


@dataclass(frozen=True, slots=True)
class Choice:
    """A setting that the paper left open, what was taken, and why."""

    what: str
    taken: str
    why: str


@dataclass(frozen=True, slots=True)
class Grid:
    """A table of texts; the first column names the rows."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure in the paper's layout; `name` becomes part of a file name."""

    name: str
    caption: str
    figure: Figure


@dataclass(frozen=True, slots=True)
class Outcome:
    """What an experiment found.

    Attributes:
        claims: the paper's, each put against an interval.
        choices: settings that the paper left open.
        grids: tables.
        drawings: figures.
        remarks: sentences; every number in them is computed.
        missing: why nothing could be measured; empty if something was.
    """

    claims: Sequence[Claim] = ()
    choices: Sequence[Choice] = ()
    grids: Sequence[Grid] = ()
    drawings: Sequence[Drawing] = ()
    remarks: Sequence[str] = ()
    missing: str = ""


@dataclass(frozen=True, slots=True)
class Experiment:
    """One table or figure of a paper.

    Attributes:
        name: what the command calls it.
        paper: key of `PAPERS`.
        source: which tables and figures.
        summary: one line.
        run: does it.
    """

    name: str
    paper: str
    source: str
    summary: str
    run: Callable[[Study], Outcome] = field(repr=False)


PAPERS: dict[str, str] = {
    "tian-2010": "X. Tian, L. Zhang, Y. Chen, Fast SLAM algorithm based on central difference Kalman filter, Journal "
    "of Harbin Institute of Technology 42(9), 1454-1461, 2010",
    "wu-2013": "M. Wu, J. Sun, Simultaneous localization, mapping and object tracking in an unknown environment using "
    "particle filtering, CAAI Transactions on Intelligent Systems 8(2), 168-176, 2013",
    "wang-2019": "H. Wang, P. Wang, Research and implementation of RBPF-SLAM algorithm, Computer Systems and "
    "Applications 28(7), 169-173, 2019",
    "geng-2024": "X. Geng, A new method for optimizing the consistency of EKF-SLAM algorithm based on "
    "multi-dimensional Taylor-net strategy, Pure Mathematics 14(5), 324-334, 2024",
}


def as_texts(rows: Sequence[Sequence[Any]]) -> list[list[str]]:
    """Rows of a `Grid`: everything as text."""
    return [[str(cell) for cell in row] for row in rows]
