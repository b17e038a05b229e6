"""Reads Wavefront OBJ files: polygons, groups and materials.

Makes one mesh per material; if the file has no normals, smooth ones are computed.
"""

from __future__ import annotations

import re
from pathlib import PurePosixPath

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.deduplicate import unique_threes
from renderer.scene.description import F32, I32, Instance, Mesh, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.normals import smoothed_together
from renderer.scene.origin import in_exact_type
from renderer.scene.polygons import Triangulation
from renderer.scene.readers.colors import vertex_colors
from renderer.scene.readers.mtl import without_comment
from renderer.scene.readers.obj_lines import Statements, parse
from renderer.scene.readers.obj_materials import Materials
from renderer.scene.readers.polygon_meshes import triangulated
from renderer.scene.text_encoding import as_utf8
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["read"]

_EVERY_EDGE = 181.0
MAX_BYTES = 400 << 20  # of text; the arrays take about as much again


def read(files: SceneFiles, main: str, description: SceneDescription) -> None:
    """Adds the file's meshes and materials to the description. Raises SceneError if the file is damaged or too large."""
    data = files.read(main)
    if len(data) > MAX_BYTES:
        raise SceneError(
            Sentence(
                "obj-file-too-large",
                "{file} has {mib} MiB; an OBJ has at most {most}. Export it as .glb or binary .ply",
                file=main,
                mib=len(data) >> 20,
                most=MAX_BYTES >> 20,
            )
        )
    text = as_utf8(data)
    try:
        said = parse(text, main)
    except SceneError as error:
        mended = _normalized_numbers(text)
        if mended == text:
            raise
        try:
            said = parse(mended, main)
        except SceneError:
            raise error from None
        changed = sum(a != b for a, b in zip(text.split(b"\n"), mended.split(b"\n"), strict=True))
        description.warnings.append(
            Sentence(
                "obj-decimal-commas",
                "{file}: {count} lines have decimal commas or words in place of numbers; they are read as far as possible.",
                file=main,
                count=changed,
            )
        )
    shelf = TextureShelf(description, files)
    if said.colors is None and b"#MRGB" in text:
        said = said._replace(colors=_polypaint(text, len(said.positions)))
        if said.colors is None:
            shelf.warn_of_surface(
                Sentence(
                    "obj-painted-colours-too-few",
                    "{file} has fewer painted colours (#MRGB) than vertices; they are left out.",
                    file=main,
                )
            )
    elif said.colors is not None:
        said = said._replace(colors=_scaled_colors(said.colors, main, shelf))
    said = said._replace(positions=in_exact_type(said.positions))
    said.uvs[:, 1] = 1 - said.uvs[:, 1]  # OBJ measures v from the image's lower edge
    if said.lost:
        shelf.warn(
            Sentence(
                "obj-corner-references-dropped",
                "{file}: {count} corners of faces refer to normals or texture coordinates that are "
                "missing or not finite; they are read without them.",
                file=main,
                count=said.lost,
            )
        )
    materials = Materials(main, said, files, shelf, description)
    cut = triangulated(np.diff(said.starts), said.corners[:, 0], said.positions, main, shelf)
    stretches = _faces_by_material(said)
    order, begins = _groups(said, cut, list(stretches.values()))
    title = PurePosixPath(main).stem
    made = _meshes([name or title for name in stretches], said, cut, order, begins)
    shown = list[tuple[Mesh, npt.NDArray[np.int64]]]()
    for i, name in enumerate(stretches):
        groups = [group for group in (2 * i, 2 * i + 1) if begins[group] < begins[group + 1]]
        if not groups:
            continue
        number = materials.number(name, [made[group] for group in groups])
        for group in groups:
            mesh = made[group]
            mesh.material = number
            if name and description.materials[number].name == without_comment(name):
                mesh.name = without_comment(name)
            shown.append((mesh, order[begins[group] : begins[group + 1]]))
    for mesh in _with_missing_normals(said, cut, [mesh for mesh, _ in shown], [triangles for _, triangles in shown]):
        description.meshes.append(mesh)
        description.instances.append(Instance(len(description.meshes) - 1, name=mesh.name))
    if said.others:
        shelf.warn(
            Sentence(
                "obj-lines-points-dropped",
                "{file}: {count} lines, points or curves have no surface and are left out.",
                file=main,
                count=said.others,
            )
        )


