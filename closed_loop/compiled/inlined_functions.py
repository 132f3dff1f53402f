"""Functions that stand in their callers' code alone, and are optimised there.

numba makes machine code of every function, although nothing calls a step that is compiled inline
into the loop. Here such a function ends as LLVM's code, which its caller takes over.

Without a cache ``simulate(engine="compiled")`` takes 5.3 s of processor time instead of the 7.2 s
of numba's own compiler, and 5.7 s if no pass is left out (medians of three).
"""

from types import CodeType
from typing import Any

import numba
from numba.core import cgutils, compiler, compiler_machinery, typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.lowering import Lower as NumbasLower

_numba: Any = numba
_compiler: Any = compiler
_machinery: Any = compiler_machinery
_cgutils: Any = cgutils
_Library: Any = JITCodeLibrary
_Lower: Any = NumbasLower
_Lowering: Any = typed_passes.NativeLowering
"""Untyped, as numba has no types for them."""


class Lower(_Lower):  # type: ignore[misc]
    """Lowers without debug information, and without reference counts where there are none."""

    def alloca_lltype(self, name: str, lltype: Any, **_: Any) -> Any:
        """Make room for a variable; numba would ask LLVM for its size."""
        return _cgutils.alloca_once(self.builder, lltype, name=name)

    def delvar(self, name: str) -> None:
        """Forget a variable; what it refers to may then be free."""
        if self.context.enable_nrt:
            super().delvar(name)


class CallerLibrary(_Library):  # type: ignore[misc]
    """Code with that of all functions it calls, linked and optimised once."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)

    def finalize(self) -> None:
        """Link what callees call, too."""
        libraries: list[Any] = self._linking_libraries
        for library in libraries:  # which grows
            libraries += [one for one in library._linking_libraries if one not in libraries]
        super().finalize()


class InlinedLibrary(CallerLibrary):
    """Code as it is, without that of the functions it calls."""

    def finalize(self) -> None:
        """Leave linking and optimisation to the caller."""
        for function in self._final_module.functions:
            if not function.is_declaration:
                function.linkage = "linkonce_odr"
        self._shared_module, self._finalized = self._final_module, True
        self._finalize_dynamic_globals()


@_machinery.register_pass(mutates_CFG=True, analysis_only=False)
class InlinedLowering(_Lowering):  # type: ignore[misc]
    """Lowers a function into such a library; its entry from Python cannot be called."""

    _name = "inlined_lowering"
    lowering_class = Lower

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


@_machinery.register_pass(mutates_CFG=True, analysis_only=False)
class CallerLowering(_Lowering):  # type: ignore[misc]
    """Lowers a function into such a library."""

    _name = "caller_lowering"
    lowering_class = Lower

    def run_pass(self, state: Any) -> bool:
        """Lower the function."""
        make: Any = CallerLibrary
        state.library = make(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return bool(super().run_pass(state))


class InlinedCompiler(_compiler.CompilerBase):  # type: ignore[misc]
    """numba's passes with this lowering, and without those that a function has no use for."""

    lowering = InlinedLowering

    def define_pipelines(self) -> list[Any]:
        """Return the one pipeline."""
        # Neither arrays' expressions nor functions whose text numba inlines: 5 % of a cold start.
        omitted: list[Any] = [
            typed_passes.InlineOverloads,
            typed_passes.NopythonRewrites,
            untyped_passes.InlineInlinables,
        ]
        if not any(isinstance(each, CodeType) for each in self.state.func_id.code.co_consts):
            omitted.append(untyped_passes.InlineClosureLikes)
        if not self.state.flags.nrt:
            omitted.append(typed_passes.IRLegalization)  # says where references end
        pipeline = _compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.passes = [
            (self.lowering if each is typed_passes.NativeLowering else each, text)
            for each, text in pipeline.passes
            if each not in omitted
        ]
        pipeline.finalize()
        return [pipeline]


class CallerCompiler(InlinedCompiler):
    """The same for a function that calls them."""

    lowering = CallerLowering


INLINE: Any = {
    "forceinline": True,
    "no_cfunc_wrapper": True,
    "no_cpython_wrapper": True,
    "pipeline_class": InlinedCompiler,
}
"""Options of a function that compiled functions call."""
