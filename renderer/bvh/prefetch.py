"""Memory asked for before it is read."""

from __future__ import annotations

import numpy as np

from renderer.bvh.layout import NODE_SIZE, PACKET_SIZE
from renderer.bvh.simd import address, fetch, select
from renderer.jit import device

__all__ = ["ask_for"]

_NODE, _PACKET = np.uintp(NODE_SIZE), np.uintp(PACKET_SIZE)
_LINES = 5  # of the cache: a node has four, a packet five


@device
def ask_for(bvh, child, nearby):
    """Asks for what the child of a node leads to, a node or a packet, to be in the cache when a ray looks into it; not in a tree
    of `nearby` nodes or fewer, which is there anyway.
    """
    if len(bvh.node) > nearby:
        node = address(bvh.node, np.uintp(np.uint32(child)) * _NODE)
        packet = address(bvh.packet, np.uintp(~child >> 2) * _PACKET)
        there = select(child >= np.int32(0), node, packet)
        for line in range(_LINES):
            fetch(there + np.uintp(64 * line))
