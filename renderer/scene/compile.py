"""Where a scene is compiled: a SceneDescription becomes the flat arrays that the kernel reads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from itertools import pairwise
from typing import Any

import numpy as np

from renderer.arrays.rows import PART_COLUMNS, PART_MATERIAL, PART_OBJECT, PART_SHINES
from renderer.arrays.scene import CompiledScene, seal
from renderer.bvh.build import build
from renderer.bvh.instances import Instances
from renderer.errors import SceneError
from renderer.scene.description import F32, I32, Camera, SceneDescription
from renderer.scene.emitters import emitted_by_triangles
from renderer.scene.environment import are_accents, choose_environment, search_tables, tabulate_environment
from renderer.scene.framing import frame
from renderer.scene.geometry import MAX_COORDINATE, Geometry, Placement, bounds_of, by_triangle, place
from renderer.scene.guides import list_guides
from renderer.scene.lights import list_lights
from renderer.scene.objects import number_objects
from renderer.scene.packing import pack
from renderer.scene.punctual import tabulate_punctual
from renderer.scene.studio import STUDIO_TOO, light_studio
from renderer.settings import View
from renderer.threads import Team

__all__ = ["AUTO_CAMERA", "compile_scene", "own_cameras", "summarise"]

AUTO_CAMERA = "auto"

Progress = Callable[[str, float], None]


def compile_scene(
    description: SceneDescription, progress: Progress | None = None, brute: bool = False, threads: int | None = None
) -> CompiledScene:
    """The compiled scene, every array C-contiguous and read-only.

    progress: told each step as a phrase and the fraction done, 0..1. brute: without a working BVH, see `build`.
    threads: None for one per core; the scene does not depend on it.
    Raises SceneError where there is nothing to see or too much to hold.
    """
    with Team(threads) as team:
        return _compiled(description, progress or (lambda step, fraction: None), brute, team)


def _compiled(description: SceneDescription, say: Progress, brute: bool, team: Team) -> CompiledScene:
    say("placing meshes", 0.0)
    geometry, placement = place(description, team)
    sphere = _spheres(description)
    sphere_material = np.array([s.material for s in description.spheres], np.int32)
    bounds = _bounds(description.name, geometry, placement, sphere, team)
    say("packing textures", 0.25)
    packed = pack(description)
    say("listing lights", 0.4)
    punctual = tabulate_punctual(description.lights, bounds)
    double_sided = np.array([m.double_sided for m in description.materials], bool)
    emitted = emitted_by_triangles(packed, geometry)
    lights = list_lights(packed.emitted, emitted, double_sided, geometry, sphere, sphere_material, punctual)
    lit_on_purpose = bool(description.lights or description.environment)  # whoever places lights means the dark between them
    if description.studio_for_accents and not lit_on_purpose and are_accents(lights.power, bounds):
        light_studio(description)
        description.warnings.append(STUDIO_TOO)
    environment = tabulate_environment(description)
    chance = choose_environment(environment, lights.power, bounds)
    say("building the BVH", 0.5)
    instances = Instances(placement.first, placement.group, placement.to_world) if len(placement.group) else None
    bvh = build(geometry.position, geometry.triangle, sphere, instances, brute, team)
    scene = CompiledScene(
        bvh=bvh,
        to_world=placement.to_world,
        instance_stretch=np.linalg.svd(placement.to_world[:, :, :3], compute_uv=False)[:, ::2],
        instance_material=placement.material,
        instance_object=placement.object,
        position=geometry.position,
        normal=geometry.normal,
        uv=geometry.uv if len(packed.texture) else geometry.uv[:0],
        uv1=geometry.uv1 if any(t.uv_set == 1 for t in description.textures) else geometry.uv1[:0],
        color=geometry.color,
        tangent=geometry.tangent,
        triangle=_with_part(geometry),
        part=_parts(geometry, lights.triangle_light),
        triangle_light=lights.triangle_light,
        sphere=sphere,
        sphere_material=sphere_material,
        sphere_light=lights.sphere_light,
        sphere_object=np.array(number_objects(description).sphere, np.int32),
        material_kind=packed.material_kind,
        material_flags=packed.material_flags,
        material=packed.material,
        material_texture=packed.material_texture,
        texture=packed.texture,
        texture_transform=packed.texture_transform,
        texel=packed.texel,
        light_primitive=lights.primitive,
        light_cdf=lights.cdf,
        light_node=lights.node,
        light_area=lights.area,
        guide=list_guides([s.guide for s in description.spheres], lights.primitive, lights.cdf, len(geometry.triangle)),
        punctual_kind=punctual.kind,
        punctual=punctual.row,
        environment=environment.radiance,
        **search_tables(environment.marginal, environment.conditional),
        environment_frame=environment.frame(chance),
        bounds=bounds,
    )
    scene = seal(scene)
    say("done", 1.0)
    return scene


def summarise(description: SceneDescription, compiled: CompiledScene) -> dict[str, Any]:
    """What a person wants to know of a scene, JSON-ready: cameras, counts, bounds, animations, variants, warnings, defaults.

    cameras: the file's own, then always one named "auto" that frames the scene. up: which way is up. fps: the file's own,
    else 24. clips: its animations, with the seconds of their first and last key. objects, materials: their names in the order
    of their numbers, which the film's OBJECT and MATERIAL planes hold plus 1.
    """
    cameras = own_cameras(description, compiled)
    cameras.append(Camera(AUTO_CAMERA, frame(_visible_points(compiled), description.up)))
    return {
        "cameras": [{"name": c.name, "view": _view_dict(c.view)} for c in cameras],
        "counts": {
            "triangles": sum(len(description.meshes[i.mesh].triangles) for i in description.instances),
            "unique_triangles": len(compiled.triangle),
            "vertices": len(compiled.position),
            "spheres": len(compiled.sphere),
            "meshes": len(description.meshes),
            "instances": len(description.instances),
            "materials": len(description.materials),
            "textures": len(compiled.texture),
            "lights": len(compiled.light_primitive),
        },
        "objects": number_objects(description).names,
        "materials": [m.name for m in description.materials],
        "bounds": [[float(c) for c in corner] for corner in compiled.bounds],
        "animations": [clip.name for clip in description.clips],
        "up": list(description.up),
        "fps": description.fps,
        "clips": [asdict(clip) for clip in description.clips],
        "variants": list(description.variants),
        "warnings": list(description.warnings),
        "defaults": dict(description.defaults),
    }


def own_cameras(description: SceneDescription, compiled: CompiledScene) -> list[Camera]:
    """The file's own cameras, as `summarise` gives them."""
    return [
        Camera(c.name if c.name != AUTO_CAMERA else f"{AUTO_CAMERA} (of the file)", _aimed(c.view, compiled.bounds))
        for c in description.cameras
    ]


