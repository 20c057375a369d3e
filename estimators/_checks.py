"""The checks behind `estimators.testing`: functions of a `Subject`, raising `BrokenContractError` with a reason."""

import copy
import inspect
import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, Recording, Step, feed, record, start, tell_truth
from estimators.interface import TARGET, Belief, Estimator, Floats, Scan

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


@check
def shapes_and_dtypes(subject: Subject) -> None:
    """The belief's buffers have the documented shapes and types."""
    estimator = subject.run(record(LANES, 3))
    fresh = Belief(estimator, LANES, CAPACITY, estimator.target_names)
    for name, values in snapshot(estimator).items():
        expected = fresh.buffers[name]
        need(values.shape == expected.shape, f"belief.{name} must have shape {expected.shape}; got {values.shape}")
        need(values.dtype == expected.dtype, f"belief.{name} must be {expected.dtype}; got {values.dtype}")


@check
def sound_belief(subject: Subject) -> None:
    """Finite, symmetric, positive semidefinite, wrapped, right after the reset and at every step."""
    recording = record(LANES, STEPS)
    estimator = subject.make()
    start(estimator, recording)
    need_sound(estimator, "after reset")
    for i in range(STEPS):
        feed(estimator, recording, i, i + 1)
        need_sound(estimator, f"after step {i + 1}")


@check
def follows_the_robot(subject: Subject) -> None:
    """The pose stays near the truth, the robot-frame target agrees with the world-frame one."""
    recording = record(LANES, STEPS)
    estimator = subject.run(recording)
    belief, truth = estimator.belief, recording.steps[-1]
    error = np.linalg.norm(belief.pose[:, :2] - truth.pose[:, :2], axis=1)
    bound = 0.3 + 4.0 * np.sqrt(np.trace(belief.pose_cov[:, :2, :2], axis1=1, axis2=2))
    need(
        (error < bound).all(),
        f"the pose must stay near the truth; errors {error.round(2)} m, bounds {bound.round(2)} m",
    )
    need(belief.target_known.all(), "the target is in every sweep: target_known must be true")
    for lane in range(LANES):
        c, s = np.cos(belief.pose[lane, 2]), np.sin(belief.pose[lane, 2])
        rel = np.array([[c, s], [-s, c]]) @ (belief.target_position[lane] - belief.pose[lane, :2])
        gap = np.linalg.norm(rel - belief.target_rel[lane])
        need(gap < 0.2, f"target_rel must be the target's position in the robot's frame; it is {gap:.2f} m off")
        miss = np.linalg.norm(belief.target_position[lane] - truth.target[lane, :2])
        need(miss < bound[lane] + 0.7, f"the target, just seen, must be near the truth; it is {miss:.2f} m off")


@check
def lanes_are_single_runs(subject: Subject) -> None:
    """L lanes give what L estimators of one lane give."""
    recording = record(LANES, STEPS)
    together = snapshot(subject.run(recording))
    for lane in range(LANES):
        alone = snapshot(subject.run(recording.lane(lane)))
        mine = {name: values[lane : lane + 1] for name, values in together.items()}
        need_same(mine, alone, f"for lane {lane} of {LANES} and for the same lane alone")


@check
def other_lanes_untouched(subject: Subject) -> None:
    """`lanes=` confines reset, predict and update."""
    recording = record(LANES, STEPS)
    estimator = subject.make()
    start(estimator, recording)
    feed(estimator, recording, 0, 8)
    before = snapshot(estimator)
    some = np.array([2, 0])
    feed(estimator, recording, 8, 12, lanes=some)
    untouched = {name: values[1:2] for name, values in before.items()}
    need_same(snapshot(estimator, slice(1, 2)), untouched, "in a lane that `lanes=` left out of predict and update")
    need(not np.array_equal(estimator.belief.pose[some], before["pose"][some]), "lanes named in `lanes=` must move")
    start(estimator, recording, lanes=some)
    need_same(snapshot(estimator, slice(1, 2)), untouched, "in a lane that `lanes=` left out of reset")
    need(np.allclose(estimator.belief.pose[some], recording.start[some]), "reset must restart the lanes named")


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
def wrapped_headings(subject: Subject) -> None:
    """Headings stay in [-pi, pi) through a full turn and from a start outside it."""
    recording = record(LANES, 1)
    estimator = subject.make()
    start(estimator, replace(recording, start=np.add(recording.start, [0.0, 0.0, 4.0 * np.pi])))
    control = np.tile([0.5, 1.5], (LANES, 1))
    for _ in range(45):
        tell_truth(estimator, recording, recording.steps[0])
        estimator.predict(control, DT)
        need_sound(estimator, "while turning on the spot")


