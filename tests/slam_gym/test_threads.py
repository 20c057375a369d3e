"""Any number of threads gives the same bits, shares what it may, and survives a fork."""

import multiprocessing
import threading
import warnings

import gymnasium as gym
import numpy as np
import pytest

import slam_gym  # noqa: F401  (registers the environment)
from estimators import registry
from estimators._recording import MOTION, SENSOR, TARGET_MODEL, feed, record, start
from slam_gym.threads import BLOCK, WORTH_IT, Crew, Shared

LANES = 2 * WORTH_IT + 7  # whose shares are uneven among two and among three
SHORT = {"max_steps": 12, "sensor_period": 2}


def play(threads, steps=30, **options):
    """Observations and rewards of random actions, over several episodes."""
    envs = gym.make_vec("SlamTarget-v0", num_envs=LANES, threads=threads, **options)
    rng, told = np.random.default_rng(0), [envs.reset(seed=3)[0]]
    for step in range(steps):
        observations, rewards, *_, infos = envs.step(rng.uniform(-1, 1, (LANES, 2)).astype(np.float32))
        told += [observations, rewards, infos["target_error"]]
        if step == 7:
            mask = rng.uniform(size=LANES) < 0.8  # a share of the lanes only
            told.append(envs.reset(options={"reset_mask": mask})[0])
    envs.close()
    return told


@pytest.mark.parametrize("estimator", ["ekf", "cdkf"])
def test_any_number_of_threads_gives_the_same_bits(estimator):
    alone, *others = (play(threads, scenario_options=SHORT, estimator=estimator) for threads in (1, 2, 3))
    for other in others:
        for mine, theirs in zip(alone, other, strict=True):
            np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize("name", [name for name in registry.names() if hasattr(registry.get(name), "_prediction")])
def test_what_kernels_write_belongs_to_a_lane_or_is_named_as_scratch(name):
    """Otherwise two threads would write to the same place."""
    lanes = 11  # no other array has a dimension of that size
    recording = record(lanes, 30)
    estimator = registry.make(name, MOTION, SENSOR, TARGET_MODEL, num_lanes=lanes, max_landmarks=9)
    start(estimator, recording)
    feed(estimator, recording, 0, 15)
    step = recording.steps[15]
    calls = [estimator._prediction(step.control, np.full(lanes, 0.1)), *estimator._corrections(step.scan)]
    scratch = {id(array) for array in estimator._scratch()}
    shared = [
        one
        for call in calls
        for one in call
        if isinstance(one, np.ndarray) and lanes not in one.shape[:2] and id(one) not in scratch
    ]
    before = [one.copy() for one in shared]
    feed(estimator, recording, 15)
    for one, held in zip(shared, before, strict=True):
        np.testing.assert_array_equal(one, held)


class Recorder:
    """In the place of a bound kernel: who is called, and with which lanes."""

    def __init__(self):
        self.used = []

    def __call__(self, lanes):
        self.used.append((threading.get_ident(), lanes.tolist()))
        return True

    def apart(self, scratch):
        return self


def test_few_lanes_are_not_handed_over():
    recorder = Recorder()
    shared = Shared([recorder], (), LANES, Crew(2))
    assert shared(np.arange(WORTH_IT - 1))
    assert recorder.used == [(threading.get_ident(), list(range(WORTH_IT - 1)))]
    assert shared(np.arange(LANES))
    by_thread: dict[int, list[int]] = {}
    for thread, lanes in recorder.used[1:]:
        by_thread.setdefault(thread, []).extend(lanes)
    some, others = by_thread.values()
    assert sorted(some + others) == list(range(LANES))


def test_a_block_of_lanes_goes_through_all_calls_before_the_next():
    first, second = Recorder(), Recorder()
    second.used = first.used
    lanes = np.arange(BLOCK + 3)
    assert Shared([first, second], (), len(lanes), Crew(1))(lanes)
    assert [some for _, some in first.used] == [list(range(BLOCK))] * 2 + [[BLOCK, BLOCK + 1, BLOCK + 2]] * 2


def _run_in_child(crew, results):
    results.put(crew.run([(abs, -1), (abs, -2)]))


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="this system cannot fork")
def test_a_forked_child_starts_threads_of_its_own():
    crew = Crew(2)
    assert crew.run([(abs, -3), (abs, -4)]) == [3, 4]
    context = multiprocessing.get_context("fork")
    results = context.Queue()
    child = context.Process(target=_run_in_child, args=(crew, results))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # newer Pythons warn of any fork beside threads
        child.start()
    assert results.get(timeout=30) == [1, 2]
    child.join(timeout=30)
    assert child.exitcode == 0
