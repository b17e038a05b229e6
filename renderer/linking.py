"""Links the functions of a kernel without optimising any of them again in each caller, and emits machine code of entries only.

Numba links all callees into each function, then optimises the whole and emits machine code for it. A deep callee would be
optimised and translated once for each function above it in the call graph.
"""

from __future__ import annotations

from typing import Any, Self

import llvmlite.binding as llvm
from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary
from numba.core.compiler import compile_result
from numba.core.compiler_machinery import AnalysisPass, register_pass

__all__ = ["ChooseLibrary", "mark_never_inlined", "restore_compiled"]

_PART, _KERNEL = "part", "kernel"  # kinds of cached libraries
_ENVIRONMENT = "_ZN08NumbaEnv"  # prefix of a function's Numba environment symbol


def mark_never_inlined(library: Any) -> None:
    """Marks the function of an unfinished library as never inlined into its callers."""
    if isinstance(library, _Kernel):
        library.is_inlinable = False


class _Kernel(JITCodeLibrary):
    """The code library of a function that Python calls. Callees that are not inlined are linked after it was optimised.

    counts: whether the function is compiled with reference counts of arrays. is_inlinable: whether LLVM may inline it into
    callers. beneath: name -> code of each callee that is not inlined; a callee comes after its own callees. _unread: the unparsed
    bitcode of a cached kernel. It is large and slow to parse, and needed only if another function links with the kernel.
    """

    counts = False
    is_inlinable = True
    beneath: dict[str, Any]
    _unread: bytes | None = None
    _read: Any = None

    def _optimize_functions(self, ll_module: Any) -> None:
        """Optimises each function before linking, but only if the library counts references.

        Numba removes such counts in that step.
        """
        if self.counts:
            super()._optimize_functions(ll_module)
        ll_module.data_layout = str(super().codegen.target_data)

    def _optimize_final_module(self) -> None:
        if self.counts:
            super()._optimize_final_module()
            return
        passes = super().codegen._pass_builder()
        passes.getModulePassManager().run(self._final_module, passes)

    def finalize(self) -> None:
        """Finalises the library as Numba does, but links after optimising."""
        self.beneath = {}
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            if isinstance(library, InlinedLibrary):
                self.beneath.update(library.beneath)
            if getattr(library, "is_inlinable", True):
                self._final_module.link_in(library._get_module_for_linking(), preserve=True)
            else:
                self.beneath[library.own_name] = library._get_module_for_linking()
        self._optimize_final_module()
        self._finalize_final_module()

    def _finalize_final_module(self) -> None:
        for module in reversed(self.beneath.values()):  # unused functions are dropped
            self._final_module.link_in(llvm.parse_bitcode(module) if isinstance(module, bytes) else module, preserve=True)
        self._final_module.verify()
        super()._finalize_final_module()

    def serialize_using_object_code(self) -> tuple[str, str, Any]:
        """Returns the code and attributes of the library, which Numba writes to the cache."""
        name, _, (machine_code, bitcode) = super().serialize_using_object_code()
        module = self._get_module_for_linking()
        defined = [each.name for each in (*module.functions, *module.global_variables) if not each.is_declaration]
        return name, _KERNEL, (machine_code, bitcode, defined)

    @classmethod
    def restored(cls, codegen: Any, name: str, code: Any) -> Self:
        """Restores a library from its cached state, as returned by `serialize_using_object_code`."""
        library = cls(codegen, name)
        machine_code, library._unread, defined = code
        library.enable_object_caching()
        library._set_compiled_object(machine_code)
        CPUCodeLibrary._finalize_final_module(library)
        codegen._engine._defined_symbols.update(defined)
        return library

    def _get_module_for_linking(self) -> Any:
        if self._unread is not None:
            self._read, self._unread = llvm.parse_bitcode(self._unread), None
        return self._read if self._read is not None else super()._get_module_for_linking()


class InlinedLibrary(_Kernel):
    """The code library of a function that only other kernel functions call.

    It is linked into kernels, and never translated to machine code separately. It has no Numba environment (the reference to its
    Python objects).
    """

    @property
    def codegen(self) -> Any:
        """Returns the code generator, as Numba requires to set the environment."""
        return NoEnvironment

    def _optimize_final_module(self) -> None:
        for variable in self._environments():
            variable.linkage = "linkonce_odr"  # dropped if unused
        super()._optimize_final_module()
        if any(self._environments()):
            raise NotImplementedError(f"{self.name} uses Python objects at run time, which compiled kernels cannot")

    def _environments(self) -> list[Any]:
        return [variable for variable in self._final_module.global_variables if variable.name.startswith(_ENVIRONMENT)]

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                self.own_name = function.name
                function.linkage = "linkonce_odr"  # each caller has a copy, dropped if inlined
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        return self._final_module

    def get_pointer_to_function(self, name: str) -> int:
        """Returns 0, a null pointer: the library has no machine code."""
        return 0

    def serialize_using_object_code(self) -> tuple[str, str, Any]:
        """Returns the bitcode and attributes of the library, which Numba writes to the cache."""
        codes = {name: each if isinstance(each, bytes) else each.as_bitcode() for name, each in self.beneath.items()}
        self.beneath = codes
        return self.name, _PART, (self.own_name, self._final_module.as_bitcode(), codes, self.is_inlinable)

    @classmethod
    def restored(cls, codegen: Any, name: str, code: Any) -> Self:
        """Restores a library from its cached state, as returned by `serialize_using_object_code`."""
        library = cls(codegen, name)
        library.own_name, own, library.beneath, library.is_inlinable = code
        library._final_module = llvm.parse_bitcode(own)
        library._finalized = True
        return library


class NoEnvironment:
    @staticmethod
    def set_env(name: str, environment: Any) -> None:
        """Does nothing: the library has no environment."""


_LIBRARY_CLASSES: dict[str, type[_Kernel]] = {_PART: InlinedLibrary, _KERNEL: _Kernel}


def restore_compiled(context: Any, kept: Any) -> Any:
    """Restores a compiled function (CompileResult) from its cached state."""
    (name, kind, code), descriptor, environment, signature, objectmode, lifted, annotation, reload_init, environments = kept
    for function in reload_init:
        function()
    library = _LIBRARY_CLASSES[kind].restored(context.codegen(), name, code)
    for each in environments:
        library.codegen.set_env(each.env_name, each)
    return compile_result(
        typing_context=context.typing_context,
        target_context=context,
        entry_point=context.get_executable(library, descriptor, environment),
        type_annotation=annotation,
        signature=signature,
        objectmode=objectmode,
        lifted=lifted,
        fndesc=descriptor,
        library=library,
        environment=environment,
        reload_init=reload_init,
        referenced_envs=environments,
    )


@register_pass(mutates_CFG=False, analysis_only=True)
class ChooseLibrary(AnalysisPass):
    """A compiler pass that chooses a function's library class before the function is lowered."""

    _name = "choose_library"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Runs the pass. Returns True if it changed anything."""
        kind = InlinedLibrary if state.flags.no_cpython_wrapper else _Kernel
        state.library = kind(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.counts = state.flags.nrt
        state.library.enable_object_caching()
        return False
