"""One step of the environment against the same work in clean NumPy and in Gymnasium's own vector environments.

Scenario `open` with 20 landmarks and the joint EKF: about 9 returns and an update in every step.
"""

from collections.abc import Iterator
from contextlib import ExitStack, closing
from typing import Any

import gymnasium as gym
import numpy as np

from slam_gym.benchmark.numpy_env import NumpyEnv
from slam_gym.benchmark.timing import Work, least_seconds
from slam_gym.threads import WORTH_IT

ACTION = np.array([0.4, 0.3], dtype=np.float32)
SETTLED = 100  # steps until the map is whole
ARGUMENTS: dict[str, Any] = {"scenario": "open", "estimator": "ekf"}
GYMNASIUM_LANES = 8  # in Gymnasium's vector environments of the single one


def environment_rows(
    lanes: tuple[int, ...] = (1, 64, 256, 1024), rounds: int = 30, foreign: bool = True
) -> list[dict[str, Any]]:
    """Rows (name, microseconds per lane and step, steps per second, times as fast as NumPy).

    Args:
        lanes: of our vector environment.
        rounds: see `least_seconds`.
        foreign: Gymnasium's own vector environments too.
    """
    with ExitStack() as stack:
        single = stack.enter_context(closing(gym.make("slam_gym:SlamTarget-v0", **ARGUMENTS)))
        cart = stack.enter_context(closing(gym.make("CartPole-v1")))
        vectors = {f"gym.make_vec, {n} lanes": stack.enter_context(closing(native(n))) for n in lanes}
        most = max(lanes)
        if foreign and most >= 2 * WORTH_IT:
            vectors[f"gym.make_vec, {most} lanes, 2 threads"] = stack.enter_context(closing(native(most, threads=2)))
        others = {name: stack.enter_context(closing(env)) for name, env in _foreign()} if foreign else {}
        numpy_env: list[NumpyEnv] = []

        def renew() -> None:
            """Everybody starts anew, and measures with a whole map."""
            single.reset(seed=0)
            numpy_env[:] = [_numpy_env(single)]
            cart.reset(seed=0)
            works = _works(single, numpy_env[0])
            for env in (*vectors.values(), *others.values()):
                env.reset(seed=0)
                works.append(vector_work(env))
            for _ in range(SETTLED):
                for work in works:
                    work()

        renew()
        works: dict[str, Work] = {
            "clean NumPy": lambda: numpy_env[0].step(ACTION),
            "gym.make": lambda: single.step(ACTION),
            **{name: vector_work(env) for name, env in vectors.items()},
            **{name: vector_work(env) for name, env in others.items()},
            "CartPole-v1 (a calibration)": _cart_work(cart),
        }
        size = {name: env.num_envs for name, env in vectors.items()} | dict.fromkeys(others, GYMNASIUM_LANES)
        seconds = least_seconds(works, rounds=rounds, renew=renew)
    return [_row(name, second / size.get(name, 1), seconds["clean NumPy"]) for name, second in seconds.items()]


def _row(name: str, seconds: float, numpy_seconds: float) -> dict[str, Any]:
    return {
        "name": name,
        "microseconds": 1e6 * seconds,
        "per_second": 1.0 / seconds,
        "times_numpy": numpy_seconds / seconds,
    }


def native(lanes: int, threads: int = 1) -> Any:
    """Our vector environment with that many lanes."""
    return gym.make_vec("slam_gym:SlamTarget-v0", num_envs=lanes, threads=threads, **ARGUMENTS)


def _foreign() -> Iterator[tuple[str, Any]]:
    """Gymnasium's vector environments of the single one."""
    for name, mode in (("SyncVectorEnv of gym.make", "sync"), ("AsyncVectorEnv of gym.make", "async")):
        lanes = GYMNASIUM_LANES
        env = gym.make_vec("slam_gym:SlamTarget-v0", num_envs=lanes, vectorization_mode=mode, **ARGUMENTS)
        yield f"{name}, {lanes} lanes", env


def _numpy_env(single: Any) -> NumpyEnv:
    """The NumPy step in the world of the single environment, just reset."""
    world = single.unwrapped.simulation.world
    max_range = single.unwrapped.scenario.sensor.max_range
    return NumpyEnv(world.landmarks[0], world.pose[0], world.target[0], max_range=max_range)


def _works(single: Any, numpy_env: NumpyEnv) -> list[Work]:
    return [lambda: single.step(ACTION), lambda: numpy_env.step(ACTION)]


def vector_work(env: Any) -> Work:
    """A step of every lane."""
    actions = np.tile(ACTION, (env.num_envs, 1))
    return lambda: env.step(actions)


def _cart_work(cart: Any) -> Work:
    """A step of CartPole that begins anew where an episode ends."""

    def work() -> None:
        if cart.step(1)[2]:
            cart.reset()

    return work