def _scaled_colors(colors: F32, main: str, shelf: TextureShelf) -> F32:
    """Returns (V, 3) sRGB colours in 0..1, white for vertices without a colour.

    If any value exceeds 1, all are divided by 255, or by 65535 if any exceeds 255.
    """
    bare = np.isnan(colors)
    if count := int(bare.any(axis=1).sum()):
        shelf.warn_of_surface(
            Sentence(
                "obj-vertices-without-colour",
                "{file}: {count} of {total} vertices have no colour; they are shown white.",
                file=main,
                count=count,
                total=len(colors),
            )
        )
    highest = float(colors[~bare].max(initial=0.0))
    if highest > 1:
        most = 255.0 if highest <= 255 else 65535.0
        shelf.warn_of_surface(
            Sentence(
                "obj-vertex-colours-scaled",
                "{file}: its vertex colours go up to {highest}; they are divided by {scale}.",
                file=main,
                highest=f"{highest:g}",
                scale=f"{most:g}",
            )
        )
        colors = colors / np.float32(most)
    return np.where(bare, np.float32(1), colors)


def _polypaint(text: bytes, vertices: int) -> F32 | None:
    """Returns (V, 3) sRGB from ZBrush's #MRGB comments; None if incomplete.

    They contain a mask, red, green and blue per vertex, in hexadecimal.
    """
    digits = b"".join(re.findall(rb"(?m)^#MRGB[ \t]+([0-9a-fA-F]+)", text))
    if len(digits) < 8 * vertices:
        return None
    codes = np.frombuffer(bytes.fromhex(digits[: 8 * vertices].decode()), np.uint8).reshape(-1, 4)
    return codes[:, 1:].astype(np.float32) / np.float32(255)


def _with_missing_normals(
    statements: Statements, cut: Triangulation, meshes: list[Mesh], triangles: list[npt.NDArray[np.int64]]
) -> list[Mesh]:
    """Returns the meshes with missing normals computed.

    In files with smoothing groups, normals are smooth within each group of an object (`s off` is no group). In other files they
    are smooth over edges with small angles, across materials.
    """
    if all(mesh.normals is not None for mesh in meshes):
        return meshes
    if not statements.smooth:
        return smoothed_together(meshes, surfaces=[0] * len(meshes))
    count = len(statements.starts) - 1
    numbers = {"": 0, "0": 0, "off": 0}
    begins, groups = [0], [0]
    for face, name in statements.smooth:
        word = next(iter(without_comment(name).lower().split()), "")
        begins.append(face)
        groups.append(numbers.setdefault(word, len(numbers)))
    group = np.repeat(groups, np.diff([*begins, count]))
    if not group.any() and not len(statements.normals):
        return meshes  # flat, without normals
    part = np.zeros(count, np.int64)
    np.add.at(part, [face for face in statements.objects if face < count], 1)
    _, surface = np.unique(np.cumsum(part) * len(numbers) + group, return_inverse=True)
    surface = np.where(group > 0, surface, count + np.arange(count)).astype(np.int32)  # each flat face is its own surface
    if (surface == surface[0]).all():
        return smoothed_together(meshes, _EVERY_EDGE, surfaces=[0] * len(meshes))
    return smoothed_together(meshes, _EVERY_EDGE, [np.asarray(surface[cut.face[some]], np.int32) for some in triangles])


def _normalized_numbers(text: bytes) -> bytes:
    """Returns the text with decimal points for commas, and `nan` for the non-numbers of C runtimes, such as 1.#QNAN."""

    def line(found: re.Match[bytes]) -> bytes:
        numbers = re.sub(rb"(?<=\d),(?=\d)", b".", found[2])
        numbers = re.sub(rb"(?<=[\d.])[dD](?=[-+]?\d)", b"e", numbers)
        numbers = re.sub(rb"(?i)(?<![\w.])[-+]?(?:\d\.?#\w+|nan(?:\(\w*\))?|inf(?:inity)?)(?![\w.])", b"nan", numbers)
        return found[1] + numbers

    return re.sub(rb"(?m)^(v[nt]?)([ \t][^\r\n]*)", line, text)


