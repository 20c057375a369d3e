"""Checks of what a sweep may hold: nothing, any order, no labels, outliers."""

import copy

import numpy as np

from estimators._checks.contract import LANES, STEPS, Subject, check, edited, need, need_sound
from estimators._recording import feed, record, start, tell_truth
from estimators.interface import TARGET, Scan


@check
def empty_sweeps(subject: Subject) -> None:
    """A sweep without returns, and one with no room for any, is legal."""
    recording = record(LANES, STEPS)
    estimator = subject.make()
    start(estimator, recording)
    feed(estimator, recording, 0, 5)
    for width in (4, 0):
        for complete in (True, False):
            scan = Scan.empty(LANES, width)
            scan.complete[:] = complete
            tell_truth(estimator, recording, recording.steps[4])
            estimator.update(scan)
            need_sound(estimator, f"after an empty sweep of width {width}")


@check
def order_of_returns(subject: Subject) -> None:
    """A sweep is a set: the order of its returns hardly matters."""
    recording = record(LANES, STEPS)
    first = subject.run(recording)
    second = subject.run(edited(recording, lambda _, step: reversed_scan(step.scan)))
    gap = np.linalg.norm(first.belief.pose[:, :2] - second.belief.pose[:, :2], axis=1)
    bound = 0.05 + 2.0 * np.sqrt(np.trace(first.belief.pose_cov[:, :2, :2], axis1=1, axis2=2))
    need((gap < bound).all(), f"the order of a sweep's returns must hardly matter; the pose moved by {gap.max():.2f} m")
    known = (first.belief.target_known, second.belief.target_known)
    need(np.array_equal(*known), "the order of a sweep's returns must not decide whether the target is known")


def reversed_scan(scan: Scan) -> Scan:
    """The same returns, last first."""
    out = copy.deepcopy(scan)
    for lane, n in enumerate(scan.count):
        for name in ("ranges", "bearings", "labels"):
            getattr(out, name)[lane, :n] = getattr(scan, name)[lane, :n][::-1]
    return out


@check
def unlabelled_returns(subject: Subject) -> None:
    """Returns whose source the sensor does not tell are legal, with every association the estimator offers."""
    recording = record(LANES, STEPS, labelled=False)
    need_sound(subject.run(recording), "with unlabelled returns")
    if not subject.accepts("association"):
        return
    try:
        subject.make(association="nearest")
    except ValueError:
        return  # this estimator needs labels, and says so
    need_sound(subject.run(recording, association="nearest"), "with unlabelled returns and association='nearest'")


@check
def rough_sweeps(subject: Subject) -> None:
    """A return from nearby, the same label twice, and a return far off: counted at most, never NaN."""
    recording = record(LANES, STEPS)
    estimator = subject.make()
    start(estimator, recording)
    feed(estimator, recording, 0, 10)
    scan = Scan.empty(LANES, 6)
    scan.count[:] = 6
    scan.ranges[:] = [1e-6, 2.0, 2.0, 1e3, 1e-6, 3.0]
    scan.bearings[:] = [0.0, 1.0, 1.1, -np.pi, 2.0, -1.0]
    scan.labels[:] = [0, 1, 1, 2, TARGET, TARGET]
    tell_truth(estimator, recording, recording.steps[9])
    estimator.update(scan)
    need_sound(estimator, "after a sweep with outliers")
    feed(estimator, recording, 10)
    need_sound(estimator, "in the steps after a sweep with outliers")
