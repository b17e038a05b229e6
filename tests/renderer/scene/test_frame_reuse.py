"""Tests of the cache of values between frames: an equal key returns the stored value, another key recomputes it.

Entries that a frame does not use are dropped.
"""

import numpy as np

from renderer.scene.frame_reuse import ShotCache


def recalled(kept, key, token=None, asked=None):
    made = []
    found = kept.get_or_make(
        "slot", lambda: (asked.append(1) if asked is not None else None, key)[1], lambda: made.append(1) or object(), token
    )
    return found, bool(made)


def test_equal_key_returns_the_cached_value():
    kept = ShotCache()
    first, was_made = recalled(kept, [1, np.arange(3)])
    assert was_made
    assert recalled(kept, [1, np.arange(3)]) == (first, False)
    second, was_made = recalled(kept, [1, np.arange(4)])
    assert was_made
    assert second is not first


def test_equal_token_skips_the_key_comparison():
    kept, token, asked = ShotCache(), object(), []
    first, _ = recalled(kept, 1, token, asked)
    assert recalled(kept, 2, token, asked) == (first, False)  # the same token: the key is not compared
    assert len(asked) == 1
    assert recalled(kept, 1, object(), asked) == (first, False)  # another token with the same key
    assert recalled(kept, 2, None, asked)[1]


def test_unused_entries_are_dropped():
    kept = ShotCache()
    first, _ = recalled(kept, 1)
    kept.begin_frame()
    assert recalled(kept, 1) == (first, False)
    kept.begin_frame()
    kept.begin_frame()
    assert recalled(kept, 1)[1]


def test_reused_array_keeps_its_first_rows():
    kept, head = ShotCache(), object()
    array, is_there = kept.array_for("a", 800, (2,), np.float32, (head, 5))
    assert not is_there
    assert not array.any()
    array[:] = 1
    for length in (700, 890, 800):
        array, is_there = kept.array_for("a", length, (2,), np.float32, (head, 5))
        assert is_there
        assert array.shape == (length, 2)
        assert (array[:700] == 1).all()
    for length, heads in ((2000, (head, 5)), (2000, (head, 6)), (2000, (object(), 6)), (2000, ())):
        array, is_there = kept.array_for("a", length, (2,), np.float32, heads)
        assert not is_there
        assert not array.any()
        array[:] = 1


def test_changed_heads_are_detected():
    kept, head = ShotCache(), object()
    assert not kept.is_unchanged("checked", (head, 1))
    assert kept.is_unchanged("checked", (head, 1))
    assert not kept.is_unchanged("checked", (head, 2))
    assert not kept.is_unchanged("checked", (object(), 2))
