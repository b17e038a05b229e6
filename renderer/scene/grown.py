"""The tree over a scene's geometry: of one piece where nothing moves, else of parts that are built by themselves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.bvh.build import build, tree_of
from renderer.bvh.instances import Instances
from renderer.bvh.keyed import keyed_tree
from renderer.bvh.layout import NODE_ROWS, PACKET_ROWS, WIDTH, Bvh
from renderer.bvh.parts import Tree, lay
from renderer.scene.description import F32
from renderer.scene.geometry import Geometry, Placement
from renderer.scene.readable import read_only
from renderer.threads import Team

__all__ = ["grow"]

Array = npt.NDArray[Any]

_NO_NODES = np.zeros((0, NODE_ROWS, WIDTH), np.float32)
_NO_PACKETS = np.zeros((0, PACKET_ROWS, WIDTH), np.float32)


def grow(
    geometry: Geometry,
    placement: Placement,
    sphere: F32,
    still_spheres: int,
    brute: bool,
    team: Team,
    keys: Sequence[Array] = (),
    sphere_keys: F32 = np.zeros((0, 0, 4), np.float32),
) -> Bvh:
    """The tree. sphere: (S, 4), the first of them stand still.

    While the shutter is open: keys of the instances of what moves, as `lay` takes them; sphere_keys: (K or 0, Z, 4) of the last
    spheres.
    """
    end, again = placement.world
    triangles = len(geometry.triangle)
    shown = placement.group - placement.still
    moves = placement.still < len(placement.tree) or again < triangles or still_spheres < len(sphere)
    instances = _still_instances(placement)
    if not moves:
        return build(geometry.position, geometry.triangle, sphere, instances, brute, team)
    position = read_only(geometry.position)
    still = Bvh(_NO_NODES, _NO_PACKETS, np.zeros(0, np.int32), np.zeros((0, 3, 4)))
    last = end if instances is None else int(instances.first[-1])
    if last or still_spheres:
        still = build(position, geometry.triangle[:last], sphere[:still_spheres], instances, False, team, triangles)
    bodies = [tree_of(position, geometry.triangle[a:b], team=team) for a, b in placement.tree[placement.still :]]
    loose: Tree = (_NO_NODES, _NO_PACKETS)
    loose_keys = max(len(geometry.keys), len(sphere_keys), 1)
    if again < triangles or still_spheres < len(sphere):
        moving = sphere[still_spheres:]
        first_sphere = triangles + still_spheres - again
        if loose_keys > 1:
            shapes = geometry.keys[:, 0] if len(geometry.keys) else np.zeros((loose_keys, 0, 3), np.float32)
            own = geometry.triangle[again:] - np.int32(len(geometry.position) - shapes.shape[1])
            balls = sphere_keys if len(sphere_keys) else np.zeros((loose_keys, 0, 4), np.float32)
            loose = keyed_tree(shapes, own, balls, first_sphere, team)
        else:
            found = build(position, geometry.triangle[again:], moving, None, False, team, first_sphere)
            loose = found.node, found.packet
    first = [int(a) for a, _ in placement.tree[placement.still :]]
    return lay(still, bodies, first, loose, again, shown[shown >= 0], placement.to_world, team, brute, keys, loose_keys).bvh


def _still_instances(placement: Placement) -> Instances | None:
    tree = placement.tree[: placement.still]
    count = placement.still_instances
    if not count:
        return None
    return Instances(np.append(tree[:, 0], tree[-1:, 1]), placement.group[:count], placement.to_world[:count])