def _spheres(description: SceneDescription) -> F32:
    found = np.array([(*s.center, s.radius) for s in description.spheres], np.float64).reshape(-1, 4)
    if not (np.abs(found) < MAX_COORDINATE).all():
        raise SceneError(f"{description.name}: a sphere's place or size is beyond what numbers hold; give it a sane one")
    return found.astype(np.float32)


def _with_part(geometry: Geometry) -> I32:
    """A triangle's vertices and its part side by side: a hit reads one row."""
    triangle = np.empty((len(geometry.triangle), 4), np.int32)
    triangle[:, :3] = geometry.triangle
    triangle[:, 3] = by_triangle(geometry, np.arange(len(geometry.material), dtype=np.int32))
    return triangle


def _parts(geometry: Geometry, triangle_light: I32) -> I32:
    part = np.zeros((len(geometry.material), PART_COLUMNS), np.int32)
    part[:, PART_MATERIAL] = geometry.material
    part[:, PART_OBJECT] = geometry.object
    if len(triangle_light):
        part[:, PART_SHINES] = [(triangle_light[a:b] >= 0).any() for a, b in pairwise(geometry.first)]
    return part


def _bounds(name: str, geometry: Geometry, placement: Placement, sphere: F32, team: Team) -> F32:
    corners: list[np.ndarray] = [*bounds_of(geometry, placement, team)]
    if len(sphere):
        corners += [sphere[:, :3] - sphere[:, 3:], sphere[:, :3] + sphere[:, 3:]]
    if not corners:
        raise SceneError(f"{name}: has no triangle with an area and no sphere; export it with its meshes")
    bounds = np.array([np.min([c.min(axis=0) for c in corners], axis=0), np.max([c.max(axis=0) for c in corners], axis=0)])
    if not np.abs(bounds).max() < MAX_COORDINATE:
        raise SceneError(f"{name}: an instance's place is beyond what numbers hold; give it a sane transform")
    return bounds.astype(np.float32)


def _visible_points(compiled: CompiledScene) -> np.ndarray:
    in_world = compiled.part[compiled.triangle[:, 3], PART_OBJECT] >= 0
    world = compiled.triangle[: np.count_nonzero(in_world), :3]  # the others, of groups, come behind
    points = [compiled.position[world[:: max(len(world) // 50_000, 1)].reshape(-1)]]
    directions = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)])
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    for x, y, z, radius in compiled.sphere[:2000]:
        points.append(np.array([x, y, z]) + radius * directions)
    shapes = {root: _tree_corners(compiled, root) for root in np.unique(compiled.bvh.instance_root)}
    for root, transform in zip(compiled.bvh.instance_root[:10_000], compiled.to_world, strict=False):
        points.append(shapes[root] @ transform[:, :3].T + transform[:, 3])
    return np.concatenate(points)


def _tree_corners(compiled: CompiledScene, root: int) -> np.ndarray:
    """The corners of the topmost eight boxes of an instance's tree, in its own space."""
    node = compiled.bvh.node[root]
    boxes = [node[:6, lane].reshape(3, 2) for lane in np.flatnonzero(node[0] <= node[1])]
    return np.array([np.where(which, box[:, 1], box[:, 0]) for box in boxes for which in np.ndindex(2, 2, 2)]).reshape(-1, 3)


def _aimed(view: View, bounds: np.ndarray) -> View:
    """The same view with its target moved along the line of sight to beside the scene's middle: who orbits, orbits that."""
    eye, target = np.array(view.eye), np.array(view.target)
    forward = (target - eye) / np.linalg.norm(target - eye)
    distance = float((bounds.mean(axis=0) - eye) @ forward)
    if distance <= 1e-3 * float(np.linalg.norm(bounds[1] - bounds[0])):
        return view
    x, y, z = (float(c) for c in eye + forward * distance)
    focus = view.focus
    if focus is None and view.aperture > 0:  # what was sharp stays sharp
        focus = float(np.linalg.norm(target - eye))
    return replace(view, target=(x, y, z), focus=focus)


def _view_dict(view: View) -> dict[str, Any]:
    return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(view).items()}
