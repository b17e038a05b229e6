"""A plain triangle mesh of a scene description, which a viewer draws until there are path-traced samples.

It is computed as soon as a file has been read, before the scene is compiled.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.image.tonemap import encode_srgb
from renderer.preview_mesh import NO_TEXTURE, PreviewLamp, PreviewMaterial, PreviewMesh, PreviewPart
from renderer.scene.curve_meshes import has_curves, round_tubes
from renderer.scene.description import Instance, Material, Mesh, SceneDescription, Sphere
from renderer.scene.preview_light import (
    emitted_power,
    environment_texels,
    is_studio,
    lamp_of_mesh,
    lamp_of_sphere,
    lamps_of,
    strongest,
)
from renderer.scene.preview_materials import PreviewSurface, preview_surface
from renderer.scene.preview_textures import Textures

__all__ = ["MOST_MATERIALS", "MOST_TRIANGLES", "preview"]

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]

MOST_TRIANGLES = 300_000
FEWEST = 24  # triangles of a decimated mesh
MOST_INSTANCES = 50_000  # further instances are not shown
MOST_SPHERES = 2_000
MOST_EMITTERS = 1_000  # further ones light nothing
MOST_MATERIALS = 1_000  # further ones show their colour only
RINGS, FEWEST_RINGS = 24, 6  # of a sphere, and of a small one among many
SPHERE_SHARE = 0.3  # of all triangles, beyond which small spheres have fewer
HUGE, REACH = 50.0, 12.0  # radius of a wall, and how far it is drawn, by the distance from the camera to it


class _Shape(NamedTuple):
    """A decimated mesh in its own space, with the index of the original vertex of each of its vertices."""

    positions: F64
    normals: F32
    triangles: I64
    vertices: I64  # of the mesh, for its colours and UVs


class _Part(NamedTuple):
    """Triangles in world space, with their material."""

    positions: F64
    normals: F32
    colors: U8
    uvs: F32 | None
    triangles: npt.NDArray[np.uint32]
    material: PreviewMaterial


def preview(description: SceneDescription, max_triangles: int = MOST_TRIANGLES) -> PreviewMesh | None:
    """Returns the scene's triangles, decimated to about `max_triangles`; None if it has no surface."""
    meshes = [_tubes_of_some(mesh, max_triangles) if has_curves(mesh) else mesh for mesh in description.meshes]
    description = replace(description, meshes=meshes)
    shown = description.instances if description.subject is None else description.instances[:-1]  # without the studio's floor
    used = [each for each in shown if len(description.meshes[each.mesh].triangles)]
    used = used[:: -(-len(used) // MOST_INSTANCES) or 1]
    share = max_triangles / max(sum(len(description.meshes[each.mesh].triangles) for each in used), 1)
    textures = Textures(description)
    surfaces = _Surfaces(description, textures)
    shapes: dict[int, _Shape] = {}
    colors: dict[tuple[int, int], U8] = {}
    parts: list[_Part] = []
    lit: list[tuple[F64, I64, F64, Material]] = []
    for instance in used:
        mesh = meshes[instance.mesh]
        number, material = _material(description, instance)
        to_world = np.asarray(instance.transform, np.float64)
        if instance.mesh not in shapes:
            shapes[instance.mesh] = _shape(mesh, share)
        shape = shapes[instance.mesh]
        if max(material.emission) > 0.0 and len(lit) < MOST_EMITTERS:
            lit.append((shape.positions, shape.triangles, to_world, material))
        if material.kind == "interface" or material.unseen:
            continue
        surface = surfaces.of(number, material, mesh, to_world)
        if (instance.mesh, number) not in colors:
            colors[instance.mesh, number] = _colors(mesh, shape, surface)
        positions = shape.positions @ to_world[:3, :3].T + to_world[:3, 3]
        normals = _unit(shape.normals @ _cofactors(to_world[:3, :3]).T)
        uvs = _uvs(mesh, shape, surface)
        parts.append(
            _Part(positions, normals, colors[instance.mesh, number], uvs, shape.triangles.astype(np.uint32), surface.material)
        )
    parts += _spheres(description, surfaces, int(SPHERE_SHARE * max_triangles))
    joined = _joined(parts)
    if joined is None:
        return None
    bounds = np.stack([joined.positions.min(axis=0), joined.positions.max(axis=0)])
    lamps = [*lamps_of(description, bounds), *_emitting_spheres(description, bounds)]
    lamps += [lamp for each in lit if (lamp := lamp_of_mesh(*each, bounds)) is not None]
    emitted = sum(emitted_power(*each) for each in lit)
    in_studio = is_studio(description, emitted, bounds)
    return joined._replace(
        textures=textures.encoded(),
        lamps=strongest(lamps),
        environment=environment_texels(description, in_studio),
        studio=in_studio,
    )


class _Surfaces:
    """The surfaces of a scene's materials, each computed once, for objects as large as the first one that has it."""

    def __init__(self, description: SceneDescription, textures: Textures) -> None:
        self._description, self._textures = description, textures
        self._known: dict[int, PreviewSurface] = {}

    def of(self, number: int, material: Material, mesh: Mesh, to_world: F64) -> PreviewSurface:
        if number not in self._known:
            size = np.abs(to_world[:3, :3]) @ np.ptp(mesh.positions.astype(np.float64), axis=0)
            surface = preview_surface(material, self._description, self._textures, float(size.min()))
            if len(self._known) >= MOST_MATERIALS:
                plain = PreviewMaterial(unlit=material.kind == "unlit", alpha_mode=material.alpha_mode)
                surface = surface._replace(material=plain)
            self._known[number] = surface
        return self._known[number]


def _tubes_of_some(mesh: Mesh, most: int) -> Mesh:
    """Returns a mesh of curves as tubes of three sides, of every n-th segment, so that they have at most `most` triangles."""
    step = -(-len(mesh.triangles) * 6 // most) or 1
    return round_tubes(replace(mesh, triangles=mesh.triangles[::step]), 3)


def _material(description: SceneDescription, instance: Instance) -> tuple[int, Material]:
    """Returns the number and the material of an instance; the default one if there is none of that number."""
    number = description.meshes[instance.mesh].material if instance.material is None else instance.material
    return number, description.materials[number] if number < len(description.materials) else Material()


def _joined(parts: list[_Part]) -> PreviewMesh | None:
    """Joins parts, those of one material one after the other; blended ones last."""
    parts = [part for part in parts if len(part.positions) and np.isfinite(part.positions).all()]
    if not parts:
        return None
    numbers: dict[PreviewMaterial, int] = {}
    for part in parts:
        numbers.setdefault(part.material, len(numbers))
    parts.sort(key=lambda part: numbers[part.material])
    starts = np.cumsum([0, *(len(part.positions) for part in parts[:-1])])
    ends = np.cumsum([3 * len(part.triangles) for part in parts])
    last = {numbers[part.material]: int(end) for part, end in zip(parts, ends, strict=True)}
    firsts = [0, *list(last.values())[:-1]]
    uvs = None
    if any(part.uvs is not None for part in parts):
        uvs = np.concatenate([np.zeros((len(part.positions), 2), np.float32) if part.uvs is None else part.uvs for part in parts])
    return PreviewMesh(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.colors for part in parts]),
        np.concatenate([part.triangles + np.uint32(start) for part, start in zip(parts, starts, strict=True)]),
        uvs,
        tuple(PreviewPart(first, end - first, number) for first, (number, end) in zip(firsts, last.items(), strict=True)),
        tuple(numbers),
    )


def _shape(mesh: Mesh, share: float) -> _Shape:
    positions = np.asarray(mesh.positions, np.float64)
    normals = np.zeros((len(positions), 3), np.float32) if mesh.normals is None else _unit(mesh.normals)
    shape = _Shape(positions, normals, mesh.triangles.astype(np.int64), np.arange(len(positions)))
    target = max(int(share * len(mesh.triangles)), FEWEST)
    cells = 2.0 * np.sqrt(target)  # along the longest side: a closed surface crosses about cells ** 2 of them
    while len(shape.triangles) > target and cells >= 2.0:
        shape = _clustered(positions, normals, mesh.triangles, cells)
        cells *= 0.8 * np.sqrt(target / max(len(shape.triangles), 1)) if len(shape.triangles) > target else 1.0
    return _of_corners(shape)


def _of_corners(shape: _Shape) -> _Shape:
    """Returns a shape without the vertices that no triangle has: instances of few triangles may have millions of them."""
    used = np.zeros(len(shape.positions), np.bool_)
    used[shape.triangles] = True
    if used.all():
        return shape
    numbers = np.cumsum(used) - 1
    return _Shape(shape.positions[used], shape.normals[used], numbers[shape.triangles], shape.vertices[used])


def _clustered(positions: F64, normals: F32, triangles: npt.NDArray[Any], cells: float) -> _Shape:
    """Decimates a mesh: replaces all vertices in a cell of a grid by one of them (Rossignac and Borrel 1993)."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    size = max(float((high - low).max()), 1e-30) / cells
    cell = ((positions - low) / size).astype(np.int64)
    side = int(cells) + 2
    _, first, number = np.unique((cell[:, 0] * side + cell[:, 1]) * side + cell[:, 2], return_index=True, return_inverse=True)
    corners = number.reshape(-1)[triangles]
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    ordered = np.sort(corners, axis=1)
    if len(first) < 1 << 21:  # three numbers fit into 63 bits, which are sorted faster
        _, kept = np.unique((ordered[:, 0] << 42) | (ordered[:, 1] << 21) | ordered[:, 2], return_index=True)
    else:
        _, kept = np.unique(ordered, axis=0, return_index=True)
    return _Shape(positions[first], normals[first], corners[kept], first)


def _colors(mesh: Mesh, shape: _Shape, surface: PreviewSurface) -> U8:
    """Returns the colours and opacities of a shape's vertices: (V, 4)."""
    color = np.tile(np.asarray((*surface.color, surface.opacity), np.float32), (len(shape.vertices), 1))
    if mesh.colors is not None:
        color *= mesh.colors[shape.vertices]
    if surface.material.alpha_mode == "opaque":
        color[:, 3] = 1.0
    color = np.clip(np.nan_to_num(color), 0.0, 1.0)
    color[:, :3] = encode_srgb(color[:, :3])
    return np.rint(255.0 * color).astype(np.uint8)


def _uvs(mesh: Mesh, shape: _Shape, surface: PreviewSurface) -> F32 | None:
    """Returns the UVs of a shape's vertices, transformed as its textures are: (V, 2); None if it shows no textures."""
    uvs = mesh.uvs1 if surface.uv_set == 1 and mesh.uvs1 is not None else mesh.uvs
    material = surface.material
    if uvs is None or max(material.texture, material.metallic_roughness_texture, material.emission_texture) == NO_TEXTURE:
        return None
    a, b, c, d, e, f = surface.transform
    u, v = np.nan_to_num(uvs[shape.vertices].astype(np.float64)).T
    return np.column_stack([a * u + b * v + c, d * u + e * v + f]).astype(np.float32)


def _spheres(description: SceneDescription, surfaces: _Surfaces, max_triangles: int) -> list[_Part]:
    unit = _ball(RINGS)
    ball = Mesh("sphere", unit.positions.astype(np.float32), unit.triangles.astype(np.int32))
    shown = []
    for sphere in description.spheres[:MOST_SPHERES]:
        material = _material_of_sphere(description, sphere)
        if material.kind != "interface" and not material.unseen:
            shown.append((sphere, material, _near_cap(description, sphere)))
    rings = _rings(np.array([sphere.radius for sphere, _, cap in shown if cap is None]), max_triangles)
    shapes = {count: _ball(count) for count in set(rings)}
    each_rings = iter(rings)
    found = []
    for sphere, material, cap in shown:
        surface = surfaces.of(sphere.material, material, ball, sphere.radius * np.eye(4))
        shape = shapes[next(each_rings)] if cap is None else cap
        positions = np.asarray(sphere.center) + sphere.radius * shape.positions
        color = _colors(ball, shape, surface)
        found.append(_Part(positions, shape.normals, color, None, shape.triangles.astype(np.uint32), surface.material))
    return found


def _rings(radii: F64, max_triangles: int) -> list[int]:
    """Returns into how many rings spheres are divided: fewer for smaller ones if they have more than `max_triangles` together.

    A polygon of n sides deviates from a circle by its radius over n squared: the number of rings follows the root of the radius.
    """
    rings = np.full(len(radii), RINGS)
    if not len(radii):
        return []
    roots = np.sqrt(np.maximum(radii, 1e-6 * radii.max()) / radii.max())
    scale = RINGS / float(roots.min())
    while 4 * int((rings**2).sum()) > max_triangles and rings.max() > FEWEST_RINGS:
        scale *= 0.9
        rings = np.clip(np.rint(scale * roots).astype(np.int64), FEWEST_RINGS, RINGS)
    return [int(count) for count in rings]


@cache
def _ball(rings: int) -> _Shape:
    """Returns a unit sphere of `rings` rings, each of 2 * `rings` segments."""
    polar = np.linspace(0.0, np.pi, rings + 1)
    around = np.linspace(0.0, 2.0 * np.pi, 2 * rings, endpoint=False)
    theta, phi = (each.reshape(-1) for each in np.meshgrid(polar, around, indexing="ij"))
    unit = np.column_stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)])
    ring, step = (each.reshape(-1) for each in np.meshgrid(np.arange(rings), np.arange(2 * rings), indexing="ij"))
    a = ring * 2 * rings + step
    b = ring * 2 * rings + (step + 1) % (2 * rings)
    triangles = np.concatenate([np.column_stack([a, a + 2 * rings, b]), np.column_stack([b, a + 2 * rings, b + 2 * rings])])
    return _Shape(unit, unit.astype(np.float32), triangles, np.zeros(len(unit), np.int64))