def _faces_by_material(statements: Statements) -> dict[str | None, npt.NDArray[np.int64]]:
    """Returns the indices of each material's faces, by material name; None is the key of faces before the first material."""
    ends = [face for face, _ in statements.materials[1:]] + [len(statements.starts) - 1]
    stretches: list[tuple[str | None, int, int]] = [(None, 0, statements.materials[0][0] if statements.materials else ends[0])]
    stretches += [(name, face, end) for (face, name), end in zip(statements.materials, ends, strict=False)]
    found: dict[str | None, list[npt.NDArray[np.int64]]] = {}
    for name, first, last in stretches:
        found.setdefault(name, []).append(np.arange(first, last))
    return {name: np.concatenate(parts) for name, parts in found.items()}


def _groups(
    statements: Statements, cut: Triangulation, stretches: list[npt.NDArray[np.int64]]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Divides each of S sets of faces into two groups of triangles: those with normals at all corners, and the others.

    stretches: S arrays of face indices. Returns the triangle indices sorted by group, and (2 S + 1,) the start of each group
    there.
    """
    begins = np.searchsorted(cut.face, np.arange(len(statements.starts)))
    faces = np.concatenate(stretches)
    stretch = np.repeat(np.arange(len(stretches)), [len(each) for each in stretches])
    count = begins[faces + 1] - begins[faces]
    triangles = np.repeat(begins[faces] - (np.cumsum(count) - count), count) + np.arange(int(count.sum()))
    is_bare = (statements.corners[cut.triangles[triangles], 2] < 0).any(axis=1)
    group = 2 * np.repeat(stretch, count) + is_bare
    order = np.argsort(group, kind="stable")
    return triangles[order], np.searchsorted(group[order], np.arange(2 * len(stretches) + 1))


def _meshes(
    names: list[str], statements: Statements, cut: Triangulation, order: npt.NDArray[np.int64], begins: npt.NDArray[np.int64]
) -> list[Mesh]:
    """Returns a mesh per group of triangles (see `_groups`); vectorised, since files may have a hundred thousand small groups."""
    corners = statements.corners[cut.triangles[order].reshape(-1)]
    group = np.repeat(np.arange(len(begins) - 1, dtype=np.int32), 3 * np.diff(begins))
    corners[group % 2 == 1, 2] = -1
    first, number = unique_threes(corners)
    if len(order) and group[0] != group[-1]:
        first, number = unique_threes(np.column_stack([number, group, np.zeros_like(group)]))
    vertices, starts = corners[first], np.searchsorted(first, 3 * begins)
    positions, uvs, normals = (
        statements.positions[vertices[:, 0]],
        _rows_at(statements.uvs, vertices[:, 1]),
        _rows_at(statements.normals, vertices[:, 2]),
    )
    has_uvs = np.concatenate([[0], np.cumsum(vertices[:, 1] >= 0)])[starts]
    colors = None if statements.colors is None else vertex_colors(statements.colors[vertices[:, 0]])
    found = []
    for i in range(len(begins) - 1):
        rows = slice(starts[i], starts[i + 1])
        triangles = number[3 * begins[i] : 3 * begins[i + 1]].reshape(-1, 3) - np.int32(starts[i])
        mesh = Mesh(names[i // 2], positions[rows], triangles)
        mesh.normals = normals[rows] if i % 2 == 0 else None
        mesh.uvs = uvs[rows] if has_uvs[i] < has_uvs[i + 1] else None
        mesh.colors = colors[rows] if colors is not None else None
        found.append(mesh)
    return found


def _rows_at(table: F32, indices: I32) -> F32:
    """Returns the rows of an array at the given indices; for the index -1, a row of zeros."""
    if not len(table):
        return np.zeros((len(indices), table.shape[1]), np.float32)
    return np.where(indices[:, None] >= 0, table[np.maximum(indices, 0)], np.float32(0))
