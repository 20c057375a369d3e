"""When a replay predicts, updates and measures: a recording cut into steps at exact event times."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam_gym.recording import LARGEST_GAP, Recording, Track

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NONE = -1
LONGEST_STEP = 0.05  # [s], a prediction takes the mean command over at most this long


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """N steps in order of time.

    Attributes:
        start: [s].
        times: [N] the end of each step [s].
        dt: [N] its length [s].
        controls: [N, 2] mean command during it: exact distance and angle over dt.
        sweep: [N] which sweep is taken at its end, or NONE.
        sample: [N] which sample of the metrics is taken at its end, after the sweep, or NONE.
        sample_times: [T] seconds.
    """

    start: float
    times: Floats
    dt: Floats
    controls: Floats
    sweep: Ints
    sample: Ints
    sample_times: Floats


def make_schedule(
    recording: Recording, *, command_delay: float = 0.0, sample_rate: float = 1.0, longest_step: float = LONGEST_STEP
) -> Schedule:
    """Cut the span in which commands and the recorded truth overlap at every sweep and every sample.

    A sweep right at the start ends a step of no length.

    Args:
        recording: what happened.
        command_delay: [s] from a command to its motion.
        sample_rate: [Hz] of the metrics; samples without recorded truth of the robot are left out.
        longest_step: [s].

    Raises:
        ValueError: a number out of range, or nothing overlaps.
    """
    for name, value, least in (("sample_rate", sample_rate, 1e-6), ("longest_step", longest_step, 1e-3)):
        if not value >= least:
            raise ValueError(f"{name} must be positive; got {value}")
    if not command_delay >= 0.0:
        raise ValueError(f"command_delay must be zero or more seconds; got {command_delay}")
    start, end = _span(recording)
    sample_times = start + np.arange(1, int((end - start) * sample_rate + 1e-9) + 1) / sample_rate
    if recording.truth is not None:
        sample_times = sample_times[np.isfinite(recording.truth.at(sample_times)).all(axis=1)]
    inside = np.flatnonzero((recording.sweep_times >= start) & (recording.sweep_times <= end))
    sweeps = recording.sweep_times[inside]
    events = np.unique(np.concatenate([sweeps, sample_times, [end]]))
    times = _cut(np.append(start, events), longest_step)
    moved = np.diff(recording.distance_and_turn(np.append(start, times), command_delay), axis=0)
    dt = np.diff(np.append(start, times))
    return Schedule(
        start=start,
        times=times,
        dt=dt,
        controls=np.divide(moved, dt[:, None], out=np.zeros_like(moved), where=dt[:, None] > 0.0),
        sweep=_mark(times, sweeps, inside),
        sample=_mark(times, sample_times, np.arange(len(sample_times))),
        sample_times=sample_times,
    )


def _span(recording: Recording) -> tuple[float, float]:
    """First and last time at which commands (or sweeps) and the truth are there."""
    last_sweep = recording.sweep_times[-1] if len(recording.sweep_times) else -np.inf
    start, end = float(recording.command_times[0]), float(max(recording.command_times[-1], last_sweep))
    if recording.truth is not None:
        start, end = _first_known(recording.truth, start), min(end, float(recording.truth.times[-1]))
    if not end > start:
        apart = 0.0 if recording.truth is None else float(np.diff(recording.truth.times).min(initial=np.inf))
        if LARGEST_GAP < apart < np.inf:
            raise ValueError(
                f"{recording.name}: the truth's rows are {apart:.4g} s or more apart, and it is not interpolated "
                f"across more than {LARGEST_GAP:g} s; times are in seconds"
            )
        raise ValueError(f"{recording.name}: commands and recorded truth do not overlap in time; check their clocks")
    return start, end


def _first_known(truth: Track, start: float) -> float:
    """The first time from `start` on at which the truth is recorded; it may begin late or with a gap."""
    times = np.append(max(start, truth.times[0]), truth.times[truth.times > start])
    there = np.isfinite(truth.at(times)).all(axis=1)
    return float(times[there.argmax()]) if there.any() else np.inf


def _cut(events: Floats, longest: float) -> Floats:
    """The ends of the events' gaps, each cut into equal pieces of at most `longest` seconds."""
    gaps = np.diff(events)
    pieces = np.maximum(np.ceil(gaps / longest - 1e-9).astype(np.int64), 1)
    within = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 1
    times = np.repeat(events[:-1], pieces) + np.repeat(gaps / pieces, pieces) * within
    times[np.cumsum(pieces) - 1] = events[1:]  # exactly
    return times


def _mark(times: Floats, when: Floats, values: Ints) -> Ints:
    marks = np.full(len(times), NONE, dtype=np.int64)
    marks[np.searchsorted(times, when)] = values
    return marks
