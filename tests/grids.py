"""Parametrized tests with many cases (grids), of which a few cases run by default and the others are marked `long`."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import pytest
from _pytest.mark.structures import ParameterSet

__all__ = ["grid", "leave_out_long"]

_is_ordinary = False


def leave_out_long() -> None:
    """Makes all later calls of `grid` omit cases marked `long`, which is faster than deselecting their tests."""
    global _is_ordinary
    _is_ordinary = True


def grid(
    names: str | tuple[str, ...], values: Iterable[Any], ordinary: Collection[Any] | None = None, **options: Any
) -> pytest.MarkDecorator:
    """Returns `pytest.mark.parametrize`, with all but a few cases marked `long`.

    ordinary: the cases that are not, by their first value or id; None: the first and the last case. Raises ValueError if one of
    these names no case, so that a renamed case does not silently leave the default run.
    """
    several = (not isinstance(names, str) and len(names) > 1) or (isinstance(names, str) and "," in names)
    cells = [value if isinstance(value, ParameterSet) else pytest.param(*(value if several else (value,))) for value in values]
    ids = options.pop("ids", None)
    if ids is not None:
        told = [ids(cell.values[0]) for cell in cells] if callable(ids) else list(ids)
        cells = [cell._replace(id=cell.id or (None if id is None else str(id))) for cell, id in zip(cells, told, strict=True)]
    kept = [0, len(cells) - 1] if ordinary is None else []
    for one in ordinary or ():
        found = [i for i, cell in enumerate(cells) if _is(cell.id, one) or _is(cell.values[0], one)]
        if not found:
            raise ValueError(f"no cell of this grid is {one!r}")
        kept += found
    if _is_ordinary:
        cells, kept = [cell for i, cell in enumerate(cells) if i in kept], list(range(len(cells)))
    listed = [cell if i in kept else cell._replace(marks=[*cell.marks, pytest.mark.long]) for i, cell in enumerate(cells)]
    return pytest.mark.parametrize(names, listed, **options)


def _is(value: Any, one: Any) -> bool:
    return value is one or (type(value) is type(one) and bool(value == one))
