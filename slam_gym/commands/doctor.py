"""`slam-gym doctor`: what is installed, what is compiled, whether it is as fast as it should be."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

# How many times as fast as clean NumPy in one process; BENCHMARKS.md has the machine.
REFERENCE_RATIOS = {"gym.make": 43.0, "gym.make_vec, 256 lanes": 130.0}
SLOW = 0.5  # share of a reference below which something is wrong


@dataclass(frozen=True)
class Doctor:
    """Print versions, the cache of compiled kernels, processor and threads; then check the speed for some ten seconds.

    Paste its output into a bug report.

    Example: slam-gym doctor
    """

    no_speed: bool = False
    """Leave the speed check out."""

    def run(self) -> int:
        """Look, print; 1 where something is wrong."""
        from rich.console import Console

        from slam_gym.benchmark.machine import machine

        console = Console(highlight=False, soft_wrap=True)
        one = machine()
        for name, number in one["versions"].items():
            console.print(f"{name:<18} {number}")
        console.print(f"\nsystem             {one['system']}")
        console.print(f"processor          {one['processor']}, {one['cores']} cores, vectors {one['vectors']}")
        for name, text in {**thread_settings(), **places()}.items():
            console.print(f"{name:<18} {text}")
        for name, text in cache_state().items():
            console.print(f"{name:<18} {text}")
        return 0 if self.no_speed or check_speed(console) else 1


def thread_settings() -> dict[str, str]:
    """What says how many threads the libraries beneath may start."""
    import os

    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
    chosen = [f"{name}={os.environ[name]}" for name in names if name in os.environ]
    return {
        "threads": "one per environment (argument threads); " + (", ".join(chosen) or "no limits set for libraries")
    }


def places() -> dict[str, str]:
    """Where the three packages lie."""
    import slam_gym

    return {"installed at": str(Path(slam_gym.__file__).parents[1])}


def cache_state() -> dict[str, str]:
    """Where compiled kernels are kept, whether anything can be written there, how many there are."""
    from estimators.kernels.jit import cache_root, is_writable

    root = cache_root()
    state = "writable" if is_writable(root) else "NOT writable: every start compiles anew; set SLAM_GYM_CACHE_DIR"
    kernels = list(root.rglob("*.nbc")) if root.is_dir() else []
    size = sum(file.stat().st_size for file in kernels)
    told = f"{len(kernels)} kernels, {size / 1e6:.0f} MB (`slam-gym warmup` compiles ahead)"
    return {"kernel cache": f"{root}, {state}", "": told}


def check_speed(console: Any) -> bool:
    """Whether both environments are about as many times as fast as clean NumPy as they should be."""
    from slam_gym.benchmark.environment import environment_rows

    with console.status("checking the speed, some ten seconds"):
        rows = {row["name"]: row for row in environment_rows((256,), rounds=8, foreign=False)}
    console.print()
    well = True
    for name, reference in REFERENCE_RATIOS.items():
        ratio = rows[name]["times_numpy"]
        fine = ratio >= SLOW * reference
        well = well and fine
        verdict = "fine" if fine else "SLOW: is the machine busy, or are kernels compiled without a cache?"
        console.print(
            f"{name:<24} {rows[name]['microseconds']:6.1f} us a step, {ratio:5.1f} times as fast as clean NumPy "
            f"(reference {reference:.0f}): {verdict}"
        )
    return well
