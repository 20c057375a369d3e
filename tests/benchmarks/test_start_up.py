"""How long a user waits before anything happens. Each figure is the best of three fresh processes."""

import subprocess
import sys
from time import perf_counter

import pytest

pytestmark = pytest.mark.benchmark

FIRST_STEP = (
    "import gymnasium as gym, slam_gym; env = gym.make('SlamTarget-v0'); env.reset(seed=0); "
    "env.step(env.action_space.sample())"
)


def best_seconds(command, runs=3):
    best = float("inf")
    for _ in range(runs):
        began = perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        best = min(best, perf_counter() - began)
    print(f"\n{command[-1][:40]}: {best:.2f} s", end="")
    return best


def test_import_takes_less_than_a_second():
    nothing = best_seconds([sys.executable, "-c", "pass"])
    assert best_seconds([sys.executable, "-c", "import slam_gym"]) - nothing < 1.0


def test_help_answers_in_less_than_a_second():
    assert best_seconds([sys.executable, "-m", "slam_gym", "--help"]) < 1.0


def test_the_second_start_reaches_its_first_step_in_three_seconds():
    subprocess.run([sys.executable, "-c", FIRST_STEP], check=True)  # fills the cache of compiled kernels
    assert best_seconds([sys.executable, "-c", FIRST_STEP]) < 3.0
