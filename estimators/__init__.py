"""What is believed: filters for SLAM with a moving target. They work without any environment.

>>> import estimators
>>> "ri-ekf" in estimators.names()
True
"""

from typing import TYPE_CHECKING, Any

from estimators.interface import TARGET, UNKNOWN, Belief, Estimator, Scan, TruthAware
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.registry import get, make, names, register

if TYPE_CHECKING:
    from estimators.target_cloud import TargetCloud

__all__ = [
    "TARGET",
    "UNKNOWN",
    "Belief",
    "Estimator",
    "MotionModel",
    "Scan",
    "SensorModel",
    "TargetCloud",
    "TargetModel",
    "TruthAware",
    "get",
    "make",
    "names",
    "register",
]


def __getattr__(name: str) -> Any:
    """`TargetCloud` on first use: its kernels bring numba, which takes most of a second to import."""
    if name == "TargetCloud":
        from estimators.target_cloud import TargetCloud

        return TargetCloud
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
