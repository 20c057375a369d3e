"""No estimator breaks on legal input: no exception, no NaN, no covariance that is not one.

Every lane draws its own models, start and map, so that one run meets tiny and huge noise, of motion, returns and target
apart, known and rank-one starts on both sides of the wrap, landmarks scattered or crowded around the start and more of
them than the map holds, sweeps of nothing and of everything at once, targets out of sight and ones that jump to within
a nanometre of the robot. Returns may be six decades better than the motion: a filter that linearises then runs off by
kilometres, and what it holds of a millimetre is less than rounding (`estimators.kernels.rounding`).
`SLAM_GYM_FUZZ=200` makes two hundred times as many steps as by default: ten million lane-steps of each Gaussian filter,
a hundred thousand of each other one, in some minutes each.
"""

import os
from dataclasses import dataclass, field

import numpy as np
import pytest

from estimators import registry
from estimators.gaussian.layout import GaussianEstimator
from estimators.interface import TARGET, UNKNOWN, Scan, TruthAware
from estimators.models import MotionModel, SensorModel, TargetModel

EFFORT = float(os.environ.get("SLAM_GYM_FUZZ", "1"))
pytestmark = [pytest.mark.slow, *([pytest.mark.timeout(0)] if EFFORT > 1.0 else [])]  # more lasts as long as it takes
EPISODE = 100  # steps, after which a third of the lanes begin new worlds
GAUSSIAN, OTHERS = 50_000, 1_000  # lane-steps
OPTIONAL = 0.1  # share of them that each set of options gets beside
LANDMARKS, CAPACITY, WIDTH = 14, 12, 18
DT = 0.1
NEAR = 0.01  # chance per step that the target jumps to beside the robot, where the filter may forget and start anew
OPTIONS = {
    "imm": {"target_kind": "imm"},
    "nearest": {"association": "nearest"},
    "jcbb": {"association": "jcbb"},
    "budget": {"budget": 6},
    "gate": {"gate": 9.21},
}


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@dataclass
class Fuzz:
    """L random lanes and the estimator that watches them; false returns and no labels where it is to associate."""

    name: str
    num_lanes: int
    seed: int
    target_kind: str = "constant-velocity"
    options: dict = field(default_factory=dict)

    def __post_init__(self):
        self.rng, L = np.random.default_rng(self.seed), self.num_lanes
        self.estimator = registry.make(self.name, *self._models(), num_lanes=L, max_landmarks=CAPACITY, **self.options)
        self.labelled = "association" not in self.options
        self.scan = Scan.empty(L, WIDTH)
        self.pose, self.target, self.landmarks = np.zeros((L, 3)), np.zeros((L, 4)), np.zeros((L, LANDMARKS, 2))
        self.control_std, self.return_std, self.reach = np.zeros((L, 2)), np.zeros((L, 2)), np.zeros((L, 2))
        self.begin(np.arange(L))

    def _models(self):
        """Noise over six decades, each lane's own for motion, returns and target."""
        rng = self.rng
        moved, seen, driven = 10.0 ** rng.uniform(-5.0, 1.0, 3)
        motion = MotionModel(speed_std=0.3 * moved, turn_std=min(0.1 * moved, 1.0))
        reach = (30.0, 2.0 * np.pi) if rng.random() < 0.25 else (rng.uniform(2.0, 30.0), rng.uniform(0.5, 2.0 * np.pi))
        sensor = SensorModel(
            range_std=0.1 * seen, bearing_std=min(0.02 * seen, 0.5), max_range=reach[0], field_of_view=reach[1]
        )
        target = TargetModel(
            kind=self.target_kind, speed=1.0, turn_rate=rng.uniform(-1.0, 1.0), speed_std=0.3 * driven,
            turn_std=min(0.2 * driven, 1.0), acceleration_density=0.3 * driven,
            reinitialise_nis=rng.choice([35.0, np.inf]),
        )  # fmt: skip
        return motion, sensor, target

    def begin(self, lanes):
        """New worlds in these lanes."""
        rng, n = self.rng, len(lanes)
        self.pose[lanes] = np.column_stack([rng.uniform(-5, 5, (n, 2)), wrap(np.pi + rng.laplace(0.0, 0.1, n))])
        spread = 10.0 ** np.where(rng.random(n) < 0.5, 1.0, rng.uniform(-4.0, 1.0, n))
        offset = spread[:, None, None] * rng.uniform(-1.0, 1.0, (n, LANDMARKS, 2))
        self.landmarks[lanes] = self.pose[lanes, None, :2] + offset
        away = np.where(rng.random((n, 1)) < 0.2, _away(rng, n), rng.uniform(-5, 5, (n, 2)))
        self.target[lanes] = np.column_stack([self.pose[lanes, :2] + away, rng.normal(0, 1, (n, 2))])
        for lane in map(int, lanes):
            motion, sensor, target = self._models()
            self.control_std[lane] = motion.speed_std, motion.turn_std
            self.return_std[lane] = sensor.range_std, sensor.bearing_std
            self.reach[lane] = sensor.max_range, 0.5 * sensor.field_of_view
            self.estimator.set_models(lane, motion, sensor, target)
        std = 10.0 ** rng.uniform(-5.0, 0.0, (n, 1)) * np.array([1.0, 1.0, 0.3])
        rank_one = std[:, :, None] * std[:, None, :]
        kinds = np.stack([np.zeros((n, 3, 3)), rank_one, rank_one * np.eye(3)])
        cov = kinds[rng.integers(3, size=n), np.arange(n)]
        start = self.pose[lanes] + np.einsum("nij,nj->ni", _root(cov), rng.standard_normal((n, 3)))
        self.estimator.reset(start, cov, seeds=rng.integers(1 << 30, size=n), lanes=lanes)

    def step(self):
        """One motion and one sweep of every lane."""
        rng, L = self.rng, self.num_lanes
        control = np.column_stack([rng.uniform(-0.5, 2.0, L), rng.uniform(-2.0, 2.0, L)])
        v, w = (control + self.control_std * rng.standard_normal((L, 2))).T
        self.pose[:, 2] = wrap(self.pose[:, 2] + w * DT)
        self.pose[:, 0] += v * DT * np.cos(self.pose[:, 2])
        self.pose[:, 1] += v * DT * np.sin(self.pose[:, 2])
        self.target[:, :2] += DT * self.target[:, 2:]
        near = np.flatnonzero((rng.random(L) < NEAR) & (self.estimator.models["reinitialise_nis"] < np.inf))
        self.target[near, :2] = self.pose[near, :2] + _away(rng, len(near))
        self._sense()
        self.estimator.predict(control, DT)
        self.estimator.update(self.scan)

    def _sense(self):
        rng, L = self.rng, self.num_lanes
        points = np.concatenate([self.landmarks, self.target[:, None, :2]], axis=1)
        offset = points - self.pose[:, None, :2]
        r, b = np.hypot(*np.moveaxis(offset, 2, 0)), np.arctan2(offset[..., 1], offset[..., 0]) - self.pose[:, 2:]
        visible = (r < self.reach[:, :1]) & (np.abs(wrap(b)) < self.reach[:, 1:]) & (rng.random(r.shape) < 0.9)
        visible |= (rng.random((L, 1)) < 0.1) & (r < self.reach[:, :1])  # everything around at once
        visible &= rng.random((L, 1)) < 0.8  # whole sweeps without a return
        noise = rng.standard_normal((2, *r.shape))
        r = np.abs(r + self.return_std[:, :1] * noise[0]) + 1e-9
        b = wrap(b + self.return_std[:, 1:] * noise[1])
        order = np.argsort(~visible, axis=1, kind="stable")
        width = LANDMARKS + 1
        self.scan.ranges[:, :width] = np.take_along_axis(r, order, 1)
        self.scan.bearings[:, :width] = np.take_along_axis(b, order, 1)
        self.scan.labels[:, :width] = np.append(np.arange(LANDMARKS), TARGET)[order]
        self.scan.count[:] = visible.sum(axis=1)
        if not self.labelled:
            self._hide_labels()

    def _hide_labels(self):
        """The target's label half of the time, the landmarks' always; and up to three false returns."""
        rng, L, rows = self.rng, self.num_lanes, np.arange(self.num_lanes)
        known = (self.scan.labels == TARGET) & (rng.random((L, 1)) < 0.5)
        self.scan.labels[:] = np.where(known, TARGET, UNKNOWN)
        for added in rng.random((3, L)) < 0.1:
            at = self.scan.count
            self.scan.ranges[rows, at] = rng.uniform(1e-9, 1.0, L) * self.reach[:, 0]
            self.scan.bearings[rows, at] = rng.uniform(-1.0, 1.0, L) * self.reach[:, 1]
            self.scan.labels[rows, at] = UNKNOWN
            at += added

    def faults(self):
        """What is wrong with the belief, as words; none where all is well."""
        belief, found = self.estimator.belief, []
        arrays = ("pose", "pose_cov", "target_mean", "target_cov", "target_rel_cov", "landmark_mean", "landmark_cov")
        for name in arrays:
            if not np.isfinite(getattr(belief, name)).all():
                found.append(f"{name} is not finite")
        if found:
            return found
        for name in ("pose_cov", "target_cov", "target_rel_cov", "landmark_cov", "landmark_rel_cov"):
            cov = getattr(belief, name)
            if cov.size == 0:
                continue
            values = np.linalg.eigvalsh(cov)
            worst = (values[..., 0] / np.maximum(np.abs(values[..., -1]), 1e-300)).min()
            if worst < -1e-9:
                found.append(f"{name} has an eigenvalue of {worst:.1e} of its largest")
        if not (np.abs(belief.pose[:, 2]) <= np.pi).all():
            found.append("a heading is not wrapped")
        return found


