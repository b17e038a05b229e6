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


def test_what_was_made_for_an_equal_key_is_given_again():
    kept = ShotCache()
    first, was_made = recalled(kept, [1, np.arange(3)])
    assert was_made
    assert recalled(kept, [1, np.arange(3)]) == (first, False)
    second, was_made = recalled(kept, [1, np.arange(4)])
    assert was_made
    assert second is not first


def test_a_token_answers_for_its_key():
    kept, token, asked = ShotCache(), object(), []
    first, _ = recalled(kept, 1, token, asked)
    assert recalled(kept, 2, token, asked) == (first, False)  # the same token: the key is not compared
    assert len(asked) == 1
    assert recalled(kept, 1, object(), asked) == (first, False)  # another token with the same key
    assert recalled(kept, 2, None, asked)[1]


def test_what_a_moment_had_no_use_for_is_forgotten():
    kept = ShotCache()
    first, _ = recalled(kept, 1)
    kept.begin_frame()
    assert recalled(kept, 1) == (first, False)
    kept.begin_frame()
    kept.begin_frame()
    assert recalled(kept, 1)[1]


def test_room_keeps_what_is_made_of_the_same_things_while_its_end_grows_and_shrinks():
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


def test_what_was_said_of_other_things_is_not_known():
    kept, head = ShotCache(), object()
    assert not kept.is_unchanged("checked", (head, 1))
    assert kept.is_unchanged("checked", (head, 1))
    assert not kept.is_unchanged("checked", (head, 2))
    assert not kept.is_unchanged("checked", (object(), 2))
