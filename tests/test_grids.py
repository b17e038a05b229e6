"""Tests that the default run has the first and the last case of a grid, or those that the grid names as ordinary."""

from __future__ import annotations

from typing import Any

import pytest

from tests.grids import grid


def ordinary(mark: pytest.MarkDecorator) -> list[Any]:
    return [cell.values for cell in mark.args[1] if not cell.marks]


def test_first_and_last_case_are_ordinary() -> None:
    assert ordinary(grid("x", range(5))) == [(0,), (4,)]
    assert ordinary(grid(("x", "y"), [(1, "a"), (2, "b"), (3, "c")])) == [(1, "a"), (3, "c")]


def test_ordinary_cases_by_first_value_or_id() -> None:
    cells = [("box", 1), ("ball", 2), pytest.param("cube", 3, id="a cube")]
    assert ordinary(grid("name, n", cells, ordinary=("ball", "a cube"))) == [("ball", 2), ("cube", 3)]
    assert ordinary(grid("n", (7, 8, 9), ordinary=("b",), ids=("a", "b", "c"))) == [(8,)]


def test_marks_of_a_case_are_kept() -> None:
    mark = grid("n", [pytest.param(1, marks=pytest.mark.long), 2, 3])
    assert ordinary(mark) == [(3,)]


def test_unknown_ordinary_case_is_an_error() -> None:
    with pytest.raises(ValueError, match="no cell of this grid is 'cone'"):
        grid("name", ["box", "ball"], ordinary=("cone",))
