"""Checks of what is believed: shapes, soundness, the robot, the target, the map."""

from dataclasses import replace

import numpy as np

from estimators._checks.contract import (
    CAPACITY,
    FIELDS,
    LANES,
    STEPS,
    Subject,
    check,
    edited,
    need,
    need_sound,
    snapshot,
    without,
)
from estimators._recording import DT, TARGET_MODEL, feed, record, start, tell_truth
from estimators.interface import TARGET, Belief


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
