"""What Numba works out and notes of each function though hardly anybody asks for it, is left until somebody does: a tenth of the
time that kernels take to compile.

Nothing that is compiled comes out otherwise, nor what is said of a function that does not compile. To import this is enough.
"""

from __future__ import annotations

import sys
import warnings
from typing import Any, Self

from numba.core import errors as numba_errors
from numba.core import transforms
from numba.core.errors import ForceLiteralArg, NumbaError, TypingError
from numba.core.postproc import PostProcessor, VariableLifetime
from numba.core.typeinfer import ConstraintNetwork
from numba.core.utils import chain_exception

__all__: list[str] = []

errors: Any = numba_errors  # of which much is not declared
_NUMBA = errors._numba_path
_process = PostProcessor.run


def _tidy(processor: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
    """In place of PostProcessor.run: which variables live where is found for who asks. Only generators, and functions that count
    references, do; this is run four times for each function.
    """
    function = processor.func_ir
    if emit_dels or function.is_generator:
        _process(processor, emit_dels, extend_lifetimes)
        return
    function.blocks = transforms.canonicalize_cfg(function.blocks)
    function.variable_lifetime = VariableLifetime(function.blocks)
    function.generator_info = None


class _Context:
    """In place of `new_error_context`, which is around each instruction several times: adds where it was to what Numba raises."""

    __slots__ = ("_arguments", "_named", "_said")

    def __init__(self, fmt_: str, *args: Any, **kwargs: Any) -> None:
        self._said, self._arguments, self._named = fmt_, args, kwargs
        place = kwargs.get("loc")
        if place is not None and not place.filename.startswith(_NUMBA):
            errors.loc_info.update(kwargs)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: Any) -> None:
        if isinstance(error, NumbaError):
            error.add_context(errors._format_msg(self._said, self._arguments, self._named))


def _propagate(network: Any, typeinfer: Any) -> list[Exception]:
    """In place of ConstraintNetwork.propagate, which catches the warnings of each constraint by itself: those of all are caught,
    and filed by the constraint that each came with.
    """
    found: list[Exception] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", typeinfer.warnings._category)
        for constraint in network.constraints:
            try:
                constraint(typeinfer)
            except ForceLiteralArg as error:
                found.append(error)
            except TypingError as error:
                found.append(chain_exception(TypingError(str(error), loc=constraint.loc, highlighting=False), error))
            if caught:
                _file(typeinfer.warnings, caught, constraint.loc)
                caught.clear()
    return found


def _file(fixer: Any, caught: list[warnings.WarningMessage], place: Any) -> None:
    with fixer.catch_warnings(filename=place.filename, lineno=place.line):
        for warning in caught:
            warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)


setattr(PostProcessor, "run", _tidy)  # noqa: B010
setattr(ConstraintNetwork, "propagate", _propagate)  # noqa: B010
_known = errors.new_error_context
_modules: list[Any] = [module for name, module in sys.modules.items() if name.startswith("numba.")]
for _module in _modules:
    if getattr(_module, "new_error_context", None) is _known:
        _module.new_error_context = _Context
