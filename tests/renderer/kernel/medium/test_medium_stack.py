"""Tests of the stack of nested media, packed into one word, against an unlimited list."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from renderer.arrays.rows import MOST_MEDIA
from renderer.jit import entry
from renderer.kernel.medium.medium_stack import beneath, entered, holds, left
from renderer.wide.values import u32

IN, OUT = 0, 1


@entry
def _go(steps, nest):
    for i in range(len(steps)):
        medium = np.uint32(steps[i, 1])
        if steps[i, 0] == 0:
            nest = entered(nest, medium)
        elif holds(nest, medium):
            nest = left(nest, medium)
    return nest


@entry
def _lie(media):
    nest = np.uint32(0)
    for i in range(len(media)):
        nest = beneath(nest, u32(i), u32(media[i]))
    return nest


def after(steps: list[tuple[int, int]], nest: int = 0) -> tuple[int, ...]:
    found = int(_go(np.array(steps, np.int64).reshape(-1, 2), np.uint32(nest)))
    return tuple(found // MOST_MEDIA**k % MOST_MEDIA for k in range(3))


@given(st.lists(st.tuples(st.sampled_from((IN, OUT)), st.integers(1, 3)), max_size=12))
def test_medium_stack_equals_a_list_up_to_depth_three(steps: list[tuple[int, int]]) -> None:
    stack: list[int] = []
    for way, medium in steps:
        if way == IN:
            stack = [medium, *stack][:3]
        elif medium in stack:
            stack.remove(medium)
    assert after(steps) == tuple([*stack, 0, 0, 0][:3])


def test_largest_medium_number_is_distinct() -> None:
    most = MOST_MEDIA - 1
    assert after([(IN, most), (IN, 1), (IN, most)]) == (most, 1, most)
    assert after([(IN, most), (IN, 1), (OUT, most)]) == (1, 0, 0)


def test_camera_media_are_listed_innermost_first() -> None:
    nest = int(_lie(np.array([5, 7, 9, 11])))
    assert nest == 5 + 7 * MOST_MEDIA + 9 * MOST_MEDIA**2
