"""`slam-gym warmup`: compile now what would be compiled at first use."""

from dataclasses import dataclass
from time import perf_counter
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Warmup:
    """Compile estimators ahead, for the environment and for `compare`, into the cache of compiled kernels.

    The first use of an estimator on a machine compiles it, some seconds each; later ones load it from the cache
    (`slam-gym doctor` says where it is). Run this once after an installation or an update, in an image's build, or
    before a cluster's workers start on a shared disk.

    Examples:
      slam-gym warmup                            every estimator installed
      slam-gym warmup ri-ekf fastslam2 --scenarios default slamto
    """

    estimators: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """Names (`slam-gym list estimators`); none: all."""
    scenarios: tuple[str, ...] = ("default",)
    """Names or paths: kinds of robot, target and sensor are compiled apart."""

    def run(self) -> int:
        """Compile with a bar; says what took how long."""
        from rich.console import Console

        from estimators import registry
        from estimators.kernels.jit import cache_root
        from slam_gym.commands.compare import progress_bar

        names = self.estimators or tuple(registry.names())
        for name in names:
            registry.get(name)  # a wrong name fails before anything is compiled
        jobs = [(scenario, name) for scenario in self.scenarios for name in names]
        console, began = Console(), perf_counter()
        with progress_bar("estimators") as progress:
            for done, (scenario, name) in enumerate(jobs):
                progress(f"{name} ({scenario})", done, len(jobs))
                compile_one(scenario, name)
            progress("done", len(jobs), len(jobs))
        seconds = perf_counter() - began
        console.print(f"{len(jobs)} compiled, or found compiled, in {seconds:.0f} s: {cache_root()}", soft_wrap=True)
        return 0


def compile_one(scenario: str, name: str, steps: int = 3) -> None:
    """Use an estimator for a moment, in a comparison and, where it may run there, in the environment."""
    import gymnasium as gym

    from estimators import registry
    from estimators.interface import TruthAware
    from slam_gym.evaluation import compare

    compare(scenario, [name], runs=1, steps=steps, burn_in=1, jobs=1)
    if not issubclass(registry.get(name), TruthAware):
        env = gym.make("slam_gym:SlamTarget-v0", scenario=scenario, estimator=name)
        env.reset(seed=0)
        for _ in range(steps):
            env.step(env.action_space.sample())
        env.close()
