"""A plain triangle mesh of a scene description, which a viewer draws until there are path-traced samples.

It is computed as soon as a file has been read, before the scene is compiled.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.image.tonemap import decode_srgb, encode_srgb
from renderer.scene.curve_meshes import has_curves, round_tubes
from renderer.scene.description import Image, Instance, Material, Mesh, SceneDescription, Texture
from renderer.scene.studio import STUDIO

__all__ = ["MOST_TRIANGLES", "Preview", "preview"]

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
U8 = npt.NDArray[np.uint8]

MOST_TRIANGLES = 1_000_000
FEWEST = 24  # triangles of a decimated mesh
TEXTURED_VERTICES = 50_000  # coarser textured meshes are subdivided, since colours are those of vertices
MOST_ROUNDS = 6  # of subdivision
MOST_INSTANCES = 50_000  # further instances are not shown
MOST_SPHERES = 2_000
RINGS = 12  # of a sphere
METAL = (0.7, 0.7, 0.7)  # conductors have no base colour
SHADED, UNSHADED = 255, 0


class Preview(NamedTuple):
    """The preview's triangles in world space, with the fields of protocol.mesh.Mesh."""

    positions: F64  # (V, 3)
    normals: F32  # (V, 3)
    colors: U8  # (V, 4)
    triangles: npt.NDArray[np.uint32]  # (T, 3)
    background: tuple[int, int, int] | None = None  # of the world


class _Shape(NamedTuple):
    """A decimated mesh in its own space, with the index of the original vertex of each of its vertices."""

    positions: F64
    normals: F32
    triangles: npt.NDArray[np.int64]
    vertices: npt.NDArray[np.int64]  # of the mesh, for its colours and UVs


