"""Places a scene's geometry: reuses cached sections from frame to frame, builds the others, and computes the bounds."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.errors import SceneError
from renderer.scene.concatenate import Joined, join
from renderer.scene.curve_meshes import flat_materials
from renderer.scene.description import F32, I32, Mesh, SceneDescription
from renderer.scene.frame_reuse import ShotCache
from renderer.scene.geometry import (
    Placement,
    Section,
    build_bodies,
    build_per_frame,
    build_static,
    check_size,
    moving_corners,
    placement_of,
    still_corners,
)
from renderer.scene.instances import Group, Sharing, is_placed_per_frame, plan_moving_instances, plan_static_instancing
from renderer.scene.material_packing import Packed, pack
from renderer.scene.object_ids import number_objects
from renderer.scene.placed_mesh import MAX_COORDINATE
from renderer.scene.tangents import has_elliptic_fibres, needs_tangents, tangent_uv_set
from renderer.sentences import Sentence
from renderer.threads import Team

__all__ = ["PlacedGeometry", "place_geometry"]


class PlacedGeometry(NamedTuple):
    """A scene's geometry as placed for one frame, with the packed materials and the bounds."""

    sections: tuple[Section, Section, Section]  # static, rigid moving bodies, loose
    joined: Joined
    placement: Placement
    spheres: list[int]  # the description's indices, in the order of the arrays: moving ones last
    still_spheres: int
    sphere: F32  # (S, 4)
    sphere_material: I32  # (S,)
    sphere_object: I32  # (S,)
    packed: Packed
    bounds: F32  # (2, 3)


def place_geometry(description: SceneDescription, team: Team, shot_cache: ShotCache) -> PlacedGeometry:
    """Places meshes and spheres, reusing sections cached in `shot_cache`.

    Raises SceneError if there are none or too many, or positions exceed the range of float32.
    """
    token = description.still
    numbers = shot_cache.get_or_make(
        "objects",
        lambda: (
            [(i.name, "" if i.name else description.meshes[i.mesh].name) for i in description.instances],
            [s.name for s in description.spheres],
        ),
        lambda: number_objects(description),
        token,
    )
    objects = numbers.instance
    standing = shot_cache.get_or_make(
        "standing", lambda: _static_key(description), lambda: plan_static_instancing(description), token
    )
    sharing = Sharing(standing.copied, standing.groups, *plan_moving_instances(description, standing.movers))
    check_size(description, sharing)
    still = shot_cache.get_or_make(
        "still",
        lambda: _static_section_key(description, sharing, objects),
        lambda: build_static(description, sharing, objects, team),
        token,
    )
    bodies = shot_cache.get_or_make(
        "bodies",
        lambda: [_group_key(description, group) for group in sharing.bodies],
        lambda: build_bodies(description, sharing, team),
    )
    loose = build_per_frame(description, sharing, objects, team)
    packed = shot_cache.get_or_make(
        "packed",
        lambda: (
            description.materials,
            description.medium,
            description.textures,
            [image.pixels for image in description.images],
            flat_materials(description),
        ),
        lambda: pack(description),
        token,
    )
    placement = placement_of(description, sharing, objects)
    spheres = sorted(range(len(description.spheres)), key=lambda n: description.spheres[n].moves)
    sphere = _spheres(description, spheres)
    sections = still, bodies, loose
    return PlacedGeometry(
        sections,
        join(sections, len(packed.texture) > 0 or has_elliptic_fibres(description), shot_cache),
        placement,
        spheres,
        sum(not s.moves for s in description.spheres),
        sphere,
        np.array([description.spheres[n].material for n in spheres], np.int32),
        np.array([numbers.sphere[n] for n in spheres], np.int32),
        packed,
        _bounds(description.name, sections, placement, sphere, shot_cache),
    )


def _static_key(description: SceneDescription) -> Any:
    """Returns the cache key of `plan_static_instancing`: all properties of the description that it depends on."""
    return (
        [(i.mesh, None if i.moves else i.transform, i.material, i.name, i.moves) for i in description.instances],
        [(m.name, len(m.triangles), m.material, m.deforms) for m in description.meshes],
        [is_placed_per_frame(m) for m in description.materials],
    )


def _static_section_key(description: SceneDescription, sharing: Sharing, objects: list[int]) -> Any:
    copied = []
    for n in sharing.copied:
        instance = description.instances[n]
        mesh = description.meshes[instance.mesh]
        material = mesh.material if instance.material is None else instance.material
        copied.append((_mesh_key(mesh), instance.transform, objects[n], material, _tangent_properties(description, [material])))
    return copied, [_group_key(description, group) for group in sharing.groups]


def _group_key(description: SceneDescription, group: Group) -> Any:
    own = sorted({-1 if m is None else m for m in (description.instances[n].material for n in group.instances)})
    meshes = [description.meshes[m] for m in group.meshes]
    return own, [
        (_mesh_key(m), m.material, _tangent_properties(description, [m.material, *(n for n in own if n >= 0)])) for m in meshes
    ]


def _mesh_key(mesh: Mesh) -> Any:
    return mesh.positions, mesh.triangles, mesh.normals, mesh.uvs, mesh.uvs1, mesh.colors, mesh.tangents, mesh.diameters


def _tangent_properties(description: SceneDescription, materials: list[int]) -> Any:
    """Returns, for each material, the UV set of its tangents, or None if it needs none."""
    found = [description.materials[m] for m in materials]
    return [tangent_uv_set(description, m) if needs_tangents(m) else None for m in found]


def _spheres(description: SceneDescription, order: list[int]) -> F32:
    spheres = [description.spheres[n] for n in order]
    found = np.array([(*s.center, s.radius) for s in spheres], np.float64).reshape(-1, 4)
    if not (np.abs(found) < MAX_COORDINATE).all():
        raise SceneError(
            Sentence(
                "sphere-out-of-number-range",
                "{name}: the position or size of a sphere is too large for 32-bit numbers; correct it",
                name=description.name,
            )
        )
    return found.astype(np.float32)


def _bounds(
    name: str, sections: tuple[Section, Section, Section], placement: Placement, sphere: F32, shot_cache: ShotCache
) -> F32:
    still, bodies, loose = sections
    places = placement.to_world[: placement.still]
    standing = shot_cache.get_or_make("bounds", lambda: (still, places), lambda: still_corners(still, placement))
    corners: list[np.ndarray] = [*standing, *moving_corners(still, bodies, loose, placement)]
    if len(sphere):
        corners += [sphere[:, :3] - sphere[:, 3:], sphere[:, :3] + sphere[:, 3:]]
    if not corners:
        raise SceneError(
            Sentence(
                "shape-without-area",
                "{name} has no triangle with an area and no sphere; export it with its meshes",
                name=name,
            )
        )
    bounds = np.array([np.min([c.min(axis=0) for c in corners], axis=0), np.max([c.max(axis=0) for c in corners], axis=0)])
    if not np.abs(bounds).max() < MAX_COORDINATE:
        raise SceneError(
            Sentence(
                "instance-out-of-number-range",
                "{name}: the position of an instance is too large for 32-bit numbers; correct its transform",
                name=name,
            )
        )
    return bounds.astype(np.float32)
