"""Merging of face corners into vertices. All arrays are allocated by the caller."""

from __future__ import annotations

from renderer.jit import builder

__all__ = ["join_at_points"]

_MOST_KINDS = 64  # limit of comparisons per corner; beyond it, equal corners at one point may stay separate


@builder
def join_at_points(point, words, last, before, first, kind):
    """Numbers the distinct (point, words) pairs of face corners and records the first corner of each; returns their number.

    point: (C,), numbers below P. words: (C, W) u32, compared bitwise. last: (P,) i32, all -1. before, first, kind: (C,) i32;
    `kind` receives each corner's number and `first` the first corner of each number. A corner is compared with at most
    _MOST_KINDS others at its point.
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
