"""What Numba finds out anew for each function, though the answer stays the same, is found out once: a third of the time that
kernels take to compile.

Nothing that is compiled comes out otherwise. To import this is enough.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
from numba.core import ir, types, utils
from numba.core.cpu import CPUContext
from numba.core.errors import TypingError
from numba.core.typing.context import Context

from renderer.without import without

__all__: list[str] = []

# No kernel of ours calls BLAS, or C by a parser of its headers. Half of what there is to load here.
_FOREIGN = ("scipy", "scipy.linalg", "cffi", "cffi.cparser")


def _asked_once(ask: Callable[[Any, Any], int]) -> Callable[[Any, Any], int]:
    """How large the values of a type are, or where they may begin. Numba writes out a module with a variable of the type, and has
    LLVM parse it: half a millisecond each time that an element of an array is read.
    """
    known: dict[Any, int] = {}

    def found(context: Any, kind: Any) -> int:
        if kind not in known:
            known[kind] = ask(context, kind)
        return known[kind]

    return found


def _where_new(refresh: Callable[[Any], None]) -> Callable[[Any], None]:
    """What Numba's own modules and the intrinsics declare: looked for where there is any more of it since the last time. Numba
    goes through fifty modules and as many lists several times a function.
    """
    seen: dict[int, tuple[tuple[int, int], list[list[Any]]]] = {}

    def look(context: Any) -> None:
        before, lists = seen.get(id(context), (None, []))
        if before != _count(lists):
            with without(*_FOREIGN):
                refresh(context)
            lists = _lists(context)
            seen[id(context)] = _count(lists), lists

    return look


def _count(lists: list[list[Any]]) -> tuple[int, int]:
    """How many modules there are, and how much has been declared."""
    return len(sys.modules), sum(map(len, lists))


def _lists(context: Any) -> list[list[Any]]:
    """Of what is declared to this context; to that for types too, which comes with it."""
    contexts = [context, context.typing_context] if isinstance(context, CPUContext) else [context]
    return [
        getattr(registry, name)
        for each in contexts
        for registry, known in each._registries.items()
        for name in known.registry_items
    ]


def _typed_once(ask: Callable[..., Any]) -> Callable[..., Any]:
    """What a function of Numba's makes of certain types. It is asked up to three times more for each operation that is written
    out, since there may be a shorter way for operands that are known.
    """
    known: dict[Any, tuple[Any, Any, TypingError | None]] = {}
    modules = 0

    def found(function: Any, context: Any, arguments: tuple[types.Type, ...], named: dict[str, types.Type]) -> Any:
        nonlocal modules
        if named:
            return ask(function, context, arguments, named)
        if modules != len(sys.modules):  # they may bring more that is known
            known.clear()
            modules = len(sys.modules)
        key = id(function), arguments
        if key not in known:
            signature = error = None
            try:
                signature = ask(function, context, arguments, named)
            except TypingError as reason:
                error = reason
            known[key] = function, signature, error  # the function too: while it is there, nothing else has its id
        _, signature, error = known[key]
        if error is not None:
            raise error.with_traceback(None)
        return signature

    return found


_PLAIN = frozenset((ir.Loc, ir.Scope, str, int, bool, float, type(None)))
_list_rest = ir.Inst._rec_list_vars


def _list_variables(instruction: Any, value: Any) -> list[Any]:
    """The variables in a part of an instruction: Numba asks each part what it is five times over."""
    found: list[Any] = []
    _gather(instruction, value, found)
    return found


def _gather(instruction: Any, value: Any, found: list[Any]) -> None:
    kind = type(value)
    if kind is ir.Var:
        found.append(value)
    elif kind is dict or kind is ir.Expr:
        for each in (value._kws if kind is ir.Expr else value).values():
            if type(each) not in _PLAIN:
                _gather(instruction, each, found)
    elif kind is list or kind is tuple:
        for each in value:
            _gather(instruction, each, found)
    elif kind not in _PLAIN:
        found.extend(_list_rest(instruction, value))


for _name in ("get_abi_sizeof", "get_abi_alignment"):
    setattr(CPUContext, _name, _asked_once(getattr(CPUContext, _name)))
for _context in (CPUContext, Context):
    setattr(_context, "refresh", _where_new(_context.refresh))  # noqa: B010
setattr(types.BaseFunction, "get_call_type", _typed_once(types.BaseFunction.get_call_type))  # noqa: B010
setattr(ir.Inst, "_rec_list_vars", _list_variables)  # noqa: B010
setattr(utils, "pysignature", functools.cache(utils.pysignature))  # noqa: B010 - what arguments a function takes
# Each function that is being compiled is told of each call of LLVM, to add up its time.
llvm.ffi.lib._lock._cblist.clear()