@check
def degenerate_priors(subject: Subject) -> None:
    """A start known exactly, and one off along one direction only."""
    recording = record(LANES, STEPS)
    direction = np.array([0.3, 0.1, 0.05])
    for name, cov in (("zero", np.zeros((3, 3))), ("rank-one", np.outer(direction, direction))):
        estimator = subject.make()
        start(estimator, recording, pose_cov=cov)
        need(np.allclose(estimator.belief.pose_cov, cov, atol=0.05), f"pose_cov after reset must be the {name} prior")
        feed(estimator, recording, 0, 10)
        need_sound(estimator, f"from a {name} prior covariance")


@check
def crowded_map(subject: Subject) -> None:
    """More landmarks than there is room for: the excess is left out and counted."""
    recording = record(LANES, 10)
    if not subject.run(recording).belief.landmark_count.any():
        return  # this estimator keeps no map
    estimator = subject.run(recording, max_landmarks=2)
    need_sound(estimator, "with a full map")
    counts = {name: np.asarray(values) for name, values in estimator.counts.items()}
    for name, values in counts.items():
        need(values.shape == (LANES,), f"counts[{name!r}] must have one integer per lane; got shape {values.shape}")
    need((estimator.belief.landmark_count <= 2).all(), "a map may not grow beyond max_landmarks")
    total = sum(counts.values(), np.zeros(LANES))
    need((total > 0).all(), "landmarks beyond max_landmarks must be counted in `counts`")


@check
def no_target(subject: Subject) -> None:
    """`target=None` is legal, whatever the sweep holds."""
    estimator = subject.run(record(LANES, STEPS), target=None)
    need(not estimator.belief.target_known.any(), "target_known must be false where there is no target model")
    need(estimator.belief.target_mean.shape == (LANES, 0), "target_mean must have shape [L, 0] without a target model")
    need_sound(estimator, "without a target model")


@check
def twist_target(subject: Subject) -> None:
    """A target with a known twist works too, from a prior and from its first sighting."""
    model = replace(TARGET_MODEL, kind="twist", speed=0.3, turn_rate=0.1, speed_std=0.3, turn_std=0.3)
    recording = record(LANES, STEPS)
    estimator = subject.run(recording, target=model)
    need(estimator.belief.target_mean.shape == (LANES, 3), "a twist target's state is (x, y, heading)")
    need_sound(estimator, "with a twist target from its first sighting")
    estimator = subject.make(target=model)
    prior = np.column_stack([recording.target_start[:, :2], np.zeros(LANES)])
    pose_cov = np.zeros((3, 3))
    estimator.reset(recording.start, pose_cov, seeds=recording.seeds, target=prior, target_cov=0.04 * np.eye(3))
    need(np.allclose(estimator.belief.target_mean, prior, atol=0.5), "target_mean after reset must be the prior's")
    need(estimator.belief.target_known.all(), "a target prior makes the target known")
    feed(estimator, recording)
    need_sound(estimator, "with a twist target from a prior")


