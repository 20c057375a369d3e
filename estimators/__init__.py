"""What is believed: filters for SLAM with a moving target. They work without any environment.

>>> import estimators
>>> estimators.names()
['dead-reckoning', 'ekf', 'ideal-ekf', 'fej-ekf', 'ri-ekf', 'cdkf', 'slamto', 'independent']
"""

from estimators.interface import TARGET, UNKNOWN, Belief, Estimator, Scan, TruthAware
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.registry import get, make, names, register
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
