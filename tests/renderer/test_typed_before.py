"""Operations are asked for once for the same types, everything else each time."""

from __future__ import annotations

import operator
from typing import Any

import pytest
from numba import njit, types

from renderer import typed_before


class _Context:
    """Answers with whatever it was given, and counts how often it is asked."""

    def __init__(self, answer: Any) -> None:
        self.answer = answer
        self.asked = 0
        self.tm = "what else a context has"

    def resolve_function_type(self, *_: Any) -> Any:
        self.asked += 1
        return self.answer


@pytest.mark.parametrize(
    ("function", "named", "answer", "times"),
    [
        (operator.add, {}, "a signature", 1),
        (operator.add, {}, None, 2),  # what means nothing yet may mean something later
        (operator.add, {"b": types.int64}, "a signature", 2),
        (types.Dispatcher(njit(lambda x: x)), {}, "a signature", 2),  # which compiles, and remembers that itself
    ],
)
def test_what_is_remembered(
    function: Any, named: dict[str, Any], answer: str | None, times: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(typed_before, "_known", {})
    context = _Context(answer)
    remembering = typed_before._Remembering(context)
    assert remembering.tm == context.tm
    for _ in range(2):
        assert remembering.resolve_function_type(function, (types.float32, types.float32), named) == answer
    assert context.asked == times
    remembering.resolve_function_type(function, (types.float32, types.float64), named)
    assert context.asked == times + 1
