"""Which experiments there are."""

from importlib import import_module

from estimators.registry import unknown_name
from slam_gym.reproduce.experiment import Experiment

_MODULES = {
    "cdkf-memory": "cdkf_memory",
    "cdkf-sparse": "cdkf_sparse",
    "cdkf-dense": "cdkf_dense",
    "slamto-1": "slamto_1",
    "slamto-2": "slamto_2",
    "slamto-3": "slamto_3",
    "slamto-table1": "slamto_table1",
    "slamto-robots": "slamto_robots",
    "rbpf-proposal": "rbpf_proposal",
    "rbpf-resampling": "rbpf_resampling",
    "rbpf-time": "rbpf_time",
    "rbpf-memory": "rbpf_memory",
    "geng-nees": "geng_nees",
}


def names() -> list[str]:
    """All of them, paper by paper."""
    return list(_MODULES)


def get(name: str) -> Experiment:
    """The experiment of that name.

    Raises:
        ValueError: no such experiment; the message names the nearest.
    """
    if name not in _MODULES:
        raise ValueError(unknown_name("experiment", name, names()))
    found: Experiment = import_module(f"slam_gym.reproduce.{_MODULES[name]}").EXPERIMENT
    return found
