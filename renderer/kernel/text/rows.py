"""Parses text rows that differ only in their numbers, such as the vertex rows of text formats.

The caller allocates all arrays.
"""

from __future__ import annotations

from renderer.jit import builder, device
from renderer.kernel.text.numbers import read_number

__all__ = ["read_rows"]

_BLANK = 32


@builder
def read_rows(text, begin, end, words, starts, table):
    """Fills table (N, W) f64 with the numbers of text[begin:end], whose rows are words[0] number words[1] number ... words[W].

    text: (B,) u8. words: concatenated; the k-th is words[starts[k]:starts[k + 1]]. Rows may be separated by blanks and line ends.
    Returns the number of rows, or -1 if a row has another form or there are more than N.
    """
    width = table.shape[1]
    row, i = 0, begin
    while True:
        while i < end and text[i] <= _BLANK:
            i += 1
        if i >= end:
            return row
        if row >= len(table):
            return -1
        for k in range(width):
            i = _past(text, i, end, words, starts[k], starts[k + 1])
            if i < 0:
                return -1
            value, after = read_number(text, i)
            if after == i:
                return -1
            table[row, k] = value
            i = after
        i = _past(text, i, end, words, starts[width], starts[width + 1])
        if i < 0:
            return -1
        row += 1


@device
def _past(text, i, end, words, first, last):
    """Returns the index after the word words[first:last] if the text at index i begins with that word; else -1."""
    if i + (last - first) > end:
        return -1
    for k in range(last - first):
        if text[i + k] != words[first + k]:
            return -1
    return i + (last - first)
