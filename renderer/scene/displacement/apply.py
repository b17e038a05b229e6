"""Finds the meshes of a scene that are displaced, and shares the budget of triangles out among them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, Material, Mesh, SceneDescription
from renderer.scene.displacement.dicing import Diced, Measure, dice
from renderer.scene.displacement.heights import height_lookup
from renderer.scene.displacement.lengths import object_lengths, only_camera, screen_lengths
from renderer.scene.displacement.surface import displaced_surface, with_normals
from renderer.scene.frame_reuse import ShotCache
from renderer.scene.material import check
from renderer.sentences import Sentence

__all__ = ["displace"]

_LEAST_STEP = 2.0**0.25  # by how much edges are lengthened at least while there are too many triangles

_COARSE, _FAR_TOO_MANY = 16, 8  # part of the budget, and times the budget

_Key = tuple[int, int, float, float, float]  # mesh, texture, scale, midlevel, rate


class _Target(NamedTuple):
    """A mesh to displace, the material that displaces it, and the transforms of its instances."""

    mesh: Mesh
    material: Material
    places: list[npt.NDArray[np.float64]]


def displace(description: SceneDescription, shot_cache: ShotCache) -> SceneDescription:
    """Returns the description with displaced meshes; the description itself if no material displaces.

    A mesh is displaced once for each displacement of its instances' materials. Adds warnings to the description's list. The
    result depends on the description only. Raises SceneError if a parameter of a material is outside its range.
    """
    displacing = [m for m in description.materials if m.displacement_texture is not None]
    if not displacing:
        return description
    for material in displacing:
        check(material)
    numbers, targets = _targets(description)
    if not targets:
        return description
    meshes = list(description.meshes)
    made = list(meshes)
    place: dict[_Key, int] = {}
    # Other frames share what does not deform, so that must not depend on what does.
    groups = [[key for key, each in targets.items() if each.mesh.deforms is deforms] for deforms in (False, True)]
    budget = description.displaced_triangles // max(sum(len(group) > 0 for group in groups), 1)
    for slot, group in enumerate(groups):
        chosen = [targets[key] for key in group]
        found = shot_cache.get_or_make(
            ("displaced", slot),
            lambda chosen=chosen: _cache_key(description, chosen),  # type: ignore[misc]
            lambda chosen=chosen: _displaced_meshes(description, chosen, budget),  # type: ignore[misc]
        )
        for key, mesh in zip(group, found[0], strict=True):
            place[key] = len(made)
            made.append(mesh)
        if found[1] is not None and found[1] not in description.warnings:
            description.warnings.append(found[1])
    instances = [
        each if key is None else replace(each, mesh=place[key]) for each, key in zip(description.instances, numbers, strict=True)
    ]
    return replace(description, meshes=made, instances=instances)


def _targets(description: SceneDescription) -> tuple[list[_Key | None], dict[_Key, _Target]]:
    """Returns the key of each instance's displacement, None for those without, and what is displaced by key."""
    numbers: list[_Key | None] = []
    targets: dict[_Key, _Target] = {}
    bare: set[str] = set()
    for instance in description.instances:
        mesh = description.meshes[instance.mesh]
        material = description.materials[mesh.material if instance.material is None else instance.material]
        texture = material.displacement_texture
        key = None
        if texture is not None and material.displacement_scale != 0 and len(mesh.triangles) and mesh.diameters is None:
            if (mesh.uvs1 if description.textures[texture].uv_set else mesh.uvs) is None:
                bare.add(mesh.name)
            else:
                numbers_of = material.displacement_scale, material.displacement_midlevel, material.displacement_rate
                key = instance.mesh, texture, *numbers_of
                found = targets.setdefault(key, _Target(mesh, material, []))
                found.places.append(np.asarray(instance.transform, np.float64))
        numbers.append(key)
    if bare:
        note = Sentence(
            "displacement-without-uvs",
            "Meshes without texture coordinates are not displaced: {count}. Unwrap them.",
            count=len(bare),
        )
        if note not in description.warnings:
            description.warnings.append(note)
    return numbers, targets