def preview(
    description: SceneDescription, max_triangles: int = MOST_TRIANGLES, textured_vertices: int = TEXTURED_VERTICES
) -> Preview | None:
    """Returns the scene's triangles, decimated to about `max_triangles`; None if it has no surface.

    textured_vertices: limit up to which the vertices of textured meshes, whose colours are per vertex, are subdivided.
    """
    meshes = [_tubes_of_some(mesh, max_triangles) if has_curves(mesh) else mesh for mesh in description.meshes]
    description = replace(description, meshes=meshes)
    shown = description.instances if description.subject is None else description.instances[:-1]  # without the studio's floor
    used = [each for each in shown if len(description.meshes[each.mesh].triangles)]
    used = used[:: -(-len(used) // MOST_INSTANCES) or 1]
    share = max_triangles / max(sum(len(description.meshes[each.mesh].triangles) for each in used), 1)
    meshes = _subdivided(description, used, textured_vertices)
    shapes: dict[int, _Shape] = {}
    colors: dict[tuple[int, int], U8] = {}
    parts: list[Preview] = []
    for instance in used:
        mesh = meshes[instance.mesh]
        number, material = _material(description, instance)
        if material.kind == "interface":
            continue
        if instance.mesh not in shapes:
            shapes[instance.mesh] = _shape(mesh, share)
        shape = shapes[instance.mesh]
        if (instance.mesh, number) not in colors:
            colors[instance.mesh, number] = _colors(mesh, shape, material, description)
        to_world = np.asarray(instance.transform, np.float64)
        positions = shape.positions @ to_world[:3, :3].T + to_world[:3, 3]
        normals = _unit(shape.normals @ _cofactors(to_world[:3, :3]).T)
        parts.append(Preview(positions, normals, colors[instance.mesh, number], shape.triangles.astype(np.uint32)))
    parts += _spheres(description)
    joined = _joined(parts)
    return joined and joined._replace(background=_background(description))


def _tubes_of_some(mesh: Mesh, most: int) -> Mesh:
    """Returns a mesh of curves as tubes of three sides, of every n-th segment, so that they have at most `most` triangles."""
    step = -(-len(mesh.triangles) * 6 // most) or 1
    return round_tubes(replace(mesh, triangles=mesh.triangles[::step]), 3)


def _material(description: SceneDescription, instance: Instance) -> tuple[int, Material]:
    """Returns the number and the material of an instance; the default one if there is none of that number."""
    number = description.meshes[instance.mesh].material if instance.material is None else instance.material
    return number, description.materials[number] if number < len(description.materials) else Material()


def _subdivided(description: SceneDescription, used: list[Instance], most: int) -> list[Mesh]:
    """Returns the scene's meshes, the textured ones of `used` with more vertices, at most `most` of them."""
    textured = [each.mesh for each in used if _is_textured(description, each)]
    meshes = list(description.meshes)
    for _ in range(MOST_ROUNDS):
        if 2 * sum(len(meshes[number].triangles) for number in textured) > most:  # a quick check
            break
        halved = {number: _halved(meshes[number]) for number in set(textured)}
        if sum(len(halved[number].positions) for number in textured) > most:
            break
        meshes = [halved.get(number, mesh) for number, mesh in enumerate(meshes)]
    return meshes


def _is_textured(description: SceneDescription, instance: Instance) -> bool:
    _, material = _material(description, instance)
    texture = material.emission_texture if max(material.emission) > 0.0 else material.base_color_texture
    return texture is not None and description.meshes[instance.mesh].uvs is not None


def _halved(mesh: Mesh) -> Mesh:
    """Returns the mesh with its edges halved, four triangles for each. New vertices follow the old ones."""
    corners = mesh.triangles.astype(np.int64)
    edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    keys, number = np.unique(edges[:, 0] * len(mesh.positions) + edges[:, 1], return_inverse=True)
    ends = np.column_stack(np.divmod(keys, len(mesh.positions)))
    ab, bc, ca = (len(mesh.positions) + number.reshape(-1, 3)).T
    a, b, c = corners.T
    triangles = np.concatenate([np.column_stack(each) for each in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])

    def with_middles(values: npt.NDArray[Any] | None) -> npt.NDArray[Any] | None:
        return None if values is None else np.concatenate([values, values[ends].mean(axis=1, dtype=values.dtype)])

    positions = with_middles(mesh.positions)
    assert positions is not None
    uvs, uvs1, colors = with_middles(mesh.uvs), with_middles(mesh.uvs1), with_middles(mesh.colors)
    normals = None if mesh.normals is None else with_middles(_unit(mesh.normals))
    return replace(
        mesh, positions=positions, triangles=triangles.astype(np.int32), normals=normals, uvs=uvs, uvs1=uvs1, colors=colors
    )


def _background(description: SceneDescription) -> tuple[int, int, int] | None:
    """Returns the world's colour around the horizon, sRGB; None for the studio and for skies."""
    environment = description.environment
    if environment is None:
        return None if description.studio_for_accents else (0, 0, 0)
    if environment.sky is not None:
        return None
    color = environment.strength * np.asarray(environment.color, np.float64)
    if environment.image is not None:
        image = description.images[environment.image]
        if image.name == STUDIO:
            return None
        rows = len(image.pixels)
        color = color * image.pixels[rows // 4 : -(-3 * rows // 4), ::8, :3].mean(axis=(0, 1), dtype=np.float64)
    red, green, blue = np.rint(255 * encode_srgb(np.clip(np.nan_to_num(color), 0, 1).astype(np.float32))).astype(int).tolist()
    return red, green, blue


def _joined(parts: list[Preview]) -> Preview | None:
    parts = [part for part in parts if len(part.positions) and np.isfinite(part.positions).all()]
    if not parts:
        return None
    starts = np.cumsum([0, *(len(part.positions) for part in parts[:-1])])
    triangles = np.concatenate([part.triangles + np.uint32(start) for part, start in zip(parts, starts, strict=True)])
    positions = np.concatenate([part.positions for part in parts])
    normals = np.concatenate([part.normals for part in parts])
    return Preview(positions, normals, np.concatenate([part.colors for part in parts]), triangles)


def _shape(mesh: Mesh, share: float) -> _Shape:
    positions = np.asarray(mesh.positions, np.float64)
    normals = np.zeros((len(positions), 3), np.float32) if mesh.normals is None else _unit(mesh.normals)
    shape = _Shape(positions, normals, mesh.triangles.astype(np.int64), np.arange(len(positions)))
    target = max(int(share * len(mesh.triangles)), FEWEST)
    cells = 2.0 * np.sqrt(target)  # along the longest side: a closed surface crosses about cells ** 2 of them
    while len(shape.triangles) > target and cells >= 2.0:
        shape = _clustered(positions, normals, mesh.triangles, cells)
        cells *= 0.8 * np.sqrt(target / max(len(shape.triangles), 1)) if len(shape.triangles) > target else 1.0
    return shape


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
    _, kept = np.unique(np.sort(corners, axis=1), axis=0, return_index=True)
    return _Shape(positions[first], normals[first], corners[kept], first)


def _colors(mesh: Mesh, shape: _Shape, material: Material, description: SceneDescription) -> U8:
    """Returns the colours of a shape's vertices: (V, 4)."""
    emits = max(material.emission) > 0.0
    base, texture = material.base_color, material.base_color_texture
    if material.kind == "conductor":
        base = METAL
    if emits:
        base, texture = material.emission, material.emission_texture
    color = np.tile(np.asarray(base, np.float32), (len(shape.vertices), 1))
    if texture is not None and mesh.uvs is not None and texture < len(description.textures):
        color *= _nearest_texels(description.textures[texture], description.images, mesh, shape.vertices)
    if mesh.colors is not None and not emits:
        color *= mesh.colors[shape.vertices, :3]
    shading = UNSHADED if emits or material.kind == "unlit" else SHADED
    coded = np.rint(encode_srgb(np.clip(np.nan_to_num(color), 0.0, 1.0)) * 255.0).astype(np.uint8)
    return np.column_stack([coded, np.full(len(coded), shading, np.uint8)])


def _nearest_texels(texture: Texture, images: list[Image], mesh: Mesh, vertices: npt.NDArray[np.int64]) -> F32:
    """Returns a texture's nearest texels at the given vertices: linear (V, 3). All wrap modes are treated as repeat."""
    uvs = mesh.uvs1 if texture.uv_set == 1 and mesh.uvs1 is not None else mesh.uvs
    assert uvs is not None
    image = images[texture.image]
    a, b, c, d, e, f = texture.transform
    u, v = np.nan_to_num(uvs[vertices].astype(np.float64)).T
    height, width = image.pixels.shape[:2]
    column = np.mod(a * u + b * v + c, 1.0) * width
    row = np.mod(d * u + e * v + f, 1.0) * height
    texel = image.pixels[row.astype(np.int64).clip(0, height - 1), column.astype(np.int64).clip(0, width - 1), :3]
    if image.pixels.dtype.kind == "f":
        return texel.astype(np.float32)
    shares = texel.astype(np.float32) / np.float32(np.iinfo(image.pixels.dtype).max)
    return decode_srgb(shares).astype(np.float32) if image.srgb else shares


def _spheres(description: SceneDescription) -> list[Preview]:
    polar = np.linspace(0.0, np.pi, RINGS + 1)
    around = np.linspace(0.0, 2.0 * np.pi, 2 * RINGS, endpoint=False)
    theta, phi = (each.reshape(-1) for each in np.meshgrid(polar, around, indexing="ij"))
    unit = np.column_stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)])
    ring, step = (each.reshape(-1) for each in np.meshgrid(np.arange(RINGS), np.arange(2 * RINGS), indexing="ij"))
    a = ring * 2 * RINGS + step
    b = ring * 2 * RINGS + (step + 1) % (2 * RINGS)
    triangles = np.concatenate([np.column_stack([a, b, a + 2 * RINGS]), np.column_stack([b, b + 2 * RINGS, a + 2 * RINGS])])
    shape = _Shape(unit, unit.astype(np.float32), triangles, np.zeros(len(unit), np.int64))
    plain = Mesh("sphere", np.zeros((1, 3), np.float32), np.zeros((0, 3), np.int32))
    found = []
    for sphere in description.spheres[:MOST_SPHERES]:
        material = description.materials[sphere.material] if sphere.material < len(description.materials) else Material()
        if material.kind != "interface":
            color = _colors(plain, shape, material, description)
            found.append(
                Preview(np.asarray(sphere.center) + sphere.radius * unit, shape.normals, color, triangles.astype(np.uint32))
            )
    return found


def _cofactors(matrix: F64) -> F64:
    """Returns the cofactor matrix of a transform, which transforms normals. It exists for singular matrices too."""
    x, y, z = matrix.T
    return np.column_stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)])


def _unit(vectors: npt.NDArray[Any]) -> F32:
    """Returns the vectors normalised to length 1; vectors of length 0 remain 0."""
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(np.where(size > 0.0, vectors / size, 0.0)).astype(np.float32)
