"""What a check is, a function of a `Subject` that raises `BrokenContractError` with a reason, and what checks need."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from estimators._recording import MOTION, SENSOR, TARGET_MODEL, Recording, Step, feed, start
from estimators.interface import Belief, Estimator, Floats, Scan

LANES, STEPS, CAPACITY = 3, 25, 12
PSD_TOLERANCE = 1e-9  # negative eigenvalues, of the largest
COVARIANCES = ("pose_cov", "target_cov", "target_position_cov", "target_velocity_cov", "target_rel_cov",
               "landmark_cov", "landmark_rel_cov")  # fmt: skip
FIELDS = (*Belief._CORE, *Belief._MAP)


class BrokenContractError(Exception):
    """The contract does not hold; the message says what was expected and what came."""


@dataclass(frozen=True)
class Subject:
    """The estimator under test."""

    cls: type[Estimator]
    options: dict[str, Any]

    def make(self, num_lanes: int = LANES, **changes: Any) -> Estimator:
        """Build one for the standard recording; `changes` replace `target`, `max_landmarks` or options."""
        settings = {"max_landmarks": CAPACITY, **self.options, **changes}
        target = settings.pop("target", TARGET_MODEL)
        return self.cls(MOTION, SENSOR, target, num_lanes=num_lanes, **settings)

    def run(self, recording: Recording, **changes: Any) -> Estimator:
        """Build one and run it through a recording from a known start."""
        estimator = self.make(len(recording.seeds), **changes)
        start(estimator, recording)
        feed(estimator, recording)
        return estimator

    def accepts(self, option: str) -> bool:
        """Whether the constructor, or one that it passes options on to, names that option."""
        makers = [vars(cls)["__init__"] for cls in self.cls.__mro__ if "__init__" in vars(cls)]
        return any(option in inspect.signature(maker).parameters for maker in makers)


CHECKS: dict[str, Callable[[Subject], None]] = {}


def check(function: Callable[[Subject], None]) -> Callable[[Subject], None]:
    """Add a function to `CHECKS` under its own name."""
    CHECKS[function.__name__] = function
    return function


def need(condition: Any, message: str) -> None:
    """Raise `BrokenContractError` unless the condition holds."""
    if not condition:
        raise BrokenContractError(message)


def snapshot(estimator: Estimator, lanes: Any = slice(None)) -> dict[str, Any]:
    """Copies of every field of the belief."""
    return {name: np.array(getattr(estimator.belief, name)[lanes]) for name in FIELDS}


def need_same(first: dict[str, Any], second: dict[str, Any], where: str) -> None:
    """Raise `BrokenContractError` where two beliefs differ in any bit of a number."""
    for name in FIELDS:
        if not np.array_equal(first[name], second[name]):
            gap = np.max(np.abs(first[name].astype(float) - second[name].astype(float)))
            raise BrokenContractError(
                f"belief.{name} must be the same bit for bit {where}; the largest difference is {gap:.3g}"
            )


def need_sound(estimator: Estimator, where: str) -> None:
    """Raise `BrokenContractError` unless the belief is finite, symmetric, positive semidefinite and wrapped."""
    belief = snapshot(estimator)
    for name, values in belief.items():
        need(np.isfinite(values).all(), f"belief.{name} must be finite {where}; it holds NaN or infinity")
    for name in COVARIANCES:
        need_covariance(name, belief[name], where)
    for name, values in (("pose", belief["pose"][:, 2]), ("target_heading", belief["target_heading"])):
        inside = (values >= -np.pi) & (values < np.pi)
        need(inside.all(), f"belief.{name}: the heading must lie in [-pi, pi) {where}; got {values[~inside]}")
    need((belief["target_heading_var"] >= 0.0).all(), f"belief.target_heading_var must not be negative {where}")


def need_covariance(name: str, cov: Floats, where: str) -> None:
    """Raise `BrokenContractError` unless every matrix [..., n, n] is symmetric and positive semidefinite."""
    if cov.shape[-1] == 0 or cov.size == 0:
        return
    size = np.abs(cov).max(axis=(-2, -1)) + np.finfo(float).tiny
    skew = (np.abs(cov - np.swapaxes(cov, -1, -2)).max(axis=(-2, -1)) / size).max()
    need(skew <= PSD_TOLERANCE, f"belief.{name} must be symmetric {where}; relative difference {skew:.3g}")
    least = (np.linalg.eigvalsh(cov)[..., 0] / size).min()
    need(
        least >= -PSD_TOLERANCE,
        f"belief.{name} must be positive semidefinite {where}; least eigenvalue {least:.3g} of the largest entry",
    )


def edited(recording: Recording, edit: Callable[[int, Step], Scan]) -> Recording:
    """The recording with every sweep replaced by `edit(index, step)`."""
    steps = [replace(step, scan=edit(i, step)) for i, step in enumerate(recording.steps)]
    return replace(recording, steps=steps)


def without(scan: Scan, label: int) -> Scan:
    """The sweep without the returns of that label."""
    out = Scan.empty(*scan.ranges.shape)
    for lane in range(len(scan.count)):
        n = scan.count[lane]
        kept = np.flatnonzero(scan.labels[lane, :n] != label)
        out.count[lane] = len(kept)
        for name in ("ranges", "bearings", "labels"):
            getattr(out, name)[lane, : len(kept)] = getattr(scan, name)[lane, kept]
    return out
