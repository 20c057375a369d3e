"""What becomes of compiled functions: a kernel turns into machine code, a subroutine stays a body to copy into kernels.

LLVM copies small functions into the code around them. Of the others each kernel keeps a copy, optimised beside that
kernel's own code, and numba gives all copies one name, for which the linker takes whichever it met first. Then the last
bit of a result would hang on the order in which kernels were compiled or read from disk: so here a kernel's copies are
its own.
"""

from typing import Any

from llvmlite import binding as llvm  # type: ignore[import-untyped, unused-ignore]
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder

_ENVIRONMENT = "_ZN08NumbaEnv"  # begins the names of the variables that numba sets in compiled code
_WIDEST = '"prefer-vector-width"="512"'  # LLVM halves AVX-512's vectors on some processors; others have none as wide


class KernelLibrary(JITCodeLibrary):
    """A kernel's machine code, which calls no other kernel's copies of functions."""

    def _finalize_final_module(self) -> None:
        self._finalized = True
        self._get_module_for_linking()  # a clone, for kernels that call this one: there copies are still merged
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.linkonce_odr:
                function.linkage = llvm.Linkage.internal
        super()._finalize_final_module()


class Bodies(JITCodeLibrary):
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
    """Numba's own passes, into a library of ours."""

    library: type[JITCodeLibrary]

    def define_pipelines(self) -> list[Any]:
        state = self.state
        state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return [DefaultPassBuilder.define_nopython_pipeline(state)]


class KernelCompiler(_Compiler):
    """For `jit.jit`."""

    library = KernelLibrary


class SubroutineCompiler(_Compiler):
    """For `jit.subroutine`; what `jit.disjoint` promises is passed on."""

    library = Bodies

    def define_pipelines(self) -> list[Any]:
        """Numba's, with what the function promises."""
        state, pipelines = self.state, super().define_pipelines()
        state.flags.noalias = state.library.wide = getattr(state.func_id.func, "__disjoint__", False)
        return pipelines
