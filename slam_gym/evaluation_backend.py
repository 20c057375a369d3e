"""Where the units of a comparison are worked on: here, in processes of this machine, or on a Ray cluster.

A unit's numbers depend on its settings, seed and runs alone, so it does not matter where it is done, or done again.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import joblib

from estimators import registry
from estimators.interface import Estimator
from slam_gym import policies

Backend = Literal["processes", "ray"]
Task = tuple[Callable[..., Any], tuple[Any, ...]]  # a function and its arguments

Own = tuple[dict[str, type[Estimator]], dict[str, type[policies.Policy]]]

RETRIES = 5  # of a task whose Ray worker was lost


@dataclass(frozen=True)
class Workers:
    """Who does the work.

    Attributes:
        jobs: how many at once; 1 with "processes" is this process.
        backend: "processes" or "ray".
        own: estimators and policies that a script has registered: a worker has not run that script.
    """

    jobs: int
    backend: Backend = "processes"
    own: Own = field(default_factory=lambda: ({}, {}), repr=False, compare=False)

    @property
    def is_here(self) -> bool:
        """Whether this process does everything itself."""
        return self.backend == "processes" and self.jobs == 1

    def results(self, tasks: Sequence[Task]) -> Iterator[Any]:
        """What the tasks return, as they are done, in any order."""
        if not self.is_here and any(self.own):
            tasks = [(_call_knowing, (self.own, function, arguments)) for function, arguments in tasks]
        if self.backend == "ray":
            yield from _from_ray(tasks, self.jobs)
        elif self.jobs == 1:
            yield from (function(*arguments) for function, arguments in tasks)
        else:
            calls = [joblib.delayed(function)(*arguments) for function, arguments in tasks]
            yield from joblib.Parallel(n_jobs=self.jobs, return_as="generator_unordered", batch_size=1)(calls)


@contextmanager
def workers(jobs: int | None = None, backend: str = "processes", address: str | None = None) -> Iterator[Workers]:
    """Workers for the time of the block.

    Args:
        jobs: how many at once; None: one per CPU of this machine, or of the cluster.
        backend: "processes" or "ray".
        address: of a running Ray cluster, "auto" for the one this machine belongs to; None: Ray is started here.

    Raises:
        ValueError: another backend, an address without Ray, a number below 1.
        ImportError: Ray is not installed.
        ConnectionError: there is no cluster at the address.
    """
    if backend not in get_args(Backend):
        raise ValueError(f"backend must be one of {', '.join(map(repr, get_args(Backend)))}; got {backend!r}")
    if jobs is not None and jobs < 1:
        raise ValueError(f"jobs must be at least 1; got {jobs}")
    if backend == "processes":
        if address is not None:
            raise ValueError("an address is a Ray cluster's: give backend='ray' (--backend ray) with it")
        yield Workers(int(joblib.cpu_count()) if jobs is None else int(jobs))
        return
    ray = _ray()
    mine = not ray.is_initialized()
    if mine:
        ray.init(address=address, log_to_driver=False, include_dashboard=False if address is None else None)
    try:
        yield Workers(int(ray.cluster_resources().get("CPU", 1)) if jobs is None else int(jobs), "ray")
    finally:
        if mine:
            ray.shutdown()


def _ray() -> Any:
    try:
        import ray
    except ImportError:
        raise ImportError(
            "backend 'ray' needs Ray: pip install -c constraints.txt '.[cluster]' in the folder of slam-gym"
        ) from None
    return ray


def _from_ray(tasks: Sequence[Task], jobs: int) -> Iterator[Any]:
    """Ray tasks, at most `jobs` on their way at once; a task whose worker dies is begun again elsewhere."""
    ray = _ray()
    remote = ray.remote(max_retries=RETRIES)(_call)
    waiting: list[Task] = list(reversed(tasks))
    running: list[Any] = []
    while waiting or running:
        while waiting and len(running) < jobs:
            function, arguments = waiting.pop()
            running.append(remote.remote(function, arguments))
        done, running = ray.wait(running, num_returns=1)
        yield from ray.get(done)


def _call_knowing(own: Own, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """In a worker: make the script's own classes known, then work."""
    estimators, chosen_policies = own
    for name, estimator in estimators.items():
        registry.register(name, estimator)
    for name, policy in chosen_policies.items():
        policies.register(name, policy)
    return function(*arguments)


def _call(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    return function(*arguments)
