"""No estimator breaks on legal input: no exception, no NaN, no covariance that is not one.

Every lane draws its own models, start and map, so that one run meets tiny and huge noise, known and rank-one starts,
headings beside the wrap, empty and crowded sweeps, targets that come near and go out of sight.
`SLAM_GYM_FUZZ=200` makes two hundred times as many steps as by default: ten million lane-steps of each Gaussian filter.
"""

import os
from dataclasses import dataclass

import numpy as np
import pytest

from estimators import registry
from estimators.gaussian.layout import GaussianEstimator
from estimators.interface import TARGET, Scan, TruthAware
from estimators.models import MotionModel, SensorModel, TargetModel

pytestmark = pytest.mark.slow

EFFORT = float(os.environ.get("SLAM_GYM_FUZZ", "1"))
EPISODE = 100  # steps, after which a third of the lanes begin new worlds
GAUSSIAN, OTHERS = 50_000, 1_000  # lane-steps
LANDMARKS, WIDTH = 12, 16
DT = 0.1


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@dataclass
class Fuzz:
    """L random lanes and the estimator that watches them."""

    name: str
    num_lanes: int
    seed: int
    target_kind: str = "constant-velocity"
    options: dict | None = None

    def __post_init__(self):
        self.rng = np.random.default_rng(self.seed)
        self.estimator = registry.make(
            self.name, *self._models(), num_lanes=self.num_lanes, max_landmarks=LANDMARKS, **(self.options or {})
        )
        self.scan = Scan.empty(self.num_lanes, WIDTH)
        self.begin(np.arange(self.num_lanes))

    def _models(self):
        """Noise from a hundredth of a millimetre to metres, each lane's own decade."""
        rng = self.rng
        scale = 10.0 ** rng.uniform(-5.0, 1.0)
        motion = MotionModel(speed_std=0.3 * scale, turn_std=min(0.1 * scale, 1.0))
        sensor = SensorModel(
            range_std=0.1 * scale, bearing_std=min(0.02 * scale, 0.5), max_range=rng.uniform(2.0, 30.0),
            field_of_view=rng.uniform(0.5, 2.0 * np.pi),
        )  # fmt: skip
        target = TargetModel(
            kind=self.target_kind, speed=1.0, turn_rate=rng.uniform(-1.0, 1.0), speed_std=0.3 * scale,
            turn_std=min(0.2 * scale, 1.0), acceleration_density=0.3 * scale,
            reinitialise_nis=rng.choice([35.0, np.inf]),
        )  # fmt: skip
        return motion, sensor, target

    def begin(self, lanes):
        """New worlds in these lanes."""
        rng, n = self.rng, len(lanes)
        if not hasattr(self, "pose"):
            L = self.num_lanes
            self.pose, self.target, self.landmarks = np.zeros((L, 3)), np.zeros((L, 4)), np.zeros((L, LANDMARKS, 2))
            self.models = [None] * L
        self.pose[lanes] = np.column_stack([rng.uniform(-5, 5, (n, 2)), np.pi - rng.exponential(0.1, n)])
        self.landmarks[lanes] = rng.uniform(-10, 10, (n, LANDMARKS, 2))
        self.target[lanes] = np.column_stack([rng.uniform(-5, 5, (n, 2)), rng.normal(0, 1, (n, 2))])
        cov = np.zeros((n, 3, 3))
        for i, lane in enumerate(lanes):
            self.models[lane] = self._models()
            self.estimator.set_models(int(lane), *self.models[lane])
            kind, std = rng.integers(3), 10.0 ** rng.uniform(-5.0, 0.0) * np.array([1.0, 1.0, 0.3])
            cov[i] = (0.0, np.outer(std, std), np.diag(std**2))[kind]
        start = self.pose[lanes] + np.einsum("nij,nj->ni", _root(cov), rng.standard_normal((n, 3)))
        self.estimator.reset(start, cov, seeds=rng.integers(1 << 30, size=n), lanes=lanes)

    def step(self):
        """One motion and one sweep of every lane."""
        rng, L = self.rng, self.num_lanes
        control = np.column_stack([rng.uniform(-0.5, 2.0, L), rng.uniform(-2.0, 2.0, L)])
        noise = np.array([[m.speed_std, m.turn_std] for m, _, _ in self.models])
        v, w = (control + noise * rng.standard_normal((L, 2))).T
        self.pose[:, 2] = wrap(self.pose[:, 2] + w * DT)
        self.pose[:, 0] += v * DT * np.cos(self.pose[:, 2])
        self.pose[:, 1] += v * DT * np.sin(self.pose[:, 2])
        self.target[:, :2] += DT * self.target[:, 2:]
        self._sense()
        self.estimator.predict(control, DT)
        self.estimator.update(self.scan)

    def _sense(self):
        rng, L = self.rng, self.num_lanes
        points = np.concatenate([self.landmarks, self.target[:, None, :2]], axis=1)
        offset = points - self.pose[:, None, :2]
        r, b = np.hypot(*np.moveaxis(offset, 2, 0)), np.arctan2(offset[..., 1], offset[..., 0]) - self.pose[:, 2:]
        std = np.array([[s.range_std, s.bearing_std] for _, s, _ in self.models])
        reach = np.array([[s.max_range, 0.5 * s.field_of_view] for _, s, _ in self.models])
        visible = (r < reach[:, :1]) & (np.abs(wrap(b)) < reach[:, 1:]) & (rng.random(r.shape) < 0.9)
        visible &= rng.random((L, 1)) < 0.8  # whole sweeps without a return
        r = np.abs(r + std[:, :1] * rng.standard_normal(r.shape)) + 1e-9
        b = wrap(b + std[:, 1:] * rng.standard_normal(b.shape))
        labels = np.append(np.arange(LANDMARKS), TARGET)
        order = np.argsort(~visible, axis=1, kind="stable")
        width = LANDMARKS + 1
        self.scan.ranges[:, :width] = np.take_along_axis(r, order, 1)
        self.scan.bearings[:, :width] = np.take_along_axis(b, order, 1)
        self.scan.labels[:, :width] = labels[order]
        self.scan.count[:] = visible.sum(axis=1)

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


def _root(cov):
    values, vectors = np.linalg.eigh(cov)
    return vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]


def kinds():
    for name in registry.names():
        if name == "isam2" or issubclass(registry.get(name), TruthAware):
            continue  # isam2 has a test of its own; reference filters need the truth
        yield name


@pytest.mark.parametrize("target_kind", ["constant-velocity", "twist"])
@pytest.mark.parametrize("name", list(kinds()))
def test_random_worlds(name, target_kind):
    gaussian = issubclass(registry.get(name), GaussianEstimator)
    lanes, steps = (256, GAUSSIAN) if gaussian else (4, OTHERS)
    fuzz = Fuzz(name, lanes, seed=7, target_kind=target_kind)
    for step in range(int(EFFORT * steps / 2) // lanes):
        if step % EPISODE == EPISODE - 1:
            fuzz.begin(np.flatnonzero(fuzz.rng.random(lanes) < 0.34))
        fuzz.step()
        if step % 10 == 0:
            assert fuzz.faults() == [], f"after {step} steps"
