"""Tests that an inlined template computes what it computes as a Python function."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from renderer.jit import entry, template


@template
def _collatz_steps(number: int, limit: int = 100) -> int:
    steps = 0
    while number != 1:
        if steps == limit:
            return -1
        number = number // 2 if number % 2 == 0 else 3 * number + 1
        steps += 1
    return steps


@template
def _larger(function: Callable[..., int], a: int, b: int) -> tuple[int, int]:
    steps, other = function(a), function(b, limit=7)
    if steps >= other:
        return a, steps
    return b, other


@template
def _missing_or_steps(number: Any) -> int:
    # Comparing None with 0 does not compile, so successful compilation proves that this branch is pruned.
    if number is not None and number > 0:
        return _collatz_steps(number)
    return -2


@entry
def _all(number, other, missing):
    # `steps` and `limit` are names of the template's variables too.
    steps, limit = 1000, 3
    total = 0
    for step in range(limit):
        first = _larger(_collatz_steps, number + step, other)
        total += steps * first[0] + first[1]
    return total, steps, limit, _collatz_steps(number), _missing_or_steps(missing), _missing_or_steps(number)


def _expected(number: int, other: int) -> tuple[int, ...]:
    steps = _collatz_steps.py_func
    firsts = [_larger.py_func(steps, number + step, other) for step in range(3)]
    return sum(1000 * a + b for a, b in firsts), 1000, 3, steps(number), -2, steps(number)


@pytest.mark.parametrize(("number", "other"), [(6, 7), (27, 1), (1, 5)])
def test_templates_compute_what_their_python_functions_compute(number: int, other: int) -> None:
    assert _all(number, other, None) == _expected(number, other)