@check
def target_seen_late(subject: Subject) -> None:
    """Until its first sighting the target is unknown, its numbers zero."""
    recording = edited(record(LANES, 12), lambda i, step: without(step.scan, TARGET) if i < 6 else step.scan)
    estimator = subject.make()
    start(estimator, recording)
    feed(estimator, recording, 0, 6)
    need(not estimator.belief.target_known.any(), "target_known must be false before the first sighting")
    for name in FIELDS:
        if name.startswith("target_"):
            need(not np.any(getattr(estimator.belief, name)), f"belief.{name} must be zero while the target is unknown")
    feed(estimator, recording, 6, 12)
    need(estimator.belief.target_known.all(), "target_known must be true after the first sightings")
    need_sound(estimator, "after a late first sighting")


@check
def state_round_trip(subject: Subject) -> None:
    """`set_state(get_state())`, here and in another instance, continues bit for bit."""
    recording = record(LANES, STEPS)
    estimator = subject.make()
    start(estimator, recording)
    feed(estimator, recording, 0, 10)
    state = estimator.get_state()
    feed(estimator, recording, 10)
    expected = snapshot(estimator)
    for other in (estimator, subject.make()):
        other.set_state(copy.deepcopy(state))
        feed(other, recording, 10)
        need_same(snapshot(other), expected, "after get_state, set_state and the same steps again")


@check
def pickling(subject: Subject) -> None:
    """A pickled estimator continues bit for bit."""
    recording = record(LANES, STEPS)
    estimator = subject.make()
    start(estimator, recording)
    feed(estimator, recording, 0, 10)
    other = pickle.loads(pickle.dumps(estimator))
    need_same(snapshot(other), snapshot(estimator), "after pickling")
    feed(estimator, recording, 10)
    feed(other, recording, 10)
    need_same(snapshot(other), snapshot(estimator), "after pickling and the same steps")


@check
def reset_forgets(subject: Subject) -> None:
    """After a reset nothing of the last episode is left."""
    recording = record(LANES, STEPS)
    estimator = subject.run(record(LANES, STEPS, seed=5))
    start(estimator, recording)
    for name, values in estimator.counts.items():
        need(not np.any(values), f"counts[{name!r}] must be zero after reset")
    need(not estimator.belief.landmark_count.any(), "the map must be empty after reset")
    feed(estimator, recording)
    need_same(snapshot(estimator), snapshot(subject.run(recording)), "after reset and in a new estimator")


@check
def repeatable(subject: Subject) -> None:
    """The same seeds and data give the same belief."""
    recording = record(LANES, STEPS)
    need_same(snapshot(subject.run(recording)), snapshot(subject.run(recording)), "in two runs with the same seeds")


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
def dt_per_lane(subject: Subject) -> None:
    """`dt` may be a number or one per lane."""
    recording = record(LANES, STEPS)
    first, second = subject.run(recording), subject.make()
    start(second, recording)
    for step in recording.steps:
        tell_truth(second, recording, step)
        second.predict(step.control, np.full(LANES, DT))
        tell_truth(second, recording, step)
        second.update(step.scan)
    need_same(snapshot(first), snapshot(second), "for dt=0.1 and dt=[0.1, 0.1, 0.1]")
    second.predict(recording.steps[0].control, np.array([0.05, 0.1, 0.4]))
    moved = np.linalg.norm(second.belief.pose[:, :2] - first.belief.pose[:, :2], axis=1)
    need(moved[0] < moved[1] < moved[2], f"a longer dt must move a lane further; moved {moved.round(3)} m")


@check
def inputs_unchanged(subject: Subject) -> None:
    """Arguments are read, never written."""
    recording = record(LANES, STEPS)
    before = pickle.dumps(recording)
    subject.run(recording)
    need(pickle.dumps(recording) == before, "prior, controls and sweeps must not be changed in place")


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


@check
def reading_changes_nothing(subject: Subject) -> None:
    """Reading the belief after each step gives the same run as reading it at the end only."""
    recording = record(LANES, STEPS)
    estimator = subject.make()
    start(estimator, recording)
    for i in range(STEPS):
        feed(estimator, recording, i, i + 1)
        snapshot(estimator)
    need_same(snapshot(estimator), snapshot(subject.run(recording)), "whether the belief is read at each step or not")
