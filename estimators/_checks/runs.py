"""Checks of runs against each other: lanes and single runs, states, pickles, repetition."""

import copy
import pickle

import numpy as np

from estimators._checks.contract import LANES, STEPS, Subject, check, need, need_same, snapshot
from estimators._recording import DT, feed, record, start, tell_truth


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
def reading_changes_nothing(subject: Subject) -> None:
    """Reading the belief after each step gives the same run as reading it at the end only."""
    recording = record(LANES, STEPS)
    estimator = subject.make()
    start(estimator, recording)
    for i in range(STEPS):
        feed(estimator, recording, i, i + 1)
        snapshot(estimator)
    need_same(snapshot(estimator), snapshot(subject.run(recording)), "whether the belief is read at each step or not")
