"""The first use of an estimator on a machine: two processes compile at once, and whoever waits is told why.

World and estimator take about as long; each process fills the same cache on disk, from which the other then loads.
"""

import inspect
import multiprocessing
import os
import pickle
import subprocess
import sys
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any

from estimators import registry
from estimators.kernels.jit import cache_root, is_writable, source_stamp
from slam_gym.exercise import exercise
from slam_gym.scenario import Scenario
from slam_gym.specs import Spec

PATIENCE = 300.0  # [s] for the other process, which needs a tenth of it
_IMPOSSIBLE = (OSError, TypeError, AttributeError, pickle.PicklingError)  # no other process, or options that cannot go


class FirstUse:
    """Where an estimator has not been used yet, another process compiles it while this one goes on with the world.

    Nothing depends on it: what is not on disk after `wait` is compiled here.

    Args:
        scenario: whose models the estimator gets.
        spec: the estimator.
    """

    def __init__(self, scenario: Scenario, spec: Spec) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._mark = mark_of(scenario, spec)
        if self._mark is None or self._mark.is_file() or not is_writable(self._mark.parent):
            return
        _tell(f"slam-gym: compiling {spec.name!r} for this machine, once (`slam-gym warmup` compiles ahead) ...")
        # A child of a process pool has siblings that compile beside it; a class of a script's own is known here alone.
        if _processors() > 1 and multiprocessing.parent_process() is None and not registry.registered([spec.name]):
            self._process = _start(scenario, spec)

    def wait(self) -> None:
        """Until the other process is done, if there is one."""
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(PATIENCE)

    def __enter__(self) -> "FirstUse":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Nobody waits any more; what went well needs no company again."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        if kind is None and self._mark is not None:
            with suppress(OSError):
                self._mark.touch()


def mark_of(scenario: Scenario, spec: Spec) -> Path | None:
    """The file that tells of an earlier use of this estimator, with its sources and association as they are now.

    None where there are no sources to tell them by: a class of a notebook or of the prompt, or of compiled code.
    """
    chosen = registry.get(spec.name)
    try:
        stamp = source_stamp(Path(inspect.getfile(chosen)))
    except (OSError, TypeError, UnicodeDecodeError):
        return None
    association = spec.options.get("association", scenario.landmarks.labelled)  # has kernels of its own
    return cache_root() / "used" / f"{spec.name}-{stamp}-{zlib.crc32(repr(association).encode()):08x}"


def _processors() -> int:
    """That this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _tell(text: str) -> None:
    """To a person, at a terminal or in a notebook."""
    if sys.stderr is not None and (sys.stderr.isatty() or "ipykernel" in sys.modules):
        print(text, file=sys.stderr, flush=True)


def _start(scenario: Scenario, spec: Spec) -> subprocess.Popen[bytes] | None:
    """This module run by a Python of its own; None where that cannot be."""
    python = sys.executable or ""
    if not Path(python).name.startswith("python"):  # Python inside another program
        return None
    path = os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path)
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    try:
        told = pickle.dumps((scenario, spec))
        process = subprocess.Popen([python, "-m", __name__], env={**os.environ, "PYTHONPATH": path}, **pipes)
        assert process.stdin is not None  # for the type checker
        with process.stdin as stdin:
            stdin.write(told)
    except _IMPOSSIBLE:
        return None
    return process


if __name__ == "__main__":
    exercise(*pickle.load(sys.stdin.buffer))
