"""How every kernel is compiled: the one file that names numba options.

`@jit` makes a kernel, which Python calls. What only kernels call is a `@subroutine`, or `@inline` where it is small;
both compile in less time, as far as they have to. `@disjoint` is a subroutine over rows that do not overlap.

`@jit` compiles lazily (no signatures: eager ones make an import take many seconds) and keeps machine code on
disk. numba's own cache notices an edit to the decorated file but not to a function that it calls in another
file, so each file's cache folder here is stamped with a hash of that file and of every file of this project it
imports, directly or not. A read-only home costs the cache, never the import.
"""

import hashlib
import os
import re
import tempfile
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numba
from numba.core import caching

from estimators.kernels.libraries import KernelCompiler
from estimators.kernels.subroutines import Subroutine, on_disk

# Without "afn", "nnan" and "ninf": those let the compiler delete the checks for NaN and infinity.
FASTMATH = {"contract", "reassoc", "nsz", "arcp"}
# error_model="numpy": Python's division check would stop vectorisation (6x on an inner loop).
# no_cfunc_wrapper: nobody calls kernels from C, and compiling that door takes an eighth of the time.
# boundscheck/parallel stay off: OpenMP kills forked children, and Gymnasium's AsyncVectorEnv forks.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True, "fastmath": FASTMATH, "no_cfunc_wrapper": True}

PROJECT_PACKAGES = ("estimators", "slam_gym", "agents")
_IMPORT = re.compile(r"^\s*(?:from\s+([\w.]+)\s+import\s+\(?([^)\n]*)|import\s+([\w.]+))", re.MULTILINE)


@cache
def _module_file(name: str) -> Path | None:
    """Source file of one of this project's modules; None for anything else."""
    head, *rest = name.split(".")
    if head not in PROJECT_PACKAGES:
        return None
    spec = find_spec(head)  # a top-level package is found without importing it
    if spec is None or spec.origin is None:
        return None
    root = Path(spec.origin).parent
    base = root.joinpath(*rest)
    for candidate in (base.with_suffix(".py"), base / "__init__.py"):
        if candidate.is_file():
            return candidate
    return None


def _imported_files(source: str) -> set[Path]:
    files = set()
    for module, names, plain in _IMPORT.findall(source):
        candidates = [plain or module]
        candidates += [f"{module}.{word}" for word in re.findall(r"\w+", names)]
        files |= {file for name in candidates if (file := _module_file(name)) is not None}
    return files


@cache
def source_stamp(file: Path) -> str:
    """Hash of a source file and of every project file it reaches through imports."""
    seen: dict[Path, bytes] = {}
    waiting = [Path(file)]
    while waiting:
        path = waiting.pop()
        if path not in seen:
            seen[path] = path.read_bytes()
            waiting.extend(_imported_files(seen[path].decode()))
    digest = hashlib.sha256(f"{numba.__version__} {sorted(FASTMATH)} {OPTIONS['error_model']}".encode())
    for path in sorted(seen):
        digest.update(path.name.encode())
        digest.update(seen[path])
    return digest.hexdigest()[:16]


def cache_root() -> Path:
    """Folder of compiled kernels: `SLAM_GYM_CACHE_DIR`, else the user's cache folder."""
    if chosen := os.environ.get("SLAM_GYM_CACHE_DIR"):
        return Path(chosen)
    base = os.environ.get("LOCALAPPDATA") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "slam-gym" / "kernels"


@cache
def is_writable(folder: Path) -> bool:
    """Whether files can be made in a folder, which is made where it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


class _StampedLocator(caching._CacheLocator):
    """Tells numba where this project's kernels are kept; declines every other function."""

    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        self._file = Path(py_file)
        self._line = py_func.__code__.co_firstlineno

    def get_cache_path(self) -> str:
        return str(cache_root() / f"{self._file.stem}-{source_stamp(self._file)}")

    def get_source_stamp(self) -> str:
        return source_stamp(self._file)

    def get_disambiguator(self) -> str:
        return str(self._line)

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> "_StampedLocator | None":
        if not getattr(py_func, "__slam_gym_kernel__", False):
            return None
        locator = cls(py_func, py_file)
        # Declining would hand our kernels to numba's own locators, whose stamp misses edits to called functions.
        if not Path(py_file).is_file() or not is_writable(Path(locator.get_cache_path())):
            raise RuntimeError("no folder for this compiled kernel")
        return locator


if _StampedLocator not in caching.CacheImpl._locator_classes:
    caching.CacheImpl._locator_classes.insert(0, _StampedLocator)


def jit(function: Callable[..., Any], /, **options: Any) -> Any:
    """Compile a kernel with the project's options; falls back to no disk cache where none can be written."""
    function.__slam_gym_kernel__ = True  # type: ignore[attr-defined]
    return on_disk(numba.njit(pipeline_class=KernelCompiler, **{**OPTIONS, **options})(function))


def subroutine(function: Callable[..., Any], /, **options: Any) -> Any:
    """Compile a function that kernels call, and Python only in tests; see `estimators.kernels.subroutines`."""
    function.__slam_gym_kernel__ = True  # type: ignore[attr-defined]
    return Subroutine(function, targetoptions={**OPTIONS, **options})


def disjoint(function: Callable[..., Any], /) -> Any:
    """Compile a subroutine whose arrays never overlap: rows of numbers that one vectorised pass reads and writes.

    Without that promise every call checks each pair of rows before it may use vectors, and the loop is compiled a
    second time for rows that do overlap: two to three times the compilation. The vectors are the processor's widest.
    """
    function.__disjoint__ = True  # type: ignore[attr-defined]
    return subroutine(function)


def inline(function: Callable[..., Any], /) -> Any:
    """Compile a small subroutine that its callers absorb (LLVM inlines it; no array views at the call)."""
    return subroutine(function, inline="never", forceinline=True)
