"""How the functions of a kernel come together: nothing is optimised with each of its callers again, and only what Python calls
becomes machine code.

Numba links all that a function calls into it, then optimises the whole, and makes machine code of it: so what lies deep was
optimised and translated once for each function above it.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import AnalysisPass, register_pass

__all__ = ["ChooseLibrary", "stay_apart"]

_APART = ".apart"  # the name of a library whose function is never merged into its callers ends so, in files too
_ENVIRONMENT = "_ZN08NumbaEnv"  # the names of what a function knows of Python begin so


def stay_apart(library: Any) -> None:
    """Says that the function of the library in the making is never merged into its callers."""
    if isinstance(library, _Kernel):
        library._name += _APART


class _Kernel(JITCodeLibrary):
    """A function that Python calls: functions that stay apart are linked when its own code is optimised."""

    def finalize(self) -> None:
        """As Numba's, but for that order."""
        self._raise_if_finalized()
        linked = dict.fromkeys(self._linking_libraries)
        for library in linked:
            self._reload_init.update(library._reload_init)
        for library in (library for library in linked if not library.name.endswith(_APART)):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._optimize_final_module()
        for library in (library for library in linked if library.name.endswith(_APART)):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._final_module.verify()
        self._finalize_final_module()


class _Part(_Kernel):
    """A function that only others of ours call: it is there to be linked. In place of its machine code there are its environments
    alone, into which Numba writes.
    """

    def _finalize_final_module(self) -> None:
        whole = self._final_module
        names = [variable.name for variable in whole.global_variables if variable.name.startswith(_ENVIRONMENT)]
        text = "\n".join(
            [str(self._codegen._create_empty_module(self.name)), *(f'@"{n}" = common global i8* null' for n in names)]
        )
        self._final_module = llvm.parse_assembly(text)
        super()._finalize_final_module()
        self._final_module = whole


@register_pass(mutates_CFG=False, analysis_only=True)
class ChooseLibrary(AnalysisPass):
    """A step of the compiler, before a function is lowered into its library."""

    _name = "choose_library"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Whether anything was changed, as Numba asks of its passes."""
        kind = _Part if state.flags.no_cpython_wrapper else _Kernel
        state.library = kind(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return False
