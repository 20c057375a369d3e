"""What the numbers were measured on, and with."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

PACKAGES = (
    "slam-gym", "numpy", "scipy", "numba", "llvmlite", "gymnasium", "pygame-ce", "stable-baselines3", "torch", "gtsam",
    "filterpy", "stonesoup",
)  # fmt: skip


def machine() -> dict[str, Any]:
    """Processor, its vectors, cores, system and versions; what is not installed is left out."""
    import llvmlite.binding as llvm  # type: ignore[import-untyped, unused-ignore]

    features = llvm.get_host_cpu_features()
    widest = next((name for name in ("avx512f", "avx2", "avx", "neon", "sse2") if features.get(name)), "none")
    return {
        "processor": processor_name(),
        "vectors": widest,
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "versions": {name: found for name in PACKAGES if (found := _version(name)) is not None},
    }


def processor_name() -> str:
    """As the system calls it, with LLVM's name of its kind."""
    import llvmlite.binding as llvm  # type: ignore[import-untyped, unused-ignore]

    name = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            name = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    return f"{name} ({llvm.get_host_cpu_name()})"


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
