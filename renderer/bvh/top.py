"""The top of the binary tree, by all threads at once: large nodes are split part by part, small ones are left to split.py.

Boxes and counts are the same in whichever order they are added up, and how boxes are exchanged follows from how a node is
cut into parts, not from who does which: every number of threads builds the same tree.
"""

from __future__ import annotations

import mmap
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.boxes import bound, clear, exchange
from renderer.bvh.split import (
    BINS,
    SAH_DEPTH,
    STACK,
    bound_sides,
    cheapest_plane,
    fill_bins,
    lay_grid,
    new_bins,
    partition,
    split,
)
from renderer.jit import entry
from renderer.threads import Team, parts_of

__all__ = ["LEAST_PART", "MOST_PARTS", "Binary", "part_size", "split_all"]

LEAST_PART = 1 << 15  # boxes: a megabyte of them, which a core's cache holds
MOST_PARTS = 64  # of one tree: more would only cost

F32 = npt.NDArray[np.float32]


def part_size(count: int) -> int:
    """Into parts of how many primitives a tree over so many is cut."""
    return max(LEAST_PART, -(-count // MOST_PARTS))


class Binary(NamedTuple):
    """The binary tree: see `split`."""

    box: F32  # (2 N, 8)
    tree: npt.NDArray[np.int32]  # (2 N, 3)
    order: npt.NDArray[np.int32]  # (N,)


class _Node(NamedTuple):
    """A node to be split, as `split` takes it."""

    number: int
    first: int
    end: int
    rows: int
    depth: int
    spread: F32  # (8,): the box of its doubled centroids


def split_all(box: F32, triangles: int, solids: int, team: Team) -> Binary:
    """The binary tree over all boxes, which it reorders."""
    count, part = len(box), part_size(len(box))
    tree_box, tree = _sparse((2 * count, 8), np.float32), _sparse((2 * count, 3), np.int32)
    order = np.empty(count, np.int32)
    waiting = [_Node(0, 0, count, 1, 0, _bounded(box, 0, count, part, tree_box[0], team))]
    small = []
    while waiting:
        node = waiting.pop()
        if node.end - node.first <= part:
            small.append(node)
            continue
        tree[node.number] = node.rows, node.first, node.end - node.first
        waiting += _halves(box, node, part, solids, tree_box, team)
    small.sort(key=lambda node: node.first - node.end)  # the largest first, so that the threads end together

    def split_small(node: _Node) -> None:
        spread, stack = np.empty((STACK, 8), np.float32), np.empty((STACK, 4), np.int64)
        spread[0] = node.spread
        split(box, order, tuple(node[:5]), new_bins(), spread, stack, triangles, solids, tree_box, tree)

    team.each(split_small, small)
    return Binary(tree_box, tree, order)


def _sparse(shape: tuple[int, int], item: type[np.generic]) -> npt.NDArray[Any]:
    """Room of which only what is written to takes memory: leaves of several primitives leave most of their rows unused.

    NumPy's own would be in huge pages, each of them there as a whole.
    """
    size = np.dtype(item).itemsize
    return np.frombuffer(mmap.mmap(-1, shape[0] * shape[1] * size), item).reshape(shape)


def _halves(box: F32, node: _Node, part: int, solids: int, tree_box: F32, team: Team) -> tuple[_Node, _Node]:
    """Splits one node part by part: its children, whose boxes are written."""
    spread = np.empty((2, 8), np.float32)
    middle = _divided(box, node, part, solids, tree_box, spread, team) if node.depth < SAH_DEPTH else None
    if middle is None:
        middle = (node.first + node.end) // 2
        spread[0] = _bounded(box, node.first, middle, part, tree_box[node.rows], team)
        spread[1] = _bounded(box, middle, node.end, part, tree_box[node.rows + 1], team)
    after = node.rows + 2 * (middle - node.first)
    return (
        _Node(node.rows, node.first, middle, node.rows + 2, node.depth + 1, spread[0]),
        _Node(node.rows + 1, middle, node.end, after, node.depth + 1, spread[1]),
    )


def _divided(box: F32, node: _Node, part: int, solids: int, tree_box: F32, spread: F32, team: Team) -> int | None:
    """Sorts a node's boxes to both sides of the cheapest plane: where the right side begins; None where no plane divides them.

    Writes the children's boxes, and those of their doubled centroids into `spread`.
    """
    parts = parts_of(node.first, node.end, part)
    several = [new_bins() for _ in parts]
    team.each(lambda job: _fill(job[1], box, *job[0], node.spread.reshape(1, 8), solids), zip(parts, several, strict=True))
    box_of_bin, count = (np.stack([getattr(bins, name) for bins in several]) for name in ("box", "count"))
    bins = several[0]._replace(box=box_of_bin.max(axis=0), count=count.sum(axis=0))
    axis, bin = _choose(bins, tree_box, node.rows)
    if axis < 0:
        return None
    sides = np.empty((len(parts), 2, 8), np.float32)
    found = team.each(lambda job: _partition(box, *job[0], bins.grid, axis, bin, job[1]), zip(parts, sides, strict=True))
    sides.max(axis=0, out=spread)
    middle = node.first + sum(at - first for at, (first, _) in zip(found, parts, strict=True))
    team.each(lambda move: _exchange(box, *move), _moves(parts, found, middle))
    return middle


def _moves(parts: list[tuple[int, int]], found: list[int], middle: int) -> list[tuple[int, int, int]]:
    """What is still to be exchanged when each part is sorted by itself: (from, with, how many)."""
    wrong_left = [(at, min(end, middle)) for at, (_, end) in zip(found, parts, strict=True) if at < min(end, middle)]
    wrong_right = [(max(first, middle), at) for at, (first, _) in zip(found, parts, strict=True) if max(first, middle) < at]
    moves = []
    while wrong_left:
        (i, i_end), (j, j_end) = wrong_left.pop(), wrong_right.pop()
        count = min(i_end - i, j_end - j)
        moves.append((i, j, count))
        if i + count < i_end:
            wrong_left.append((i + count, i_end))
        if j + count < j_end:
            wrong_right.append((j + count, j_end))
    return moves


def _bounded(box: F32, first: int, end: int, part: int, whole: F32, team: Team) -> F32:
    """Writes the box of boxes first ... end - 1 into `whole` (8,): the box of their doubled centroids."""
    found = np.empty((-(-(end - first) // part), 2, 8), np.float32)
    team.each(lambda job: _bound(box, *job[0], job[1]), zip(parts_of(first, end, part), found, strict=True))
    whole[:], spread = found.max(axis=0)
    return spread


@entry
def _bound(box, first, end, found):
    """Rows 0 and 1 of `found`: the box of boxes first ... end - 1, and that of their doubled centroids."""
    bound(box, first, end, found, 0, found, 1)


@entry
def _fill(bins, box, first, end, spread, solids):
    """Puts boxes first ... end - 1 into bins over the doubled centroids' box."""
    lay_grid(bins.grid, spread, 0, BINS)
    fill_bins(bins, box, first, end, solids)


@entry
def _choose(bins, tree_box, rows):
    """(axis, bin) of the cheapest plane, axis -1 for none; writes the boxes of its sides."""
    plane = cheapest_plane(bins, BINS)
    if plane.axis >= 0:
        bound_sides(bins, plane.axis, plane.bin, BINS, tree_box, rows)
    return plane.axis, plane.bin


@entry
def _partition(box, first, end, grid, axis, bin, spread):
    """See `partition`."""
    clear(spread, 0)
    clear(spread, 1)
    return partition(box, first, end, grid, axis, bin, spread, 0, 1)


@entry
def _exchange(box, i, j, count):
    """Boxes i ... i + count - 1 change places with those from j on."""
    for k in range(count):
        exchange(box, i + k, j + k)
