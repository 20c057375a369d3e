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

from numba.core.registry import CPUDispatcher
from numba.core.types import unliteral

from estimators.kernels.libraries import KernelCompiler, SubroutineCompiler

_NJIT = {"nopython": True, "boundscheck": None}  # what `numba.njit` adds to the options


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
        pipeline_class: type = SubroutineCompiler,
    ) -> None:
        options = {**_NJIT, "no_cpython_wrapper": True, **(targetoptions or {})}
        super().__init__(py_func, locals or {}, options, pipeline_class)

    _kept = False  # on disk, where that can be

    def compile(self, sig: Any) -> Any:
        """Numba's. Only now is there a place on disk to be found: a kernel read from there never asks its parts."""
        if not self._kept:
            self._kept = True
            on_disk(self)
        return super().compile(sig)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Numba's; a constant argument is a number like any other, not a reason to compile the function once more."""
        return super().get_call_template(tuple(map(unliteral, args)), {k: unliteral(v) for k, v in kws.items()})

    def __call__(self, *arguments: Any) -> Any:
        """What Python gets."""
        return self._from_python(*arguments)

    @cached_property
    def _from_python(self) -> Any:
        return self._copy("from_python", no_cpython_wrapper=False)

    @cached_property
    def as_kernel(self) -> Any:
        """The same in machine code of its own, for `bound`: without a door for Python."""
        return self._copy("as_kernel")

    def _copy(self, suffix: str, **options: bool) -> Any:
        own = self.py_func
        copy = FunctionType(own.__code__, own.__globals__, own.__name__, own.__defaults__, own.__closure__)
        copy.__qualname__ = f"{own.__qualname__}_{suffix}"  # the name of its file on disk
        copy.__dict__.update(own.__dict__)
        return on_disk(CPUDispatcher(copy, {}, {**self.targetoptions, **options}, KernelCompiler))


def on_disk(function: Any) -> Any:
    """The compiled function, kept on disk where that can be: not where nothing can be written, or at a prompt."""
    with suppress(RuntimeError):
        function.enable_caching()
    return function
