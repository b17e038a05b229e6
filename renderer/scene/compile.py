"""Compiles a SceneDescription into the flat arrays that the kernel reads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from renderer.arrays.light_rows import PIVOT_COLUMNS
from renderer.arrays.rows import LAMP, PART_COLUMNS, PART_MATERIAL, PART_OBJECT, PART_SHINES, SHADELESS, UNSEEN, UNSEEN_BY
from renderer.arrays.scene import CompiledScene, seal
from renderer.bvh.layout import RAY_KINDS
from renderer.bvh.ray_masks import exclude_primitives
from renderer.bvh.subtrees import AssembledBvh
from renderer.kernel.light.punctual import SUN, SUN_UNSEEN
from renderer.scene import motion_keys
from renderer.scene.curve_meshes import with_tubes
from renderer.scene.default_camera import frame, is_out_of_view
from renderer.scene.description import I32, Camera, SceneDescription
from renderer.scene.displacement.apply import displace
from renderer.scene.emission_maps import maps_of, tabulate_emission
from renderer.scene.emitters import emitting_triangles, is_uniform_emitter
from renderer.scene.environment import (
    EnvironmentTables,
    are_accents,
    choose_environment,
    environment_power,
    search_tables,
    tabulate_environment,
)
from renderer.scene.frame_reuse import PartOffsets, ShotCache
from renderer.scene.geometry import NO_PLACEMENT, Geometry, by_triangle
from renderer.scene.given_spectra import spectrum_rows
from renderer.scene.guiding_targets import list_guides
from renderer.scene.light_groups import names_of, tabulate_groups
from renderer.scene.light_links import tabulate_links
from renderer.scene.lights import emitters_with_area, list_lights
from renderer.scene.object_ids import number_objects
from renderer.scene.origin import origin_of, relative_to_origin
from renderer.scene.pivots import list_pivots
from renderer.scene.placed_bodies import PlacedGeometry, place_geometry
from renderer.scene.punctual import tabulate_punctual
from renderer.scene.room_camera import room_view
from renderer.scene.scene_bvh import build_scene_bvh
from renderer.scene.standing import standing_box, within_footprint
from renderer.scene.studio import WEAK_LIGHTS_WARNING, light_studio
from renderer.scene.tangents import has_elliptic_fibres
from renderer.scene.targets import list_targets
from renderer.scene.visibility import Visibility, tabulate_visibility
from renderer.scene.visible_surfaces import invisible_note
from renderer.scene.volumes import tabulate_volumes
from renderer.sentences import Sentence
from renderer.settings import View
from renderer.threads import Team
from renderer.work import DEFAULT_SIZE

__all__ = ["AUTO_CAMERA", "camera_dicts", "camera_names", "compile_scene", "own_cameras", "summarise", "summarise_again"]

AUTO_CAMERA = "auto"

Progress = Callable[[str, float], None]


def compile_scene(
    description: SceneDescription,
    progress: Progress | None = None,
    brute: bool = False,
    threads: int | None = None,
    shot_cache: ShotCache | None = None,
) -> CompiledScene:
    """Returns the compiled scene; every array is C-contiguous and read-only.

    progress: called with the name of each step and the fraction done, 0..1. brute: makes every box of the BVH infinite, so that
    each ray tests every primitive (for tests). threads: number of threads; None: one per core. shot_cache: cache of compiled
    parts of another frame of the same shot, whose compiled scene must no longer be in use. Neither threads nor shot_cache changes
    the result. Raises SceneError if the scene is empty or too large.
    """
    with Team(threads) as team:
        own = ShotCache() if shot_cache is None or brute else shot_cache
        own.begin_frame()
        scene = _compile(description, progress or (lambda step, fraction: None), brute, team, own)
        if shot_cache is not None:
            shot_cache.cuts = own.cuts
        return scene


def _compile(description: SceneDescription, say: Progress, brute: bool, team: Team, shot_cache: ShotCache) -> CompiledScene:
    say(Sentence("progress-placing-meshes", "placing meshes"), 0.0)
    description = displace(with_tubes(description, shot_cache), shot_cache)
    origin = origin_of(description, shot_cache)
    whole, description = description, relative_to_origin(description, origin, shot_cache)
    stood = place_geometry(description, team, shot_cache)
    if note := invisible_note(description):
        whole.warnings.insert(0, note)  # the first thing to know about the scene
    sphere, joined, placement = stood.sphere, stood.joined, stood.placement
    geometry = joined.geometry
    say(Sentence("progress-packing-textures", "packing textures"), 0.25)
    packed = stood.packed
    volumes = tabulate_volumes(description)
    say(Sentence("progress-listing-lights", "listing lights"), 0.4)
    maps = maps_of(description.lights)
    emission = shot_cache.get_or_make("emission", lambda: maps, lambda: tabulate_emission(maps))
    punctual = tabulate_punctual(description.lights, stood.bounds, maps, emission)
    double_sided = np.array([m.double_sided for m in description.materials], bool)
    all_emitters = emitting_triangles(packed, geometry)
    emitters = emitters_with_area(all_emitters, geometry)
    if left_out := max(
        len(all_emitters.triangle) - len(emitters.triangle), _count_emitters_without_area(description, packed.emitted)
    ):
        description.warnings.append(
            Sentence("emitters-without-area", "Emitting triangles without an area give no light: {count}.", count=left_out)
        )
    sphere_keys = motion_keys.sphere_keys(description, stood.spheres[stood.still_spheres :])
    even = is_uniform_emitter(packed, geometry)
    of_spheres = sphere, stood.sphere_material
    lights = list_lights(packed.emitted, emitters, double_sided, even, geometry, *of_spheres, punctual, sphere_keys)
    lit_on_purpose = bool(description.lights or description.environment)  # a scene with its own lights may be dark on purpose
    if description.studio_for_accents and not lit_on_purpose and are_accents(lights.power, stood.bounds):
        light_studio(whole)
        whole.warnings.append(WEAK_LIGHTS_WARNING)
    environment, search = shot_cache.get_or_make(
        "environment",
        lambda: (whole.environment, _environment_image(whole)),
        lambda: _environment(whole),
    )
    subject = stood.bounds if description.subject is None else description.subject.astype(np.float32)
    chance = choose_environment(environment, lights.power, subject)
    say(Sentence("progress-building-bvh", "building the BVH"), 0.5)
    keys = motion_keys.instance_keys(description, placement)
    still_spheres = stood.still_spheres
    laid = build_scene_bvh(
        stood.sections, joined.first_triangle, placement, sphere, still_spheres, brute, team, shot_cache, keys, sphere_keys
    )
    part = _part_rows(geometry, emitters.triangle)
    seen = tabulate_visibility(whole, lights.primitive, joined.triangle, part, stood.sphere_material)
    laid = _with_ray_roots(laid, stood, seen, part)
    links = tabulate_links(whole, lights.primitive, joined.triangle, part, stood.sphere_material)
    groups = tabulate_groups(whole, lights.primitive, joined.triangle, part, stood.sphere_material)
    arrays = CompiledScene(
        bvh=laid.bvh,
        to_world=placement.to_world,
        instance_stretch=motion_keys.scale_ranges(description, placement),
        instance_material=placement.material,
        instance_object=placement.object,
        position=geometry.position,
        normal=geometry.normal,
        uv=geometry.uv,
        uv1=geometry.uv1 if _has_second_uvs(description) else geometry.uv1[:0],
        color=geometry.color,
        tangent=geometry.tangent,
        triangle=joined.triangle,
        part=part,
        triangle_light=lights.triangle_light,
        sphere=sphere,
        sphere_material=stood.sphere_material,
        sphere_light=lights.sphere_light,
        sphere_object=stood.sphere_object,
        material_kind=packed.material_kind,
        material_flags=packed.material_flags,
        material=packed.material,
        material_texture=packed.material_texture,
        medium=packed.medium,
        material_medium=packed.material_medium,
        volume=volumes.volume,
        volume_grid=volumes.volume_grid,
        voxel=volumes.voxel,
        majorant=volumes.majorant,
        texture=packed.texture,
        texture_transform=packed.texture_transform,
        texel=packed.texel,
        light_primitive=lights.primitive,
        light_cdf=lights.cdf,
        light_node=lights.node,
        light_area=lights.area,
        light_parallelogram=lights.parallelogram,
        guide=list_guides(
            [description.spheres[n].guide for n in stood.spheres],
            lights.primitive,
            lights.second,
            lights.cdf,
            len(geometry.triangle),
        ),
        target=list_targets(description, packed, lights.power + environment_power(environment, subject)),
        pivot=np.zeros((0, PIVOT_COLUMNS), np.float32),
        sun=_suns(lights.primitive, punctual.kind, len(joined.triangle) + len(sphere)),
        punctual_kind=punctual.kind,
        punctual=punctual.row,
        emission_map=emission.map,
        emission_window=emission.window,
        emission=emission.texel,
        emission_frame=punctual.frame,
        environment=environment.radiance,
        **search,
        environment_frame=environment.frame(chance),
        bounds=subject,
        key_position=geometry.keys[:, 0].reshape(-1, 3),
        key_normal=geometry.keys[:, 1].reshape(-1, 3),
        key_sphere=sphere_keys.reshape(-1, 4),
        key_punctual=motion_keys.punctual_keys(description.lights),
        key_emission_frame=motion_keys.emission_frame_keys(description.lights, maps),
        key_texture=packed.key_texture,
        light_group=groups.light,
        material_group=groups.material,
        environment_group=groups.environment,
        group_name=groups.name,
        given_spectrum=spectrum_rows(description.spectra),
        light_link=links.light,
        object_links=links.object,
        light_visibility=seen.light,
        origin=origin,
    )
    arrays = arrays._replace(pivot=list_pivots(arrays))
    shot_cache.lights_power = lights.power
    shot_cache.cuts = _part_offsets(stood, laid, (environment, search), emission)
    scene = seal(arrays, _rows_to_check(stood, laid, arrays, shot_cache))
    say("done", 1.0)
    return scene


def _environment(description: SceneDescription) -> tuple[EnvironmentTables, dict[str, Any]]:
    tables = tabulate_environment(description)
    return tables, search_tables(tables.marginal, tables.conditional)


def _has_second_uvs(description: SceneDescription) -> bool:
    """Returns True if a kernel needs the second UV set: for textures, or as the normals of elliptic fibres."""
    return any(t.uv_set == 1 for t in description.textures) or has_elliptic_fibres(description)


def _environment_image(description: SceneDescription) -> np.ndarray | None:
    source = description.environment
    return None if source is None or source.image is None else description.images[source.image].pixels


def _part_offsets(stood: PlacedGeometry, laid: AssembledBvh, environment: tuple[object, ...], emission: object) -> PartOffsets:
    still, bodies, _ = stood.sections
    joined = stood.joined
    geometry = joined.geometry
    has = tuple(len(getattr(geometry, name)) > 0 for name in ("uv", "uv1", "color", "tangent"))
    where = (*map(int, has), *laid.node[1:4], *laid.packet[1:4], *joined.first_triangle[:3], *joined.first_vertex[:3])
    heads = {
        "still": (still, laid.kept[0], *where),
        "bodies": (still, bodies, laid.kept[1], *where),
        "materials": (stood.packed,),
        "textures": (stood.packed,),
        "emission": (emission,),
        "environment": environment,
    }
    return PartOffsets(joined.first_vertex, joined.first_triangle, laid.node, laid.packet, heads)


def _rows_to_check(
    stood: PlacedGeometry, laid: AssembledBvh, scene: CompiledScene, shot_cache: ShotCache
) -> dict[str, np.ndarray]:
    """Returns the rows of the compiled arrays that have yet to be checked: array name -> rows not checked for an earlier frame.

    Arrays that are not listed have to be checked in full.
    """
    if not shot_cache.is_unchanged(
        "checked", (*stood.sections[:2], *laid.node[1:4], *laid.packet[1:4], *stood.joined.first_triangle[:3])
    ):
        return {}
    node = laid.bvh.node
    return {
        "triangle": scene.triangle[stood.joined.first_triangle[2] :],
        "bvh.node": np.concatenate([node[: laid.node[1]], node[laid.node[3] :]]),
        "bvh.packet": laid.bvh.packet[laid.packet[3] :],
    }


def summarise(description: SceneDescription, compiled: CompiledScene) -> dict[str, Any]:
    """Returns a JSON-ready summary of a scene: cameras, counts, bounds, animations, variants, warnings, defaults.

    cameras: those of the file, then always one named "auto" that frames the scene; cameras that move while the shutter is open
    have `views`, in the form of RenderSettings. up: the up direction. fps: the file's frame rate, else 24. clips: the file's
    animations, with the times of their first and last key in seconds. objects, materials: names by number; the OBJECT and
    MATERIAL planes of the film hold number + 1. light_groups: the names of the lights' groups. vary: how the file says that views
    vary; left out if it does not. variation: the values drawn for a
    varied scene; else left out.
    """
    floor = description.subject is not None  # one mesh of two flat triangles, six vertices
    objects = number_objects(description)
    points = _visible_points(compiled, objects.instance[-1] if floor else None)
    return {
        "cameras": camera_dicts(description, _bounds(compiled), points + compiled.origin),
        "counts": {
            "triangles": sum(len(description.meshes[i.mesh].triangles) for i in description.instances) - 2 * floor,
            "unique_triangles": len(compiled.triangle) - _padding_triangles(compiled) - 2 * floor,
            "vertices": int(np.count_nonzero(compiled.normal.any(axis=1))) - 6 * floor,
            "spheres": len(compiled.sphere),
            "meshes": len(description.meshes) - floor,
            "instances": len(description.instances) - floor,
            "materials": len(description.materials) - floor,
            "textures": len(compiled.texture),
            "lights": len(compiled.light_primitive),
        },
        "objects": objects.names,
        "materials": [m.name for m in description.materials],
        "light_groups": names_of(compiled),
        "bounds": _bounds(compiled).tolist(),
        "animations": [clip.name for clip in description.clips],
        "up": list(description.up),
        "up_axis": description.up_axis,
        "floor": floor,
        "fps": description.fps,
        "clips": [asdict(clip) for clip in description.clips],
        "variants": list(description.variants),
        "warnings": list(description.warnings),
        "defaults": dict(description.defaults),
        **({"vary": description.vary} if description.vary else {}),
        **_variation(description),
    }


def _variation(description: SceneDescription) -> dict[str, Any]:
    return {"variation": description.variation} if description.variation else {}


def summarise_again(description: SceneDescription, compiled: CompiledScene, before: dict[str, Any]) -> dict[str, Any]:
    """Returns the summary of another frame of a shot in which only transforms and shapes change.

    before: the summary of the earlier frame, from which everything else is copied. The camera "auto" frames the bounds of the
    geometry here, not its vertices.
    """
    return {
        **before,
        "cameras": camera_dicts(description, _bounds(compiled), _corners(_bounds(compiled))),
        "bounds": _bounds(compiled).tolist(),
        "warnings": list(description.warnings),
        **_variation(description),
    }


def camera_names(description: SceneDescription) -> list[str]:
    """Returns the names of the cameras that `summarise` lists, in the same order."""
    own = [c.name if c.name != AUTO_CAMERA else f"{AUTO_CAMERA} (of the file)" for c in description.cameras]
    return [*own, AUTO_CAMERA]


def camera_dicts(description: SceneDescription, bounds: np.ndarray, points: np.ndarray) -> list[dict[str, Any]]:
    """Returns the cameras in the form used by `summarise`.

    bounds: (2, 3) corners of all geometry. points: (N, 3) that the camera "auto" frames, unless the scene is a room, and without
    the floor around what stands on it; without any points, it frames the bounds. A camera whose picture, as large as the file
    says, shows nothing within the bounds has `sees_nothing`, unless the scene has an environment with light, which it shows, or
    nothing that any camera could see.
    """
    automatic = room_view(description, bounds) or frame(_framed(description, bounds, points), description.up)
    cameras = [*_aimed_cameras(description, bounds), Camera(AUTO_CAMERA, automatic)]
    width, height = (
        int(description.defaults.get(name) or usual) for name, usual in zip(("width", "height"), DEFAULT_SIZE, strict=True)
    )
    world = description.environment
    shows_world = world is not None and world.strength * max(world.color) > 0.0
    corners = None if shows_world or invisible_note(description) else _corners(bounds)
    return [_camera_dict(camera, corners, width / height) for camera in cameras]


def _framed(description: SceneDescription, bounds: np.ndarray, points: np.ndarray) -> np.ndarray:
    points = points if len(points) else _corners(bounds)
    standing = standing_box(description)
    if standing is None:
        return points
    above = within_footprint(description, points, standing)
    return above if len(above) else _corners(standing)


def own_cameras(description: SceneDescription, compiled: CompiledScene) -> list[Camera]:
    """Returns the cameras of the scene file, with the same orbit targets as in `summarise`."""
    return _aimed_cameras(description, _bounds(compiled))


def _aimed_cameras(description: SceneDescription, bounds: np.ndarray) -> list[Camera]:
    names = camera_names(description)
    return [
        Camera(name, _with_orbit_target(c.view, bounds), tuple(_with_orbit_target(view, bounds) for view in c.keys))
        for name, c in zip(names, description.cameras, strict=False)
    ]


def _camera_dict(camera: Camera, corners: np.ndarray | None, aspect: float) -> dict[str, Any]:
    """Returns a camera as JSON, with `views` if it moves while the shutter is open, and with `sees_nothing` if that is so.

    corners: of the scene's bounds, (8, 3); None: any camera sees something. aspect: width of its picture by its height.
    """
    found: dict[str, Any] = {"name": camera.name, "view": _view_dict(camera.view)}
    if camera.keys:
        found["views"] = [_view_dict(view) for view in camera.keys]
    if corners is not None and all(is_out_of_view(corners, view, aspect) for view in (camera.view, *camera.keys)):
        found["sees_nothing"] = True
    return found


def _with_ray_roots(laid: AssembledBvh, stood: PlacedGeometry, seen: Visibility, part: I32) -> AssembledBvh:
    """Returns the tree with root nodes for the kinds of rays that do not see all objects, and for shadow links."""
    if not seen.is_by_kind:
        if (stood.packed.material_flags & (UNSEEN | LAMP | SHADELESS)).any():
            laid = exclude_primitives(laid, _mask_by_flag(stood, UNSEEN), _mask_by_flag(stood, LAMP | SHADELESS))
        return laid
    masks = [_mask_by_flag(stood, flag | LAMP if flag == SHADELESS else flag) for flag in UNSEEN_BY]
    of_triangle = part[stood.joined.triangle[:, 3], PART_OBJECT]
    instances = []
    for blocking in seen.blocking:
        beside = np.append(~blocking, False)  # for parts that are in the trees of instances
        masks.append(
            masks[UNSEEN_BY.index(SHADELESS)]
            | np.concatenate([beside[np.maximum(of_triangle, -1)], ~blocking[np.asarray(stood.sphere_object, np.int64)]])
        )
        instances.append(~blocking[stood.placement.object])
    glossy = RAY_KINDS.index("glossy")
    return exclude_primitives(laid, *masks, instances=instances, copies_root=(glossy,) if seen.lights_differ else ())


def _mask_by_flag(stood: PlacedGeometry, flag: int) -> np.ndarray:
    """Returns a mask (T + S,) of the triangles, then the spheres, whose material has the flag."""
    is_of = stood.packed.material_flags & flag != 0
    geometry = stood.joined.geometry
    return np.concatenate([by_triangle(geometry, is_of[geometry.material]), is_of[stood.sphere_material]])


def _suns(primitive: I32, kind: I32, bodies: int) -> I32:
    """Returns the indices of those lights that are suns.

    primitive: of each light. kind: of each punctual light. bodies: number of triangles and spheres, after which punctual lights
    are numbered.
    """
    number = primitive.astype(np.int64) - bodies
    is_sun = np.isin(kind, (SUN, SUN_UNSEEN))
    return (
        np.flatnonzero((number >= 0) & is_sun[np.maximum(number, 0)]).astype(np.int32) if is_sun.any() else np.zeros(0, np.int32)
    )


def _count_emitters_without_area(description: SceneDescription, emitted: np.ndarray) -> int:
    """Returns the number of the description's emissive triangles without area, which emit nothing.

    They are counted in the description, since the compiled geometry omits static triangles without area.
    """
    count = 0
    for instance in description.instances:
        mesh = description.meshes[instance.mesh]
        if emitted[mesh.material if instance.material is None else instance.material] > 0:
            a, b, c = (mesh.positions[mesh.triangles[:, k]].astype(np.float64) for k in range(3))
            count += int((~np.cross(b - a, c - a).any(axis=1)).sum())
    return count


def _part_rows(geometry: Geometry, emitting: np.ndarray) -> I32:
    part = np.zeros((len(geometry.material), PART_COLUMNS), np.int32)
    part[:, PART_MATERIAL] = geometry.material
    part[:, PART_OBJECT] = geometry.object
    part[np.unique(np.searchsorted(geometry.first, emitting, "right") - 1), PART_SHINES] = 1
    return part


def _padding_triangles(compiled: CompiledScene) -> int:
    """Returns the number of padding triangles: they fill the arrays up to the next memory page and contain no geometry."""
    first = np.searchsorted(compiled.triangle[:, 3], np.arange(len(compiled.part) + 1))
    return int(np.diff(first)[compiled.part[:, PART_OBJECT] == NO_PLACEMENT].sum())


def _bounds(compiled: CompiledScene) -> np.ndarray:
    """Returns the world-space bounds of all geometry: (2, 3) f64 corners."""
    return compiled.bounds.astype(np.float64) + compiled.origin


def _corners(bounds: np.ndarray) -> np.ndarray:
    """Returns the corners (8, 3) of bounds (2, 3)."""
    low, high = np.asarray(bounds, np.float64)
    return np.array([np.where(which, high, low) for which in np.ndindex(2, 2, 2)])


def _visible_points(compiled: CompiledScene, without: int | None) -> np.ndarray:
    """Returns points (N, 3) on the surfaces, in the compiled scene's space; N is bounded.

    without: the number of an object that is left out."""
    first = np.searchsorted(compiled.triangle[:, 3], np.arange(len(compiled.part) + 1))
    number = compiled.part[:, PART_OBJECT]
    in_world = [
        np.arange(first[p], first[p + 1])
        for p in np.flatnonzero((number >= 0) & (number != (-1 if without is None else without)))
    ]
    world = np.concatenate([np.zeros(0, np.int64), *in_world])
    points = [compiled.position[compiled.triangle[world[:: max(len(world) // 50_000, 1)], :3].reshape(-1)]]
    directions = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)])
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    for x, y, z, radius in compiled.sphere[:2000]:
        points.append(np.array([x, y, z]) + radius * directions)
    shapes = {root: _tree_corners(compiled, root) for root in np.unique(compiled.bvh.instance_root)}
    for root, transform in zip(compiled.bvh.instance_root[:10_000], compiled.to_world, strict=False):
        points.append(shapes[root] @ transform[:, :3].T + transform[:, 3])
    return np.concatenate(points)


def _tree_corners(compiled: CompiledScene, root: int) -> np.ndarray:
    """Returns the corners of the up to eight child boxes of an instance's BVH root, (n, 3), in the instance's own space.

    root: index of the root node."""
    node = compiled.bvh.node[root]
    boxes = [node[:6, lane].reshape(3, 2) for lane in np.flatnonzero(node[0] <= node[1])]
    return np.array([np.where(which, box[:, 1], box[:, 0]) for box in boxes for which in np.ndindex(2, 2, 2)]).reshape(-1, 3)


def _with_orbit_target(view: View, bounds: np.ndarray) -> View:
    """Returns the view with its target moved along the line of sight to the point nearest to the scene's centre.

    That makes the target a useful centre for orbiting. The focus distance stays the same.
    """
    eye, target = np.array(view.eye), np.array(view.target)
    forward = (target - eye) / np.linalg.norm(target - eye)
    distance = float((bounds.mean(axis=0) - eye) @ forward)
    if distance <= 1e-3 * float(np.linalg.norm(bounds[1] - bounds[0])):
        return view
    x, y, z = (float(c) for c in eye + forward * distance)
    focus = view.focus
    if focus is None and view.aperture > 0:  # preserves the focus distance
        focus = float(np.linalg.norm(target - eye))
    return replace(view, target=(x, y, z), focus=focus)


def _view_dict(view: View) -> dict[str, Any]:
    return {key: list(value) if isinstance(value, tuple) else value for key, value in view.to_json().items()}
