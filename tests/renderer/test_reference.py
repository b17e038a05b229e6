"""Tests of NamedTuples passed by reference: read like the tuple itself, and typed by their fields."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import typeof

from renderer.jit import entry, never_inline, subroutine
from renderer.reference import Packed, Reference, by_reference


class Inner(NamedTuple):
    numbers: Any
    scale: Any


class Outer(NamedTuple):
    first: Any
    inner: Any
    absent: Any
    point: Any
    yes: Any


class Renamed(NamedTuple):
    other: Any
    inner: Any
    absent: Any
    point: Any
    yes: Any


@subroutine
def _sum_of(inner):
    never_inline()
    total = 0.0
    for i in range(inner.numbers.shape[0]):
        for k in range(inner.numbers.shape[1]):
            total += inner.numbers[i, k] * inner.scale
    return total + inner.numbers[1:].size


@subroutine
def _read(outer, out):
    never_inline()
    out[0] = len(outer.first) + outer.first[2]
    out[1] = _sum_of(outer.inner)
    out[2] = outer.point[1]
    out[3] = 1.0 if outer.yes else 0.0
    if outer.absent is not None:
        out[4] = outer.absent.nowhere  # would not compile


@entry
def read(outer, out):
    """Writes values of a NamedTuple that is passed by reference."""
    _read(by_reference(outer), out)


def made() -> Outer:
    inner = Inner(np.arange(6.0).reshape(2, 3), np.float64(0.5))
    return Outer(np.array([1, 2, 7], np.int32), inner, None, (3.0, 4.0), True)


def test_reference_fields_equal_the_tuples() -> None:
    out = np.zeros(5)
    read(made(), out)
    assert out.tolist() == [10.0, 7.5 + 3, 4.0, 1.0, 0.0]


def test_packed_tuples_are_read_like_tuples() -> None:
    outer, out = made(), np.zeros(5)
    packed = Packed(outer)
    read(packed, out)
    assert out.tolist() == [10.0, 7.5 + 3, 4.0, 1.0, 0.0]
    outer.first[2] = 9
    read(packed, out)
    assert out[0] == 12.0


def test_what_no_kernel_reads_is_not_packed() -> None:
    with pytest.raises(TypeError, match="packed tuples cannot contain"):
        Packed(made()._replace(point=1j))


def test_reference_type_is_named_by_its_fields() -> None:
    outer = typeof(made())
    assert Reference(outer) == Reference(typeof(made()))
    others = made()._replace(point=(3.0, 4)), Renamed(*made()), made()._replace(inner=made().inner._replace(scale=1))
    assert len({Reference(outer), *(Reference(typeof(other)) for other in others)}) == 4
    assert isinstance(Reference(outer).field("inner"), Reference)
    assert Reference(outer).field("nowhere") is None
    assert len(Reference(outer).name) < 40
