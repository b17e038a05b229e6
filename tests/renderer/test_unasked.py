"""What is left until somebody asks is there for who asks, and faults are told as Numba tells them."""

from __future__ import annotations

import warnings
from typing import Any

import pytest
from numba import njit, types
from numba.core import errors
from numba.core.compiler import run_frontend
from numba.core.postproc import PostProcessor

from renderer import unasked


def _branches(values: Any, start: int) -> Any:
    total = start
    for value in values:
        if value > 0:
            total += value
    return total


def test_where_variables_live_is_found_when_asked() -> None:
    left, worked_out = run_frontend(_branches), run_frontend(_branches)
    PostProcessor(left).run()
    unasked._process(PostProcessor(worked_out))
    assert left.blocks.keys() == worked_out.blocks.keys()
    assert left.variable_lifetime.livemap == worked_out.variable_lifetime.livemap
    assert left.variable_lifetime.deadmaps == worked_out.variable_lifetime.deadmaps


def _adds(a: Any, b: Any) -> Any:
    return a + b


def test_faults_name_their_place() -> None:
    with pytest.raises(errors.TypingError) as fault:
        njit(_adds).compile((types.float32, types.none))
    said = str(fault.value)
    assert "operator.add" in said or "add" in said
    assert __file__ in said
    with pytest.raises(errors.TypingError, match="while x") as context, unasked._Context("while {what}", what="x"):
        raise errors.TypingError("wrong")
    assert "wrong" in str(context.value)


def test_warnings_are_filed_by_the_line_that_they_come_from() -> None:
    fixer = errors.WarningsFixer(errors.NumbaWarning)

    class Line:
        def __init__(self, line: int) -> None:
            self.loc = type("Place", (), {"filename": "kernel.py", "line": line})

        def __call__(self, typeinfer: Any) -> None:
            if self.loc.line != 2:
                warnings.warn(errors.NumbaWarning(f"line {self.loc.line}"), stacklevel=1)

    typeinfer = type("Typeinfer", (), {"warnings": fixer})
    network = type("Network", (), {"constraints": [Line(1), Line(2), Line(3)]})
    assert unasked._propagate(network, typeinfer) == []
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        fixer.flush()
    assert sorted((each.filename, each.lineno, str(each.message)) for each in told) == [
        ("kernel.py", 1, "line 1"),
        ("kernel.py", 3, "line 3"),
    ]
