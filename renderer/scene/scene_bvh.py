"""Builds the BVH over a scene's geometry: a single tree if nothing moves, else one composed of separately built subtrees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.bvh.build import NO_RADIUS, build, tree_of
from renderer.bvh.instances import Instances
from renderer.bvh.layout import NODE_ROWS, PACKET_ROWS, WIDTH, Bvh
from renderer.bvh.motion_bvh import keyed_tree
from renderer.bvh.subtrees import AssembledBvh, Tree, assemble_bvh
from renderer.scene.description import F32
from renderer.scene.frame_reuse import ShotCache
from renderer.scene.geometry import Geometry, Placement, Section
from renderer.threads import Team

__all__ = ["build_scene_bvh"]

Array = npt.NDArray[Any]

_NO_TREE: Tree = np.zeros((0, NODE_ROWS, WIDTH), np.float32), np.zeros((0, PACKET_ROWS, WIDTH), np.float32)


def build_scene_bvh(
    sections: tuple[Section, Section, Section],
    first_triangle: tuple[int, ...],
    placement: Placement,
    sphere: F32,
    still_spheres: int,
    brute: bool,
    team: Team,
    shot_cache: ShotCache,
    keys: Sequence[Array] = (),
    sphere_keys: F32 = np.zeros((0, 0, 4), np.float32),
) -> AssembledBvh:
    """Builds the scene's BVH.

    sections: static geometry, rigid bodies and geometry placed per frame. first_triangle: the first triangle number of each.
    sphere: (S, 4), of which the first `still_spheres` are static. Motion while the shutter is open: keys: of moving instances, in
    the form that `assemble_bvh` expects; sphere_keys: (K or 0, Z, 4) of the last Z spheres.
    """
    still, bodies, loose = sections
    _, first_body, first_loose, triangles = first_triangle
    moves = bool(bodies.trees) or len(loose.geometry.triangle) > 0 or still_spheres < len(sphere)

    def build_still() -> Bvh:
        places = placement.to_world[: placement.still]
        instances = None
        if placement.still:
            ends = [still.world, *(end for _, end in still.trees)]
            instances = Instances(np.array(ends), placement.group[: placement.still], places)
        geometry, radius = still.geometry, curve_radius(still.geometry)
        if moves and not (len(geometry.triangle) or still_spheres):
            return Bvh(*_NO_TREE, np.zeros(0, np.int32), np.zeros((0, 3, 4)))
        whole = brute and not moves
        return build(geometry.position, geometry.triangle, sphere[:still_spheres], instances, whole, team, triangles, radius)

    spheres = sphere[:still_spheres]
    shown = placement.to_world[: placement.still]
    first_sphere = triangles if still_spheres else None
    base = shot_cache.get_or_make(
        "still tree", lambda: (still, placement.group[: placement.still], shown, spheres, first_sphere), build_still
    )
    if not moves:
        return AssembledBvh(base, (0, 0, *[len(base.node)] * 3), (0, 0, *[len(base.packet)] * 3), (base, ()))
    trees = shot_cache.get_or_make("body trees", lambda: bodies, lambda: _body_trees(bodies, team))
    lax = _NO_TREE
    loose_keys = max(len(loose.geometry.keys), len(sphere_keys), 1)
    if len(loose.geometry.triangle) or still_spheres < len(sphere):
        first = triangles + still_spheres - first_loose
        if loose_keys > 1:
            shapes, balls = loose.geometry.keys[:, 0], sphere_keys
            shapes = shapes if len(shapes) else np.zeros((loose_keys, 0, 3), np.float32)
            balls = balls if len(balls) else np.zeros((loose_keys, 0, 4), np.float32)
            lax = keyed_tree(shapes, loose.geometry.triangle, balls, first, team, curve_radius(loose.geometry))
        else:
            geometry, radius = loose.geometry, curve_radius(loose.geometry)
            found = build(geometry.position, geometry.triangle, sphere[still_spheres:], None, False, team, first, radius)
            lax = found.node, found.packet
    begins = [first_body + a for a, _ in bodies.trees]
    which = placement.group[placement.still :] - len(still.trees)
    places = placement.to_world
    return assemble_bvh(base, trees, begins, lax, first_loose, which, places, team, brute, shot_cache.array_for, keys, loose_keys)


def _body_trees(bodies: Section, team: Team) -> list[Tree]:
    geometry, radius = bodies.geometry, curve_radius(bodies.geometry)
    return [tree_of(geometry.position, geometry.triangle[a:b], team=team, radius=radius) for a, b in bodies.trees]


def curve_radius(geometry: Geometry) -> F32:
    """Returns the radius of curves at each vertex, (V,), or no rows if no triangle is a segment of a curve."""
    corner = geometry.triangle
    if not len(geometry.tangent) or not ((corner[:, 1] == corner[:, 2]) & (corner[:, 0] != corner[:, 1])).any():
        return NO_RADIUS
    return np.asarray(np.abs(geometry.tangent[:, 3]) * np.float32(0.5), np.float32)
