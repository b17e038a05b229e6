"""Builds the binary tree on all threads: first its top, over clusters of primitives (clusters.py), then the subtrees below it.

The division into parts depends only on the primitives, so the tree does not depend on the number of threads.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.bvh.boxes import doubled_centroid, numbers_of
from renderer.bvh.clusters import JOB, TREELET, Clusters, gathered, single_cluster, split_clusters
from renderer.bvh.simd import load, maximum, splat, store
from renderer.bvh.split import STACK, new_bins, split
from renderer.jit import entry
from renderer.threads import Team, parts_of

__all__ = ["LEAST_PART", "MOST_PARTS", "BinaryTree", "build_binary_tree", "part_size"]

LEAST_PART = 1 << 15  # boxes: one megabyte, which fits a core's cache
MOST_PARTS = 64  # of one tree: more cost time without benefit
_NOTHING = np.float32(-np.inf)

F32 = npt.NDArray[np.float32]
Integers = npt.NDArray[Any]


def part_size(count: int) -> int:
    """Returns how many primitives each part of a tree over `count` primitives has; threads build the parts separately."""
    return max(LEAST_PART, -(-count // MOST_PARTS))


class BinaryTree(NamedTuple):
    """The arrays of a binary tree over N boxes; `split` describes them."""

    box: F32  # (2 N, 8)
    tree: npt.NDArray[np.int32]  # (2 N, 3)
    order: npt.NDArray[np.int32]  # (N,)


def build_binary_tree(box: F32, curves: int, triangles: int, solids: int, team: Team) -> BinaryTree:
    """Builds the binary tree over the boxes of all primitives.

    curves, triangles, solids: the first primitive number of a curve segment, of a sphere, and of an instance. team: the threads
    that build.
    """
    count, part = len(box), part_size(len(box))
    binary = BinaryTree(
        _sparse_array((2 * count, 8), np.float32), _sparse_array((2 * count, 3), np.int32), np.empty(count, np.int32)
    )

    def split_some(job: tuple[Clusters, Integers]) -> None:
        clusters, parts = job
        room = np.empty((parts[:, 2].max(), 8), np.float32)
        spread, stack = np.empty((STACK, 8), np.float32), np.empty((STACK, 4), np.int64)
        kinds = curves, triangles, solids
        split(box, clusters, parts, room, new_bins(), spread, stack, *kinds, binary.order, binary.box, binary.tree)

    jobs = [
        (clusters, some)
        for clusters, parts in _split_top(box, solids, part, binary, team)
        for some in _group_parts(parts, part // 2)
    ]
    jobs.sort(key=lambda job: -job[1][:, 2].sum())  # the largest first, so that the threads end together
    team.each(split_some, jobs)
    return binary


def _sparse_array(shape: tuple[int, int], item: type[np.generic]) -> npt.NDArray[Any]:
    """Allocates an array whose pages occupy memory only once written, since leaves of several primitives leave most rows unused.

    NumPy's own allocation would use huge pages, each resident as a whole.
    """
    size = np.dtype(item).itemsize
    return np.frombuffer(mmap.mmap(-1, shape[0] * shape[1] * size), item).reshape(shape)


def _split_top(box: F32, solids: int, part: int, binary: BinaryTree, team: Team) -> Iterator[tuple[Clusters, Integers]]:
    """Splits the top of the tree; yields groups of nodes that remain to be split, as (clusters, nodes).

    nodes: (J, JOB), each over some of these clusters.
    """
    count = len(box)
    waiting = [(np.array([0, 0, count, 1, 0]), np.arange(count, dtype=np.int32))]
    while waiting:
        node, source = waiting.pop()
        whole, spread = _bounds_of(box, source, part, team)
        if node[2] <= part:
            clusters = single_cluster(source, whole)
            yield clusters, np.append(node, (0, 1)).reshape(1, JOB)
            continue
        clusters = gathered(box, source, spread, solids, team)
        centroids = (clusters.box - np.roll(clusters.box, 4, axis=1)).max(axis=0)
        parts = split_clusters(
            clusters, np.append(node, (0, len(clusters.box))), centroids, min(TREELET, part), binary.box, binary.tree
        )
        large = parts[:, 2] > part if len(parts) > 1 else np.zeros(1, bool)  # if no plane divides it, it remains one part
        waiting += [(each[:5], _primitives_of_part(clusters, each)) for each in parts[large]]
        yield clusters, parts[~large]


def _primitives_of_part(clusters: Clusters, part: Integers) -> Integers:
    """Returns the numbers of the primitives in a part's clusters. part: (JOB,) row of the part, from `split_clusters`."""
    number = numbers_of(clusters.box[part[5] : part[6]])
    return np.concatenate([clusters.source[clusters.first[c] : clusters.first[c] + clusters.count[c]] for c in number])


def _group_parts(parts: Integers, size: int) -> Iterator[Integers]:
    """Divides consecutive parts into groups of about `size` primitives in total, and yields each group."""
    share = (np.cumsum(parts[:, 2]) - parts[:, 2]) // size
    return iter(np.split(parts, np.flatnonzero(np.diff(share)) + 1))


def _bounds_of(box: F32, source: Integers, part: int, team: Team) -> tuple[F32, F32]:
    """Returns the bounds of the boxes of the primitives `source`, and the bounds of these boxes' doubled centroids; (8,) each."""
    found = np.empty((-(-len(source) // part), 2, 8), np.float32)
    team.each(lambda job: _bound(box, source, *job[0], job[1]), zip(parts_of(0, len(source), part), found, strict=True))
    whole, spread = found.max(axis=0)
    return whole, spread


@entry
def _bound(box, source, first, end, found):
    """Writes the bounds of boxes source[first : end] to row 0 of `found`, and those of their doubled centroids to row 1."""
    whole, spread = splat(_NOTHING), splat(_NOTHING)
    for k in range(first, end):
        row = load(box, np.uintp(source[k]) * np.uintp(8))
        whole = maximum(row, whole)
        spread = maximum(doubled_centroid(row), spread)
    store(found, np.uintp(0), whole)
    store(found, np.uintp(8), spread)