def _away(rng, n):
    """[n, 2] offsets of a nanometre to a metre in any direction."""
    r, angle = 10.0 ** rng.uniform(-9.0, 0.0, n), rng.uniform(-np.pi, np.pi, n)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle)])


def _root(cov):
    values, vectors = np.linalg.eigh(cov)
    return vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]


def kinds():
    for name in registry.names():
        if name == "isam2" or issubclass(registry.get(name), TruthAware):
            continue  # isam2 has a test of its own; reference filters need the truth
        yield name


def is_gaussian(name):
    return name == "independent" or issubclass(registry.get(name), GaussianEstimator)


def fuzz(name, share, **choices):
    """That share of the estimator's lane-steps, in more lanes the more there are."""
    steps = EFFORT * share * (GAUSSIAN if is_gaussian(name) else OTHERS)
    lanes = int(np.clip(steps / 200, 16, 1024)) if is_gaussian(name) else 4
    one = Fuzz(name, lanes, seed=7, **choices)
    for step in range(int(steps) // lanes):
        if step % EPISODE == EPISODE - 1:
            one.begin(np.flatnonzero(one.rng.random(lanes) < 0.34))
        one.step()
        if step % 10 == 0:
            assert one.faults() == [], f"after {step} steps"


@pytest.mark.parametrize("target_kind", ["constant-velocity", "twist"])
@pytest.mark.parametrize("name", list(kinds()))
def test_random_worlds(name, target_kind):
    fuzz(name, 0.5, target_kind=target_kind)


@pytest.mark.parametrize("chosen", list(OPTIONS))
@pytest.mark.parametrize("name", [name for name in kinds() if is_gaussian(name)])
def test_random_worlds_under_options(name, chosen):
    options = dict(OPTIONS[chosen])
    choices = {"target_kind": options.pop("target_kind")} if "target_kind" in options else {}
    try:
        registry.make(name, MotionModel(), SensorModel(), TargetModel(kind=choices.get("target_kind", "twist")),
                      max_landmarks=CAPACITY, **options)  # fmt: skip
    except (TypeError, ValueError) as refusal:
        pytest.skip(f"{name} refuses it: {refusal}")
    fuzz(name, OPTIONAL, options=options, **choices)
