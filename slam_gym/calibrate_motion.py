"""Fit odometry and a wandering target against a recorded truth."""

from collections.abc import Sequence

import numpy as np

from slam_gym.calibrate_sensor import autocovariance, fit_decay
from slam_gym.recording import Floats, Recording, wrap

STEP = 0.1  # [s] of the grid on which truth and commands are compared
DELAYS = np.arange(0.0, 0.61, 0.02)  # [s]
SHORT, MIDDLE, LONG = 1.0, 10.0, 20.0  # [s] windows: for the turn noise, its part per angle, the speed noise
STRAIGHT, MOVING = 0.05, 0.02  # [rad/s] below which, [m/s] above which a command means driving straight
FEWEST = 10  # windows
TARGET_STEP = 1.0  # [s]


def travelled(recording: Recording) -> tuple[Floats, Floats]:
    """A grid of `STEP`: times [n + 1], and the true way along the heading and angle turned [n, 2] in between.

    Steps in which the truth is not recorded are NaN.

    Raises:
        ValueError: no truth, or too little.
    """
    truth = recording.truth
    if truth is None:
        raise ValueError(f"{recording.name}: a calibration needs the recorded truth (truth.csv), and there is none")
    start = max(recording.command_times[0], truth.times[0])
    end = min(recording.command_times[-1], truth.times[-1])
    if not end - start > LONG * FEWEST:
        raise ValueError(
            f"{recording.name}: truth and commands overlap for {max(end - start, 0.0):.0f} s; a calibration needs "
            f"{LONG * FEWEST:.0f} s or more"
        )
    times = np.arange(start, end, STEP)
    poses = truth.at(times)
    turn = wrap(np.diff(poses[:, 2]))
    course = poses[:-1, 2] + 0.5 * turn
    way = np.diff(poses[:, 0]) * np.cos(course) + np.diff(poses[:, 1]) * np.sin(course)
    return times, np.column_stack([way, turn])


def commanded(recording: Recording, times: Floats, delay: float) -> Floats:
    """The commanded way and angle [n, 2] between the times [n + 1]."""
    return np.asarray(np.diff(recording.distance_and_turn(times, delay), axis=0))


def windows(steps: Floats, seconds: float) -> Floats:
    """Sums [m, ...] over windows of that length, those with a gap left out."""
    size = round(seconds / STEP)
    count = len(steps) // size
    sums = steps[: count * size].reshape(count, size, -1).sum(axis=1)
    return np.asarray(sums[np.isfinite(sums).all(axis=1)])


def fit_command_delay(recordings: Sequence[Recording]) -> float:
    """The delay [s] with which the commands fit the true motion best, in speed and in turn rate together."""
    moves = [(recording, *travelled(recording)) for recording in recordings]
    misfit = []
    for delay in DELAYS:
        both = np.concatenate(
            [windows(np.column_stack([true, commanded(r, times, delay)]), 2 * STEP) for r, times, true in moves]
        )
        misfit.append(_misfit(both[:, :2], both[:, 2:]))
    return float(DELAYS[int(np.argmin((np.array(misfit) / np.min(misfit, axis=0)).sum(axis=1)))])


def _misfit(true: Floats, told: Floats) -> Floats:
    """Mean square [2] of what scaled commands leave of the way and of the angle."""
    scale: Floats = (true * told).sum(axis=0) / np.maximum((told * told).sum(axis=0), 1e-12)
    return np.asarray(((true - scale * told) ** 2).mean(axis=0)) + 1e-15


def fit_odometry(recordings: Sequence[Recording], delay: float) -> dict[str, float]:
    """Scales of speed and turn rate (means over robots), and the noise about each robot's own."""
    robots = [_one_robot(recording, delay) for recording in recordings]
    scales: Floats = np.mean([scale for scale, *_ in robots], axis=0)
    along, turned, angle, straight = (np.concatenate([np.asarray(robot[k]) for robot in robots]) for k in range(1, 5))
    if not angle.sum() > 0.0 or len(straight) < FEWEST:
        raise ValueError(
            f"a calibration needs a robot that turns, and {FEWEST} seconds in which it drives straight; found "
            f"{len(straight)}"
        )
    return {
        "speed_scale": float(scales[0]),
        "turn_scale": float(scales[1]),
        "speed_noise": float(along.std() / np.sqrt(LONG)),
        "turn_noise": float(straight.std() / np.sqrt(SHORT)),
        "turn_noise_per_angle": float((turned**2).sum() / angle.sum()),
    }


def _one_robot(recording: Recording, delay: float) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Scales [2], and per window what they leave of the way, of the angle, the angle turned, and drift when straight.

    In windows of 20 s, 10 s, 10 s and 1 s.
    """
    times, true = travelled(recording)
    told = commanded(recording, times, delay)
    steps = np.column_stack([true, told, np.abs(told[:, 1])])
    long, middle, short = windows(steps, LONG), windows(steps, MIDDLE), windows(steps, SHORT)
    if len(long) < FEWEST:
        raise ValueError(
            f"{recording.name}: a calibration needs {FEWEST} windows of {LONG:.0f} s without a gap in the truth; found "
            f"{len(long)}"
        )
    speed = float(long[:, 0] @ long[:, 2]) / max(float(long[:, 2] @ long[:, 2]), 1e-12)
    turn = float(middle[:, 1] @ middle[:, 3]) / max(float(middle[:, 3] @ middle[:, 3]), 1e-12)
    straight = (short[:, 4] < STRAIGHT * SHORT) & (short[:, 2] > MOVING * SHORT)
    return (
        np.array([speed, turn]),
        long[:, 0] - speed * long[:, 2],
        middle[:, 1] - turn * middle[:, 3],
        turn * middle[:, 4],
        (short[:, 1] - turn * short[:, 3])[straight],
    )


def fit_target(recordings: Sequence[Recording]) -> dict[str, float]:
    """Speed per axis, the time over which it persists, the place and the spring of the targets; {} without one."""
    places, velocities, groups, times = [], [], [], []
    for index, recording in enumerate(recordings):
        if recording.target is None:
            continue
        when = np.arange(recording.target.times[0], recording.target.times[-1], TARGET_STEP)
        place, velocity = recording.target.at(when)[:, :2], recording.target.velocity_at(when)
        good = np.isfinite(place).all(axis=1) & np.isfinite(velocity).all(axis=1)
        places.append(place[good])
        velocities.append(velocity[good])
        groups.append(np.full(int(good.sum()), index))
        times.append(when[good])
    if not places or sum(map(len, places)) < FEWEST:
        return {}
    place, velocity = np.concatenate(places), np.concatenate(velocities)
    group, when = np.concatenate(groups), np.concatenate(times)
    variance = float((velocity**2).mean())
    by_axis = [autocovariance(velocity[:, axis], group, when) for axis in range(2)]
    _, time = fit_decay(by_axis[0][0], 0.5 * (by_axis[0][1] + by_axis[1][1]), variance)
    centre = place.mean(axis=0)
    return {
        "target_speed_std": float(np.sqrt(variance)),
        "target_time": max(time, TARGET_STEP),
        "target_pull": variance / float(((place - centre) ** 2).mean()),
        "target_centre_x": float(centre[0]),
        "target_centre_y": float(centre[1]),
    }
