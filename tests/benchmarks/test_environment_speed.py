"""Ratios of the environment's speed to the same work in clean NumPy, both in one process, interleaved.

`slam-gym benchmark` prints the steps per second too; those depend on the machine and are not asserted.
"""

import pytest

from slam_gym.benchmark.environment import environment_rows
from slam_gym.benchmark.filters import blas_rows

pytestmark = pytest.mark.benchmark


@pytest.fixture(scope="module")
def rows():
    found = {row["name"]: row for row in environment_rows((256,), foreign=False)}
    for name, row in found.items():
        print(f"\n{name}: {row['microseconds']:.2f} us per step, {row['per_second']:,.0f} per second", end="")
    return found


def test_a_single_step_is_25_times_as_fast_as_clean_numpy(rows):
    assert rows["gym.make"]["times_numpy"] >= 25.0


def test_a_lane_of_many_is_twice_as_fast_as_a_single_environment(rows):
    assert rows["gym.make"]["microseconds"] >= 2.0 * rows["gym.make_vec, 256 lanes"]["microseconds"]


def test_a_whole_step_of_the_filter_costs_a_few_updates_of_blas():
    for row in blas_rows((20, 100, 500)):
        print(f"\n{row['landmarks']} landmarks: {row['times_blas']:.2f} times dsyrk", end="")
        assert row["times_blas"] <= 2.5