def _cache_key(description: SceneDescription, targets: list[_Target]) -> object:
    return (
        [
            (
                *(getattr(t.mesh, name) for name in ("positions", "triangles", "normals", "uvs", "uvs1", "colors", "keys")),
                *(t.mesh.name, t.mesh.material, t.mesh.deforms),
                *(getattr(t.material, f"displacement_{name}") for name in ("texture", "scale", "midlevel", "rate")),
            )
            for t in targets
        ],
        [(texture, description.images[texture.image].pixels) for texture in description.textures] if targets else [],
        (only_camera(description), [t.places for t in targets]) if only_camera(description) is not None else None,
        description.displaced_triangles,
    )


def _displaced_meshes(description: SceneDescription, targets: list[_Target], budget: int) -> tuple[list[Mesh], Sentence | None]:
    """Returns the displaced meshes, and a warning if the budget makes their edges longer than they should be."""
    with np.errstate(over="ignore", invalid="ignore"):  # of positions that are too large, which are refused later
        targets = [each._replace(mesh=with_normals(each.mesh)) for each in targets]
        diced, longest = _dice_within(description, targets, budget)
        meshes = [_displaced(description, target, each) for target, each in zip(targets, diced, strict=True)]
    if longest == 1:
        return meshes, None
    return meshes, Sentence(
        "displacement-limited",
        "Displaced surfaces have {count} triangles, at most {most}: their edges are up to {times} times as long as asked for.",
        count=sum(len(each.triangles) for each in diced),
        most=budget,
        times=f"{longest:.1f}",
    )


def _dice_within(description: SceneDescription, targets: list[_Target], budget: int) -> tuple[list[Diced], float]:
    """Returns the diced meshes, with at most `budget` triangles, and the factor by which their edges are longer than asked for.

    Meshes that have more triangles than that are not diced.
    """
    points = [each.mesh.positions.astype(np.float64) for each in targets]
    measures = [_measure(description, each, at) for each, at in zip(targets, points, strict=True)]
    least = sum(len(each.mesh.triangles) for each in targets)
    most = max(budget, least)

    def attempt(longest: float, most: int) -> tuple[list[Diced], int]:
        left, diced = most, []
        for target, at, measure in zip(targets, points, measures, strict=True):
            one = dice(at, target.mesh.triangles, measure, longest, left)
            left = max(left - len(one.triangles), 0)
            diced.append(one)
        return diced, sum(each.expected for each in diced)

    # Dicing coarsely tells soon whether there would be far too many.
    far = attempt(1.0, most // _COARSE)[1] / most
    longest = 1.0 if far < _FAR_TOO_MANY else 0.5 * math.sqrt(far)
    while True:
        diced, expected = attempt(longest, most)
        if expected == sum(len(each.triangles) for each in diced) <= most:
            return diced, longest
        longest *= max(_LEAST_STEP, 0.8 * math.sqrt(expected / most))


def _measure(description: SceneDescription, target: _Target, points: npt.NDArray[np.float64]) -> Measure:
    rate, view = target.material.displacement_rate, only_camera(description)
    if view is None:
        return object_lengths(points, rate)
    return screen_lengths(description, view, target.places, points, rate)


def _displaced(description: SceneDescription, target: _Target, diced: Diced) -> Mesh:
    material = target.material
    assert material.displacement_texture is not None
    texture = description.textures[material.displacement_texture]
    look_up = height_lookup(texture, description.images[texture.image])
    scale, middle = np.float32(material.displacement_scale), np.float32(material.displacement_midlevel)

    def heights(uv: F32) -> F32:
        return scale * (look_up(uv) - middle)

    return displaced_surface(target.mesh, diced, heights, texture.uv_set)
