"""What one picture shows, as plain data: the truth, one estimator's belief, the sweep, and how both went so far."""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from estimators.interface import TARGET
from slam_gym.reward import default_reward

if TYPE_CHECKING:
    from slam_gym.simulation import Simulation

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def _no_points() -> Floats:
    return np.zeros((0, 2))


@dataclass(slots=True, kw_only=True)
class Frame:
    """One instant of one lane. World frame, metres and radians; None where there is no such thing.

    Every array is a copy: a frame stays valid while the simulation goes on.
    """

    time: float  # [s]
    step: int
    scenario: str = ""
    estimator: str = ""
    arena: tuple[float, float] = (20.0, 20.0)  # [m], width and height about the origin
    walls: bool = False
    # truth
    pose: Floats  # [3]
    robot_radius: float = 0.2  # [m]
    target: Floats | None = None  # [3] x, y, heading
    landmarks: Floats = field(default_factory=_no_points)  # [N, 2]
    landmark_radius: Floats = field(default_factory=lambda: np.zeros(0))  # [N], 0: a point
    opaque: bool = False  # whether landmarks hide what is behind them
    # sensor
    max_range: float = 6.0  # [m]
    field_of_view: float = 2.0 * math.pi  # [rad], the whole opening
    returns: Floats = field(default_factory=_no_points)  # [n, 2] range, bearing of the latest sweep
    sources: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # [n] id, TARGET, or -1: false alarm
    false_alarms: bool = False  # whether the sensor gives any
    time_since_seen: float | None = None  # [s]
    collisions: int = 0
    # belief
    belief_pose: Floats  # [3]
    belief_pose_cov: Floats  # [3, 3]
    belief_target: Floats | None = None  # [2]; None: not known
    belief_target_cov: Floats | None = None  # [2, 2]
    belief_landmarks: Floats = field(default_factory=_no_points)  # [m, 2]
    belief_landmark_cov: Floats = field(default_factory=lambda: np.zeros((0, 2, 2)))  # [m, 2, 2]
    belief_target_heading: float = math.nan  # [rad]
    belief_target_heading_std: float = math.nan  # [rad]
    particles: Floats | None = None  # [P, 3]
    keeps_cloud: bool = False  # whether points say where a lost target may be
    cloud: Floats | None = None  # [N, 2] where a lost target may be; None: it is in view, or nobody keeps a cloud
    cloud_weights: Floats | None = None  # [N]
    # numbers of the text panel and the strip; NaN: undefined
    robot_error: float = math.nan  # [m]
    heading_error: float = math.nan  # [rad]
    target_error: float = math.nan  # [m]
    pose_nees: float = math.nan  # 3 degrees of freedom
    target_nees: float = math.nan  # 2
    reward: float = math.nan  # of this instant, with the default weights

    @classmethod
    def from_simulation(
        cls, simulation: "Simulation", lane: int = 0, index: int = 0, *, label: str | None = None
    ) -> Self:
        """The present of one lane, with the belief of the estimator at `index`; label: what to call it."""
        world, scenario = simulation.world, simulation.scenario
        count = int(world.landmark_count[lane])
        number = int(world.scan.count[lane])
        sensor = world.lane_models(lane)[1]
        step = int(world.step_count[lane])
        return cls(
            time=step * float(scenario.dt),
            step=step,
            scenario=scenario.name,
            estimator=label or simulation.estimators[index].name,
            arena=(float(scenario.arena.size[0]), float(scenario.arena.size[1])),
            walls=bool(scenario.arena.walls),
            pose=world.pose[lane].copy(),
            robot_radius=float(np.mean(scenario.robot.radius)),
            target=_true_target(world, lane),
            landmarks=world.landmarks[lane, :count].copy(),
            landmark_radius=world.landmark_radius[lane, :count].copy(),
            opaque=bool(scenario.landmarks.opaque),
            max_range=float(sensor.max_range),
            field_of_view=float(sensor.field_of_view),
            returns=np.column_stack([world.scan.ranges[lane, :number], world.scan.bearings[lane, :number]]),
            sources=world.origin[lane, :number].copy(),
            false_alarms=sensor.clutter_rate > 0.0,
            time_since_seen=float(world.time_since_seen[lane]) if world.has_target else None,
            collisions=int(world.collisions[lane]),
            **_belief(simulation, lane, index),
        )

    @property
    def target_seen(self) -> bool:
        """Whether the latest sweep holds a return of the target."""
        return bool((self.sources == TARGET).any())