def _near_cap(description: SceneDescription, sphere: Sphere) -> _Shape | None:
    """Returns the part of a unit sphere near the camera, if it is so large that it is a wall or the ground; else None."""
    if not description.cameras:
        return None
    way = np.asarray(description.cameras[0].view.eye, np.float64) - np.asarray(sphere.center)
    away = float(np.linalg.norm(way))
    gap = abs(away - sphere.radius)
    if sphere.radius < HUGE * gap or gap == 0.0:
        return None
    axis = way / away
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    across /= np.linalg.norm(across)
    theta = np.repeat(np.geomspace(0.02, REACH, RINGS) * gap / sphere.radius, 2 * RINGS)[:, None]
    phi = np.tile(np.linspace(0.0, 2.0 * np.pi, 2 * RINGS, endpoint=False), RINGS)[:, None]
    rim = np.cos(theta) * axis + np.sin(theta) * (np.cos(phi) * across + np.sin(phi) * np.cross(axis, across))
    ring, step = (each.reshape(-1) for each in np.meshgrid(np.arange(RINGS - 1), np.arange(2 * RINGS), indexing="ij"))
    a = ring * 2 * RINGS + step
    b = ring * 2 * RINGS + (step + 1) % (2 * RINGS)
    first = np.arange(2 * RINGS)
    centre = np.column_stack([np.full(len(first), len(rim)), first, np.roll(first, -1)])
    triangles = np.concatenate(
        [centre, np.column_stack([a, a + 2 * RINGS, b]), np.column_stack([b, a + 2 * RINGS, b + 2 * RINGS])]
    )
    positions = np.vstack([rim, axis])
    return _Shape(positions, positions.astype(np.float32), triangles, np.zeros(len(positions), np.int64))


def _emitting_spheres(description: SceneDescription, bounds: F64) -> list[PreviewLamp]:
    """Returns the spheres that shine as lamps. bounds: (2, 3), of what is seen."""
    found = []
    for sphere in description.spheres[:MOST_EMITTERS]:
        material = _material_of_sphere(description, sphere)
        if max(material.emission) > 0.0:
            found.append(lamp_of_sphere(sphere, material, bounds))
    return found


def _material_of_sphere(description: SceneDescription, sphere: Sphere) -> Material:
    return description.materials[sphere.material] if sphere.material < len(description.materials) else Material()


def _cofactors(matrix: F64) -> F64:
    """Returns the cofactor matrix of a transform, which transforms normals. It exists for singular matrices too."""
    x, y, z = matrix.T
    return np.column_stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)])


def _unit(vectors: npt.NDArray[Any]) -> F32:
    """Returns the vectors normalised to length 1; vectors of length 0 remain 0."""
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(np.where(size > 0.0, vectors / size, 0.0)).astype(np.float32)
