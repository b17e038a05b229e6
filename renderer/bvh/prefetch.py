"""Prefetches BVH nodes and packets into the processor's cache."""

from __future__ import annotations

import numpy as np

from renderer.bvh.layout import NODE_SIZE, PACKET_SIZE
from renderer.bvh.simd import address, fetch, select
from renderer.jit import device

__all__ = ["prefetch_child"]

_NODE, _PACKET = np.uintp(NODE_SIZE), np.uintp(PACKET_SIZE)
_LINES = 5  # cache lines: a node has four, a packet five


@device
def prefetch_child(bvh, child, nearby):
    """Prefetches the node or packet of a child reference, except in trees of at most `nearby` nodes, which stay in the cache."""
    if len(bvh.node) > nearby:
        node = address(bvh.node, np.uintp(np.uint32(child)) * _NODE)
        packet = address(bvh.packet, np.uintp(~child >> 2) * _PACKET)
        there = select(child >= np.int32(0), node, packet)
        for line in range(_LINES):
            fetch(there + np.uintp(64 * line))
