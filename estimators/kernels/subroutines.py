"""Functions that only kernels call: compiled until LLVM can copy them into those kernels, and no further.

Numba compiles whatever a kernel calls as if Python called it too: it makes a door for Python's objects, which for
many arrays is longer than the function, and generates machine code, which nobody runs, as every kernel has a copy of
its own. A `Subroutine` ends at the optimised body. The kernels come out the same to the last bit.
"""

from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from types import FunctionType
from typing import Any

from llvmlite import binding as llvm  # type: ignore[import-untyped, unused-ignore]
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.registry import CPUDispatcher
from numba.core.types import unliteral

_NJIT = {"nopython": True, "boundscheck": None}  # what `numba.njit` adds to the options
_ENVIRONMENT = "_ZN08NumbaEnv"  # begins the names of the variables that numba sets in compiled code
_WIDEST = '"prefer-vector-width"="512"'  # LLVM halves AVX-512's vectors on some processors; others have none as wide


class _Bodies(JITCodeLibrary):
    """Compiled functions to link into others; only their variables become machine code."""

    wide = False  # whether loops get the processor's widest vectors

    def add_ir_module(self, ir_module: Any) -> None:
        """Numba's, with what LLVM is to know about the functions."""
        for function in ir_module.functions if self.wide else ():
            set.add(function.attributes, _WIDEST)  # llvmlite's own `add` knows no attributes with values
        super().add_ir_module(ir_module)

    def _finalize_final_module(self) -> None:
        self._finalized = True
        bodies = self._get_module_for_linking()
        variables = [str(one) for one in bodies.global_variables if one.name.startswith(_ENVIRONMENT)]
        empty = str(self._codegen._create_empty_module(self.name))
        self._final_module = llvm.parse_assembly("\n".join([empty, *variables]))
        self._final_module.name = bodies.name
        super()._finalize_final_module()


class _Compiler(CompilerBase):  # type: ignore[misc, unused-ignore]
    """Numba's own passes, into a library of `_Bodies`; what `jit.disjoint` promises is passed on."""

    def define_pipelines(self) -> list[Any]:
        state = self.state
        state.library = _Bodies(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.noalias = state.library.wide = getattr(state.func_id.func, "__disjoint__", False)
        state.library.enable_object_caching()
        return [DefaultPassBuilder.define_nopython_pipeline(state)]


class Subroutine(CPUDispatcher):  # type: ignore[misc, unused-ignore]
    """A function for kernels to call. Python may call it as well, to test it: it is then compiled anew, as a kernel.

    Args:
        py_func: the function. targetoptions: numba's, as those of `numba.njit`.
    """

    def __init__(
        self,
        py_func: Callable[..., Any],
        locals: dict[str, Any] | None = None,
        targetoptions: dict[str, Any] | None = None,
        pipeline_class: type = _Compiler,
    ) -> None:
        options = {**_NJIT, "no_cpython_wrapper": True, **(targetoptions or {})}
        super().__init__(py_func, locals or {}, options, pipeline_class)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Numba's; a constant argument is a number like any other, not a reason to compile the function once more."""
        return super().get_call_template(tuple(map(unliteral, args)), {k: unliteral(v) for k, v in kws.items()})

    def __call__(self, *arguments: Any) -> Any:
        """What Python gets."""
        return self._from_python(*arguments)

    @cached_property
    def _from_python(self) -> Any:
        own = self.py_func
        copy = FunctionType(own.__code__, own.__globals__, own.__name__, own.__defaults__, own.__closure__)
        copy.__qualname__ = f"{own.__qualname__}_from_python"  # the name of its file on disk
        copy.__dict__.update(own.__dict__)
        return on_disk(CPUDispatcher(copy, {}, {**self.targetoptions, "no_cpython_wrapper": False}))


def on_disk(function: Any) -> Any:
    """The compiled function, kept on disk where that can be: not where nothing can be written, or at a prompt."""
    with suppress(RuntimeError):
        function.enable_caching()
    return function
