"""Tests that kernel code that uses an argument that is None is not compiled."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from renderer.jit import device, entry


class Parts(NamedTuple):
    table: Any
    more: Any


class Whole(NamedTuple):
    parts: Parts
    otherwise: float


@device
def _first(whole):
    # Indexing None does not compile, so successful compilation proves that this branch is pruned.
    if whole.parts.table is not None:
        return whole.parts.table[0]
    return whole.otherwise


@entry
def _read(whole):
    if whole.parts.more is None:
        return _first(whole)
    return whole.parts.more[0]


@entry
def _both(whole, number):
    if whole.parts.table is not None and number > 0:
        return whole.parts.table[number]
    return whole.otherwise


@pytest.mark.long
def test_branches_on_none_fields_are_pruned() -> None:
    table = np.array([1.0, 5.0])
    assert _read(Whole(Parts(None, None), 3.0)) == 3
    assert _read(Whole(Parts(table, None), 3.0)) == 1
    assert _read(Whole(Parts(table, np.array([2.0])), 3.0)) == 2
    assert _read(Whole(Parts(None, np.array([2.0])), 3.0)) == 2


def test_pruned_condition_may_have_further_terms() -> None:
    table = np.array([1.0, 5.0])
    assert _both(Whole(Parts(None, None), 3.0), 1) == 3
    assert _both(Whole(Parts(table, None), 3.0), 1) == 5
    assert _both(Whole(Parts(table, None), 3.0), 0) == 3
