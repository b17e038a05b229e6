"""Lists of row numbers of the path pool: the paths that each stage has to process.

A list is read eight numbers at a time, with its last number repeated to a multiple of eight: processing a row twice has the same
result as processing it once.
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel.backends.cpu.rows import ROWS
from renderer.wide.rows import load_ints

__all__ = [
    "ACTIVE",
    "CONDUCTOR",
    "DIFFUSE",
    "DONE",
    "ENDED",
    "LISTS",
    "LIST_SIZE",
    "LIT",
    "MEDIUM_VERTICES",
    "METALLIC_ROUGHNESS",
    "MISSED",
    "NODES",
    "OTHERS",
    "PACKETS",
    "PASSED",
    "RARE",
    "RARE_SPECULAR",
    "SCATTERING",
    "SPECULAR",
    "SPHERES",
    "SUBSURFACE_VERTICES",
    "TRIANGLES",
    "WAITING",
    "append",
    "clear",
    "eight_rows",
    "length",
    "pad",
    "put",
    "row",
    "truncate",
]

# Vertices to be scattered are listed by their scattering model. RARE: materials with many properties. RARE_SPECULAR vertices are
# also on that list; light sampling finds nothing for them.
DIFFUSE, SPECULAR, METALLIC_ROUGHNESS, CONDUCTOR, RARE, RARE_SPECULAR = range(6)
SCATTERING = RARE_SPECULAR
# These are typed numbers, since Numba would compile `length` and the other functions again for each literal.
ACTIVE, TRIANGLES, SPHERES, MISSED, LIT, PASSED, DONE = (np.uintp(which) for which in range(SCATTERING + 1, SCATTERING + 8))
# Rays in traversal, by the next object to visit: a node, a packet of triangles, or another leaf.
NODES, PACKETS, OTHERS, ENDED, WAITING = (np.uintp(which) for which in range(SCATTERING + 8, SCATTERING + 13))
# In scenes with media: vertices in a medium, to be scattered too, and vertices where a subsurface walk may begin.
MEDIUM_VERTICES, SUBSURFACE_VERTICES = (np.uintp(which) for which in range(SCATTERING + 13, SCATTERING + 15))
LISTS = SCATTERING + 15
LIST_SIZE = ROWS + 8  # the length, the numbers, and space for repeating the last one
_SIZE = np.uintp(LIST_SIZE)
_ONE = np.uintp(1)


@device
def clear(lists, which):
    """Empties list `which`."""
    lists[np.uintp(which) * _SIZE] = np.uint32(0)


@device
def length(lists, which):
    """Returns the length of list `which`."""
    return np.int64(lists[np.uintp(which) * _SIZE])


@device
def row(lists, which, k):
    """Returns the row number at index `k` of list `which`."""
    return np.uintp(lists[np.uintp(which) * _SIZE + _ONE + np.uintp(k)])


@device
def append(lists, which, number):
    """Appends a row number to list `which`."""
    base = np.uintp(which) * _SIZE
    count = np.uintp(lists[base]) + _ONE
    lists[base + count] = np.uint32(number)
    lists[base] = np.uint32(count)


@device
def put(lists, which, count, number):
    """Writes a row number at index `count` of list `which`, without changing its length."""
    lists[np.uintp(which) * _SIZE + _ONE + count] = np.uint32(number)


@device
def truncate(lists, which, count):
    """Sets the length of list `which` to `count`."""
    lists[np.uintp(which) * _SIZE] = np.uint32(count)


@device
def pad(lists, which):
    """Appends copies of a list's last number beyond its end, for `eight_rows` to read; returns the list's length, unchanged."""
    base = np.uintp(which) * _SIZE
    count = np.uintp(lists[base])
    if count > np.uintp(0):
        last = lists[base + count]
        for k in range(1, 8):
            lists[base + count + np.uintp(k)] = last
    return np.int64(count)


@device
def eight_rows(lists, which, k):
    """Returns the eight row numbers from index `k` on of list `which`, u32x8."""
    return load_ints(lists, np.uintp(which) * _SIZE + _ONE + np.uintp(k))
