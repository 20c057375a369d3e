"""The numbers of a comparison do not depend on where it is worked on."""

import os
import sys
from pathlib import Path

import pytest

from slam_gym.evaluation import compare
from slam_gym.evaluation_backend import workers

SETTINGS = {"estimators": ["dead-reckoning"], "runs": 6, "steps": 20, "chunk": 2}


def die_once(mark, number):
    """Kills its worker the first time, as a machine that goes away does."""
    if not Path(mark).exists():
        Path(mark).touch()
        os._exit(1)
    return number


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_task_is_done_once(jobs):
    with workers(jobs) as crew:
        assert sorted(crew.results([(pow, (n, 2)) for n in range(5)])) == [0, 1, 4, 9, 16]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"jobs": 0}, "at least 1"),
        ({"backend": "threads"}, "must be one of 'processes', 'ray'"),
        ({"address": "auto"}, "backend='ray'"),
    ],
)
def test_wrong_calls(arguments, message):
    with pytest.raises(ValueError, match=message), workers(**arguments):
        pass


@pytest.mark.slow
class TestRay:
    """On a cluster of this machine alone."""

    @pytest.fixture(scope="class", autouse=True)
    @classmethod
    def cluster(cls):
        ray = pytest.importorskip("ray")
        ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers cannot import the tests
        ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
        yield
        ray.shutdown()

    def test_same_numbers_as_here(self):
        here = compare("open", **SETTINGS, jobs=1)
        there = compare("open", **SETTINGS, backend="ray")
        timed = [name for name in here.runs.columns if "time" in name]
        assert len(there.runs) == 6
        assert here.runs.drop(columns=timed).equals(there.runs.drop(columns=timed))

    def test_a_lost_worker_s_work_is_done_again(self, tmp_path):
        mark = str(tmp_path / "mark")
        with workers(2, "ray") as crew:
            assert sorted(crew.results([(die_once, (mark, n)) for n in range(4)])) == [0, 1, 2, 3]
