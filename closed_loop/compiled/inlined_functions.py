"""Functions that stand in their callers' code alone, and are optimised there.

numba makes machine code of every function, although nothing calls a step that is compiled inline
into the loop. Here such a function ends as LLVM's code, which its caller takes over.
"""

from typing import Any

import numba
from numba.core import compiler, compiler_machinery, typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary

_numba: Any = numba
_compiler: Any = compiler
_machinery: Any = compiler_machinery
_Library: Any = JITCodeLibrary
_Lowering: Any = typed_passes.NativeLowering
"""Untyped, as numba has no types for them."""
_OMITTED = (
    typed_passes.NopythonRewrites,
    typed_passes.InlineOverloads,
    untyped_passes.WithLifting,
    untyped_passes.InlineInlinables,
    untyped_passes.LiteralPropagationSubPipelinePass,
    untyped_passes.LiteralUnroll,
    untyped_passes.MakeFunctionToJitFunction,
)


class InlinedLibrary(_Library):  # type: ignore[misc]
    """Code as it is, for the libraries of callers."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        """Leave it to the caller."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


@_machinery.register_pass(mutates_CFG=True, analysis_only=False)
class InlinedLowering(_Lowering):  # type: ignore[misc]
    """Lowers a function into such a library; its entry from Python cannot be called."""

    _name = "inlined_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower the function."""
        name = state.func_id.func_qualname
        make: Any = InlinedLibrary
        state.library = make(state.targetctx.codegen(), name)
        state.flags.no_compile = True
        super().run_pass(state)
        described, module = state.cr.fndesc, state.cr.fndesc.lookup_module()
        entry = _numba._dynfunc.make_function(module, name, "", 0, state.cr.env, (state.library,))
        state.targetctx.insert_user_function(entry, described, [state.library])
        state.cr = state.cr._replace(cfunc=entry)
        return True


class InlinedCompiler(_compiler.CompilerBase):  # type: ignore[misc]
    """numba's passes with this lowering, and without what steps have no use for."""

    def define_pipelines(self) -> list[Any]:
        """Return the one pipeline."""
        pipeline = _compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.passes = [
            (InlinedLowering if each is typed_passes.NativeLowering else each, text)
            for each, text in pipeline.passes
            if each not in _OMITTED
        ]
        pipeline.finalize()
        return [pipeline]


INLINE: Any = {
    "forceinline": True,
    "no_cfunc_wrapper": True,
    "no_cpython_wrapper": True,
    "pipeline_class": InlinedCompiler,
}
"""Options of a function that compiled functions call."""
