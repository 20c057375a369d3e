"""What enters a lane's graph, as plain numbers: a graph is built again from them, bit for bit."""

from dataclasses import dataclass

from estimators.interface import Floats
from estimators.models import TargetModel

UNSEEN, STARTS, GOES_ON = 0, 1, 2  # whether the target has a state at a node, and how it comes by it


@dataclass(frozen=True, slots=True)
class Prior:
    """The start of a trajectory; `target` [n_t] and `target_cov` only where they are known."""

    pose: Floats  # [3]
    pose_cov: Floats  # [3, 3]
    model: TargetModel | None
    target: Floats | None
    target_cov: Floats | None
    threshold: float  # change of a variable above which it is linearised anew
    iterations: int  # steps of the solver per sweep


@dataclass(frozen=True, slots=True)
class Sighting:
    """One return of a landmark (its slot) or of the target."""

    slot: int
    distance: float  # [m]
    bearing: float  # [rad]
    range_std: float  # [m]
    bearing_std: float  # [rad]
    is_new: bool = False


@dataclass(frozen=True, slots=True)
class Motion:
    """What happened since the last node (see `estimators.smoothing.odometry`)."""

    moved: Floats  # [3] in the axes of the last pose
    spread: Floats  # [3, 3]
    elapsed: float  # [s] since the target's last node
    drift: Floats  # [3] of a twist target, in the axes of its last node
    drift_spread: Floats  # [3, 3]


@dataclass(frozen=True, slots=True)
class Sweep:
    """One node: the motion since the one before, and what was seen from it.

    `first_sighting` is a twist target's held one and the number of the node it was seen from: with it the chord of
    two sightings starts the target (`target` is STARTS).
    """

    motion: Motion
    sightings: tuple[Sighting, ...]
    target: int = UNSEEN
    first_sighting: tuple[int, Sighting] | None = None
