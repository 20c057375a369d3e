"""Compiled kernels on disk: an edit anywhere below a kernel is noticed, a blocked folder costs only the cache."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from llvmlite import binding as llvm
from numba import njit, types

from estimators.kernels import jit as jit_module
from estimators.kernels.libraries import KernelCompiler

CALLEE = """
from estimators.kernels.jit import inline

@inline
def helper(x):
    return {factor} * x
"""
CALLER = """
from agents.callee import helper
from estimators.kernels.jit import jit

@jit
def kernel(x):
    return helper(x) + 1.0
"""
SCRIPT = "from agents.caller import kernel; print(kernel(10.0), sum(kernel.stats.cache_hits.values()))"


@pytest.fixture
def project(tmp_path):
    package = tmp_path / "agents"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "callee.py").write_text(CALLEE.format(factor=2.0))
    (package / "caller.py").write_text(CALLER)
    return tmp_path


def run(project: Path, cache: Path) -> list[float]:
    root = Path(jit_module.__file__).resolve().parents[2]
    paths = os.pathsep.join([str(project), str(root)])
    environment = {**os.environ, "PYTHONPATH": paths, "SLAM_GYM_CACHE_DIR": str(cache)}
    command = [sys.executable, "-W", "error", "-c", SCRIPT]
    done = subprocess.run(command, cwd=project, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [float(word) for word in done.stdout.split()]


def test_an_edit_of_a_called_function_in_another_file_is_noticed(project):
    cache = project / "cache"
    assert run(project, cache) == [21.0, 0]
    assert run(project, cache) == [21.0, 1]
    (project / "agents" / "callee.py").write_text(CALLEE.format(factor=3.0))
    assert run(project, cache) == [31.0, 0]


def test_a_cache_folder_that_cannot_be_written_costs_the_cache_only(project):
    blocked = project / "file"
    blocked.touch()
    assert run(project, blocked / "cache") == [21.0, 0]
    assert not list(project.rglob("*.nbi"))


def test_the_cache_folder_is_the_users_choice(monkeypatch, tmp_path):
    monkeypatch.setenv("SLAM_GYM_CACHE_DIR", str(tmp_path))
    assert jit_module.cache_root() == tmp_path
    monkeypatch.delenv("SLAM_GYM_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("LOCALAPPDATA", raising=False)
    assert jit_module.cache_root() == tmp_path / "slam-gym" / "kernels"


def test_the_stamp_reaches_through_imports():
    names = {file.name for file in jit_module._imported_files("from estimators.kernels import angles, random\n")}
    assert {"angles.py", "random.py"} <= names
    names = {
        file.name for file in jit_module._imported_files("from estimators.kernels.angles import wrap\nimport numpy\n")
    }
    assert names == {"angles.py"}


def test_a_function_without_a_file_still_compiles():
    scope = {}
    exec("def double(x):\n    return 2.0 * x\n", scope)
    assert jit_module.jit(scope["double"])(4.0) == 8.0


@jit_module.subroutine
def half(x):
    return 0.5 * x


@jit_module.jit
def half_and_one(x):
    return half(x) + 1.0


def test_a_subroutine_is_for_kernels_and_python_may_call_it_before_and_after_them():
    assert half(3.0) == 1.5
    assert half_and_one(3.0) == 2.5
    assert half_and_one(np.array([3.0]))[0] == 2.5
    assert half(np.array([3.0]))[0] == 1.5


def add_products(total, a, b):
    for i in range(total.size):
        total[i] += a[i] * b[i]


@jit_module.disjoint
def add_products_apart(total, a, b):
    for i in range(total.size):
        total[i] += a[i] * b[i]


def test_rows_that_do_not_overlap_are_not_checked_for_it():
    def body(function):
        rows = types.Array(types.float64, 1, "C")
        function.compile((rows, rows, rows))
        return str(function.overloads[(rows, rows, rows)].library._get_module_for_linking())

    checked, promised = body(jit_module.subroutine(add_products)), body(add_products_apart)
    assert "icmp ult ptr" in checked and "icmp ult ptr" not in promised  # where one row ends, and another begins
    assert "prefer-vector-width" not in checked and '"prefer-vector-width"="512"' in promised
    total = np.ones(11)
    add_products_apart(total, np.arange(11.0), np.full(11, 2.0))
    np.testing.assert_array_equal(total, 1.0 + 2.0 * np.arange(11.0))


@jit_module.subroutine
def _long(x):
    """Longer than LLVM copies twice into another function."""
    total = 0.0
    for i in range(x.size):
        a, b = np.hypot(x[i], i), np.arctan2(x[i], total)
        for j in range(i, x.size):
            a += np.sin(b * x[j]) / (1.0 + np.log1p(abs(a)))
            b = max(b * np.exp(-a), np.cbrt(a)) if x[j] > a else min(np.tanh(b), np.cos(a + b))
        total += np.sqrt(abs(a - b)) if a > b else np.sinh(b) - np.expm1(-a)
    return total


@njit(pipeline_class=KernelCompiler, **jit_module.OPTIONS)  # as `jit` does, but never read from disk
def _calls_it(x):
    return _long(x) * _long(x[1:]) + _long(x[2:]) - _long(x[:-1]) / _long(x[:-2]) + _long(x[3:])


def test_a_kernel_calls_no_other_kernels_copy_of_a_function():
    """Names that the linker may take from elsewhere would let the order of compilation decide the last bit."""
    kinds = (types.float64[::1],)
    _calls_it.compile(kinds)
    module = llvm.parse_bitcode(_calls_it.overloads[kinds].library._final_module.as_bitcode())
    defined = [function for function in module.functions if not function.is_declaration]
    assert {function.linkage for function in defined} <= {llvm.Linkage.external, llvm.Linkage.internal}
    assert any("_long" in function.name for function in defined)
