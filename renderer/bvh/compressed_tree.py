"""The arrays of a compressed 8-wide tree, which graphics cards traverse, one ray a thread.

After Ylitie, Karras & Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", HPG 2017.

    node  (N, 20) u32  a node's 80 bytes:
                         words 0-2    the origin of the boxes' grid, x y z, float32
                         word 3       the steps of the grid: for x, y and z the biased exponent of a power of two, a byte each;
                                      highest byte: the mask of the slots that contain inner nodes
                         words 4, 5   the first inner child; the first leaf
                         word 6       the mask of the slots that contain leaves
                         words 8-19   the boxes: lower x, y, z, then upper x, y, z, one byte a slot: steps from the origin
    leaf  (L, 12) f32  a leaf's 48 bytes, four numbers for each corner of a triangle:
                         a.x a.y a.z primitive   b.x b.y b.z kind   c.x c.y c.z keys
                         spheres: x y z primitive   radius 0 0 kind   0 0 0 keys
                         curves: a.x a.y a.z primitive   b.x b.y b.z kind   radius at a, at b, reach   keys
                         instances: 0 0 0 instance   0 0 0 kind   ...

`primitive`, `kind`, `keys` and `instance` are int32, stored bit for bit. `kind` is TRIANGLES, SPHERES, INSTANCE or CURVES of
renderer/bvh/layout.py, plus KEYED for primitives with motion keys: those are stored in consecutive rows of `leaf`, from the row
`keys` on. The children in a node's slots are consecutive in the order of the slots. Slots are assigned so that a ray along
the positive axes visits slot 0 first (bit k of a slot: the upper half along axis k). Node 0 is the world's root.

Boxes contain those of the tree from which this one is made (renderer/bvh/compress.py).
"""

from __future__ import annotations

from typing import Any, NamedTuple

__all__ = ["KEYED", "LEAF_NUMBERS", "NODE_WORDS", "STACK_DEPTH", "CompressedTree"]

NODE_WORDS = 20
LEAF_NUMBERS = 12
KEYED = 4  # added to the kind of a leaf whose primitive has motion keys
STACK_DEPTH = 64  # groups of children on the stack, of two words each: the levels of the world and of one instance, and two


class CompressedTree(NamedTuple):
    """A compressed tree; the module's docstring describes the arrays."""

    node: Any  # (N, NODE_WORDS) u32, its data aligned to 16 bytes
    leaf: Any  # (L, LEAF_NUMBERS) f32, likewise
