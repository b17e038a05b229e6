"""Corners of faces that are one vertex. All arrays are the caller's."""

from __future__ import annotations

from renderer.jit import builder

__all__ = ["join_at_points"]

_MOST_KINDS = 64  # that a corner is compared with: where more meet in one point, some that agree stay apart


@builder
def join_at_points(point, words, last, before, first, kind):
    """Numbers corners by their points and by the words that they have there, and says of each number its first corner: how many
    there are.

    point: (C,), numbers below P. words: (C, W) u32. last: (P,) i32, all -1. before, first, kind: (C,) i32.
    """
    count = 0
    for i in range(len(point)):
        at = last[point[i]]
        tried = 0
        while at >= 0:
            j = first[at]
            agree = True
            for w in range(words.shape[1]):
                agree = agree and words[i, w] == words[j, w]
            if agree:
                break
            tried += 1
            at = before[at] if tried < _MOST_KINDS else -1
        if at < 0:
            at = count
            first[at] = i
            before[at] = last[point[i]]
            last[point[i]] = at
            count += 1
        kind[i] = at
    return count