def _true_target(world: Any, lane: int) -> Floats | None:
    if not world.has_target:
        return None
    return np.array([world.target[lane, 0], world.target[lane, 1], world.target_heading[lane]])


def _belief(simulation: "Simulation", lane: int, index: int) -> dict[str, Any]:
    """The belief's part of a frame, with how far off it is."""
    belief = simulation.estimators[index].belief
    metrics = simulation.measure(index)[lane]
    known = bool(belief.target_known[lane])
    mapped = belief.landmark_mapped[lane]
    try:
        particles = belief.particles(lane)[0]
    except NotImplementedError:
        particles = None
    variance = float(belief.target_heading_var[lane])
    return {
        "belief_pose": belief.pose[lane].copy(),
        "belief_pose_cov": belief.pose_cov[lane].copy(),
        "belief_target": belief.target_position[lane].copy() if known else None,
        "belief_target_cov": belief.target_position_cov[lane].copy() if known else None,
        "belief_target_heading": float(belief.target_heading[lane]) if known else math.nan,
        "belief_target_heading_std": math.sqrt(max(variance, 0.0)) if known else math.nan,
        "belief_landmarks": belief.landmark_mean[lane][mapped],
        "belief_landmark_cov": belief.landmark_cov[lane][mapped],
        "particles": particles,
        "robot_error": float(metrics["robot_error"]),
        "heading_error": float(metrics["heading_error"]),
        "target_error": float(metrics["target_error"]),
        "pose_nees": float(metrics["pose_nees"]),
        "target_nees": float(metrics["target_nees"]),
        **_cloud(simulation, lane, index),
        **_reward(simulation, lane, metrics),
    }


def _cloud(simulation: "Simulation", lane: int, index: int) -> dict[str, Any]:
    """Where a lost target may be, if a cloud accompanies the estimator."""
    if index not in simulation.clouds:
        return {}
    if simulation.world.scan_holds_target(lane):
        return {"keeps_cloud": True}
    points, weights = simulation.estimators[index].belief.target_cloud
    return {"keeps_cloud": True, "cloud": points[lane].copy(), "cloud_weights": weights[lane].copy()}


def _reward(simulation: "Simulation", lane: int, metrics: Any) -> dict[str, float]:
    world = simulation.world
    if not world.has_target:
        return {}
    distance = math.hypot(*(world.target[lane, :2] - world.pose[lane, :2]))
    error, error_rel = float(metrics["target_error"]), float(metrics["target_error_rel"])
    return {"reward": default_reward(error, error_rel, world.scan_holds_target(lane), distance)}


class History:
    """What trails and the strip show: one row per recorded frame of one episode.

    A frame that is not later than the last one starts a new episode, or replaces it if it is of the same step.
    """

    COLUMNS = ("time", "x", "y", "belief_x", "belief_y", "target_x", "target_y", "belief_target_x", "belief_target_y",
               "robot_error", "target_error", "pose_nees", "reward", "seen")  # fmt: skip

    def __init__(self) -> None:
        self._rows = np.zeros((256, len(self.COLUMNS)))
        self._size = 0
        self._step = -1

    def __len__(self) -> int:
        return self._size

    def record(self, frame: Frame) -> None:
        """Append one frame."""
        if frame.step < self._step:
            self._size = 0
        elif frame.step == self._step:
            self._size -= 1
        if self._size == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        nowhere = (math.nan, math.nan)
        target = nowhere if frame.target is None else frame.target[:2]
        belief = nowhere if frame.belief_target is None else frame.belief_target
        self._rows[self._size] = (
            frame.time, *frame.pose[:2], *frame.belief_pose[:2], *target, *belief, frame.robot_error,
            frame.target_error, frame.pose_nees, frame.reward, frame.target_seen,
        )  # fmt: skip
        self._size += 1
        self._step = frame.step

    def column(self, name: str) -> Floats:
        """[T] one column."""
        return self._rows[: self._size, self.COLUMNS.index(name)]

    def track(self, name: str) -> Floats:
        """[T, 2] positions: name "" (true robot), "belief_", "target_" or "belief_target_"."""
        first = self.COLUMNS.index(name + "x")
        return self._rows[: self._size, first : first + 2]
