"""A step of Numba's compiler: what an operation makes of certain types is asked for once.

Numba puts each operation to some ten templates in turn, dates before numbers, until one knows the types, and types a function at
least twice, until nothing changes any more: 0.15 ms for each addition, a tenth of the time that kernels take to compile.
"""

from __future__ import annotations

from typing import Any

from numba.core import types
from numba.core.compiler_machinery import register_pass
from numba.core.typed_passes import BaseTypeInference

__all__ = ["TypeOnce"]

_known: dict[tuple[Any, tuple[types.Type, ...]], Any] = {}


class _Remembering:
    """A typing context that remembers what it has found out of operators, intrinsics and Numba's own functions.

    Not of functions that are compiled when they are first asked for, which Numba remembers itself.
    """

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function: Any, arguments: tuple[types.Type, ...], named: dict[str, types.Type]) -> Any:
        """The call's signature, or None."""
        if named or (isinstance(function, types.Type) and not isinstance(function, types.Function)):
            return self._context.resolve_function_type(function, arguments, named)
        found = _known.get((function, arguments))
        if found is None:
            found = self._context.resolve_function_type(function, arguments, named)
            if found is not None:
                _known[function, arguments] = found
        return found


@register_pass(mutates_CFG=True, analysis_only=False)
class TypeOnce(BaseTypeInference):
    """Numba's type inference, with that memory."""

    _name = "type_once"

    def run_pass(self, state: Any) -> bool:
        """Whether anything was changed, as Numba asks of its passes."""
        context = state.typingctx
        state.typingctx = _Remembering(context)
        try:
            return bool(super().run_pass(state))
        finally:
            state.typingctx = context
