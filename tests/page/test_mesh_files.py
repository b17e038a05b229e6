"""Tests of the page's own readers of OBJ, PLY, STL, FBX and zip files: its first preview equals that of the service."""

from __future__ import annotations

import base64
import io
import json
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from renderer.formats import ARCHIVE_SUFFIXES, SCENE_SUFFIXES, pick_main
from renderer.preview_mesh import PreviewMesh
from renderer.scene.animation import Moment
from renderer.scene.default_camera import frame
from renderer.scene.description import SceneDescription
from renderer.scene.load import Shot
from renderer.scene.preview import preview
from renderer.scene.room_camera import room_view
from tests.helpers import ROOT
from tests.page.node import Node

READ = """
    const bytes = (data) => Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
    const files = a.files.map(([path, data]) => ({ path, file: new Blob([bytes(data)]) }));
    const known = await m.meshOf({ files, formats: a.formats });
    if (!known) return null;
    const { packet, view, isWhole, images } = known;
    const plain = Object.entries(packet).map(([name, value]) => [name, ArrayBuffer.isView(value) ? [...value] : value]);
    return { packet: Object.fromEntries(plain), view, isWhole, images: images.map(({ bytes }) => [...bytes]) };"""


def read_in_page(node: Node, files: dict[str, bytes]) -> Any:
    sent = [(path, base64.b64encode(data).decode()) for path, data in files.items()]
    formats = [*SCENE_SUFFIXES, *ARCHIVE_SUFFIXES]  # as /api/info lists them
    return node.call("mesh/upload", READ, {"files": sent, "formats": formats})


def read_description(folder: Path, files: dict[str, bytes]) -> SceneDescription:
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    shot = Shot(folder, pick_main(list(files))[0])
    return shot.scene_at(Moment(shot.start))


def read_by_service(folder: Path, files: dict[str, bytes]) -> PreviewMesh:
    shown = preview(read_description(folder, files))
    assert shown is not None
    return shown


def corners_of(packet: Any) -> tuple[np.ndarray, np.ndarray]:
    """Returns the positions, (T, 3, 3), and the normals of the corners of a packet's triangles, sorted by position."""
    low, high = np.array(packet["low"]), np.array(packet["high"])
    positions = low + np.array(packet["positions"]).reshape(-1, 4)[:, :3] / 65535 * (high - low)
    normals = np.array(packet["normals"]).reshape(-1, 4)[:, :3] / 127
    return sorted_corners(positions, normals, np.array(packet["indices"]).reshape(-1, 3), np.ptp(positions))


def sorted_corners(
    positions: np.ndarray, normals: np.ndarray, triangles: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray]:
    corners = positions[triangles]
    # A triangle is known by its middle, and each of its corners by its place.
    order = np.lexsort(np.round(corners.mean(axis=1) / size, 3).T)
    within = np.lexsort(np.round(corners[order] / size, 3).transpose(2, 0, 1), axis=1)
    pick = (np.arange(len(order))[:, None], within)
    return corners[order][pick], normals[triangles][order][pick]


def expect_equal(found: Any, known: PreviewMesh) -> None:
    """The triangles, normals and camera of the page's preview equal those of the service's."""
    packet, view = found["packet"], found["view"]
    size = float(np.ptp(known.positions))
    corners, normals = corners_of(packet)
    expected, facing = sorted_corners(known.positions, known.normals, known.triangles, size)
    assert corners.shape == expected.shape
    np.testing.assert_allclose(corners, expected, atol=1e-3 * size)
    np.testing.assert_allclose(normals, facing, atol=2e-2)
    camera = frame(known.positions)
    for name in ("eye", "target", "up", "fov"):
        np.testing.assert_allclose(view[name], getattr(camera, name), atol=1e-3 * size)


def cup(*, up: str) -> trimesh.Trimesh:
    """Returns a closed cone of 20 sides that stands on the given axis, so that this axis can be guessed; some edges are sharp."""
    mesh = trimesh.creation.cone(1.0, 2.0, sections=20)
    mesh.apply_translation((0.2, 0, 0))
    return mesh if up == "z" else mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "stl_ascii"])
def test_mesh_and_camera_equal_those_of_service(node: Node, tmp_path: Path, kind: str, up: str) -> None:
    files = {f"cup.{kind.split('_')[0]}": bytes_of(cup(up=up), kind)}
    found = read_in_page(node, files)
    expect_equal(found, read_by_service(tmp_path, files))


def bytes_of(mesh: trimesh.Trimesh, kind: str) -> bytes:
    data = mesh.export(file_type=kind, **({"include_normals": False} if kind == "obj" else {}))
    return data.encode() if isinstance(data, str) else bytes(data)


@pytest.mark.parametrize("in_corner", [False, True])
def test_camera_in_a_room_equals_that_of_service(node: Node, tmp_path: Path, in_corner: bool) -> None:
    walls = trimesh.creation.box((8, 3, 6))
    walls.invert()
    thing = trimesh.creation.box((0.5, 0.5, 0.5))
    thing.apply_translation((3.2, 0.3, 2.4) if in_corner else (0, -1, 0))
    files = {"room.obj": bytes_of(trimesh.util.concatenate([walls, thing]), "obj")}
    view = read_in_page(node, files)["view"]
    service = read_description(tmp_path, files)
    known = room_view(service, np.array([(-4, -1.5, -3), (4, 1.5, 3)]))
    assert known is not None
    for name in ("eye", "target", "up", "fov"):
        np.testing.assert_allclose(view[name], getattr(known, name), atol=1e-3)


PLY_ROWS = [(-1.0, 0.0, 0.5, 255, 0, 0), (1, 0, 0, 0, 255, 0), (1, 2, 0, 0, 0, 255), (-1, 2, -0.5, 10, 20, 30)]
PLY_HEAD = """ply
format {format} 1.0
comment four coloured vertices
element extra 2
property list uchar short numbers
element vertex 4
property float x
property float y
property double z
property uchar red
property uchar green
property uchar blue
property int quality
element face 1
property uchar flags
property list uchar int vertex_indices
end_header
"""


@pytest.mark.parametrize("order", ["ascii", "<", ">"])
def test_ply_of_each_byte_order_is_read(node: Node, tmp_path: Path, order: str) -> None:
    """A polygon of four coloured vertices, behind an element with lists, with properties of other types between."""
    name = {"ascii": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = PLY_HEAD.format(format=name).encode()
    if order == "ascii":
        rows = [" ".join(map(str, (*row, -7))) for row in PLY_ROWS]
        data = "\n".join(["2 5 6", "0", *rows, "9 4 0 1 2 3", ""]).encode()
    else:
        data = struct.pack(f"{order}B2hB", 2, 5, 6, 0)
        data += b"".join(struct.pack(f"{order}2fd3Bi", *row, -7) for row in PLY_ROWS)
        data += struct.pack(f"{order}BB4i", 9, 4, 0, 1, 2, 3)
    files = {"polygon.ply": head + data}
    found, known = read_in_page(node, files), read_by_service(tmp_path, files)
    assert found["packet"]["triangles"] == 2
    np.testing.assert_allclose(found["packet"]["low"], known.positions.min(axis=0), atol=1e-6)
    np.testing.assert_allclose(found["packet"]["high"], known.positions.max(axis=0), atol=1e-6)
    colors = {tuple(row) for row in np.array(found["packet"]["colors"]).reshape(-1, 4).tolist()}
    assert colors == {tuple(row) for row in known.colors.tolist()} == {(*row[3:], 255) for row in PLY_ROWS}
    assert read_in_page(node, {"polygon.ply": (head + data)[:-6]}) is None, "cut off"


CLOUD = np.random.default_rng(8).normal(size=(300, 3)).astype("<f4")


@pytest.mark.parametrize("kind", ["rgb", "splats", "plain"])
def test_points_are_drawn_where_the_service_has_them(node: Node, tmp_path: Path, kind: str) -> None:
    """Points are octahedra of the service's colours, size and camera; 3D Gaussians have -Y up."""
    names = {"rgb": ("red", "green", "blue"), "splats": ("f_dc_0", "f_dc_1", "f_dc_2"), "plain": ()}[kind]
    rows = np.zeros(len(CLOUD), [("place", "<f4", 3), ("color", "u1" if kind == "rgb" else "<f4", len(names))])
    rows["place"] = CLOUD
    rows["color"] = 200 * (CLOUD > 0) if kind == "rgb" else CLOUD[:, : len(names)]
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 300\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    head += "".join(f"property {'uchar' if kind == 'rgb' else 'float'} {name}\n" for name in names) + "end_header\n"
    files = {"cloud.ply": head.encode() + rows.tobytes()}
    found, known = read_in_page(node, files), read_by_service(tmp_path, files)
    packet, size = found["packet"], float(np.ptp(known.positions))
    assert found["isWhole"]
    assert packet["triangles"] == 8 * len(CLOUD)
    np.testing.assert_allclose(packet["low"], known.positions.min(axis=0), atol=2e-2 * size)
    np.testing.assert_allclose(packet["high"], known.positions.max(axis=0), atol=2e-2 * size)
    camera = frame(known.positions)
    for name in ("eye", "target", "up", "fov"):
        np.testing.assert_allclose(found["view"][name], getattr(camera, name), atol=5e-2 * size)
    low, high = np.array(packet["low"]), np.array(packet["high"])
    corners = low + np.array(packet["positions"]).reshape(-1, 6, 4)[..., :3] / 65535 * (high - low)
    middles = CLOUD * [1, -1, -1] if kind == "splats" else CLOUD
    np.testing.assert_allclose(corners.mean(axis=1), middles, atol=1e-3 * size)
    colors = np.array(packet["colors"]).reshape(-1, 4)
    assert {tuple(row) for row in colors.tolist()} == {tuple(row) for row in known.colors.tolist()}


QUADS = """# two quads that meet at an edge, one of each material \\
mtllib paint box.mtl
v -1 0 0
v 0 0 0 # a comment
v 0 1 1e-1
v -1.0e0 1 .1
v +1 0 0
v 1 1 0.1
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl red
f 1/1 2/2 \\
  3/3 4/4
usemtl wood
f -5/1 -2/2 -1/3 -4/4
"""
PAINT = "newmtl red\nKd 1 0 0\n\nnewmtl wood\nmap_Kd -s 1 1 1 my wood.png\nKd 0 0 0\n"


@pytest.fixture(scope="module")
def wood() -> bytes:
    data = io.BytesIO()
    Image.fromarray(np.full((2, 4, 3), 90, np.uint8)).save(data, "png")
    return data.getvalue()


def test_obj_has_its_materials_and_textures(node: Node, tmp_path: Path, wood: bytes) -> None:
    """A material file and an image with blanks in their names, continued lines, comments, and indices from the end."""
    files = {"a/quads.obj": QUADS.encode(), "a/paint box.mtl": PAINT.encode(), "a/my wood.png": wood}
    found = read_in_page(node, files)
    expect_equal(found, read_by_service(tmp_path, files))
    packet = found["packet"]
    plain, textured = packet["parts"]
    assert [(packet["materials"][part["material"]]["texture"], part["corners"]) for part in (plain, textured)] == [
        (-1, 6),
        (0, 6),
    ]
    colors = np.array(packet["colors"]).reshape(-1, 4)
    assert {tuple(row) for row in colors[packet["indices"][6:]].tolist()} == {(255, 255, 255, 255)}, "a black Kd beside a map"
    assert {tuple(row) for row in colors[packet["indices"][:6]].tolist()} == {(255, 0, 0, 255)}
    uvs = np.array(packet["uvs"]).reshape(-1, 2)[packet["indices"][6:]]
    assert {tuple(uv) for uv in uvs.tolist()} == {(0, 0), (1, 0), (1, 1), (0, 1)}
    assert bytes(found["images"][0]) == wood


@pytest.mark.parametrize("groups", ["s off\n", "s 1\n", "s 1\n{}s 0\n", ""])
def test_obj_is_smooth_within_its_groups(node: Node, tmp_path: Path, groups: str) -> None:
    """Without groups by the crease angle; with `s off` flat, which the shader does where there are no normals."""
    mesh = cup(up="y")
    faces = [f"f {a} {b} {c}\n" for a, b, c in (mesh.faces + 1).tolist()]
    half = "".join(faces[:20])
    text = "".join("v {} {} {}\n".format(*vertex) for vertex in mesh.vertices.tolist())
    text += groups.format(half) + "".join(faces[20:] if "{}" in groups else faces)
    files = {"cup.obj": text.encode()}
    expect_equal(read_in_page(node, files), read_by_service(tmp_path, files))


def test_only_image_beside_an_obj_without_materials_is_its_texture(node: Node, tmp_path: Path, wood: bytes) -> None:
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as made:
        for name in ("spot/cow_control_mesh.obj", "spot/triangulated cow.obj", "spot/quadrangulated cow.obj"):
            text = QUADS.replace("mtllib paint box.mtl", f"v {len(name)} 0 0 # unused")
            made.writestr(name, text.replace("f -5/1 -2/2 -1/3 -4/4", "f -6/1 -3/2 -2/3 -4/4"), zipfile.ZIP_DEFLATED)
        made.writestr("spot/my wood.png", wood, zipfile.ZIP_STORED)
        made.writestr("__MACOSX/spot/._a.obj", b"junk")
    found = read_in_page(node, {"spot.zip": archive.getvalue()})
    assert bytes(found["images"][0]) == wood
    assert found["isWhole"]


def test_zip_in_a_zip_is_read(node: Node, wood: bytes) -> None:
    inner, outer = io.BytesIO(), io.BytesIO()
    with zipfile.ZipFile(inner, "w") as made:
        made.writestr("quads.obj", QUADS)
        made.writestr("paint box.mtl", PAINT)
    with zipfile.ZipFile(outer, "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("source/quads.zip", inner.getvalue())
        made.writestr("textures/my wood.png", wood)
    found = read_in_page(node, {"model.zip": outer.getvalue()})
    assert found["packet"]["triangles"] == 4
    assert bytes(found["images"][0]) == wood


FBX = ROOT / "tests" / "data" / "fbx"
Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # from Blender's axes


def test_fbx_vertices_match_blender(node: Node) -> None:
    """Nested, rotated, instanced, skinned and blended meshes are where Blender computed them."""
    found = read_in_page(node, {"kit.fbx": (FBX / "kit.fbx").read_bytes()})
    corners, _ = corners_of(found["packet"])
    points = np.unique(corners.reshape(-1, 3), axis=0)
    said = json.loads((FBX / "kit.json").read_text())["0"]
    meshes = [each for each in said.values() if each["type"] == "MESH"]
    assert found["packet"]["triangles"] == sum(each["triangles"] for each in meshes)
    wanted = np.concatenate([each["vertices"] for each in meshes]) @ Y_UP.T
    away = np.linalg.norm(wanted[:, None] - points[None], axis=2).min(axis=1)
    assert away.max() < 1e-3
    assert not found["packet"]["isStudio"], "the file has lamps"
    lamps = [said[name] for name in ("point", "sun", "spot", "area")]
    matrices = [np.array(lamp["matrix"]) for lamp in lamps]
    ways = [Y_UP @ (m[:3, 2] if i == 1 else m[:3, 3]) for i, m in enumerate(matrices)]  # Blender's lamps shine along -Z
    given = sorted((lamp["far"], *np.round(lamp["at"], 3) + 0.0) for lamp in found["packet"]["lamps"])
    np.testing.assert_allclose(given, sorted((i == 1, *way) for i, way in enumerate(ways)), atol=1e-3)
    assert len(found["images"]) == 1
    assert not found["isWhole"], "it is animated"


def test_fbx_lamps_are_as_strong_as_those_of_service(node: Node, tmp_path: Path) -> None:
    files = {"kit.fbx": (FBX / "kit.fbx").read_bytes()}
    found, known = read_in_page(node, files)["packet"]["lamps"], read_by_service(tmp_path, files).lamps
    by_place = {tuple(np.round(lamp.at, 3)): lamp for lamp in known}
    for lamp in found:
        same = by_place[tuple(np.round(lamp["at"], 3))]
        np.testing.assert_allclose(lamp["color"], same.color, rtol=1e-3)
        np.testing.assert_allclose(lamp["axis"], same.axis, atol=1e-5)
        np.testing.assert_allclose(lamp["cosines"], same.cosines, atol=1e-5)
    assert len(found) == 4, "a point, an area, a spot and a sun"


def test_concave_polygons_keep_their_shape(node: Node, tmp_path: Path) -> None:
    """A pane of the file is a square with a notch, of which a fan would cover more than the square."""
    files = {"kit.fbx": (FBX / "kit.fbx").read_bytes()}
    corners, _ = corners_of(read_in_page(node, files)["packet"])
    known = read_by_service(tmp_path, files)

    def area(triangles: np.ndarray) -> float:
        return float(np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1).sum())

    assert area(corners) == pytest.approx(area(known.positions[known.triangles]), rel=1e-3)


@pytest.mark.parametrize(
    ("outline", "triangles"),
    [
        ([(0, 0), (2, 0), (2, 2), (0, 2)], 2),
        ([(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)], 3),
        ([(0, 4), (2, 1), (4, 4), (4, 0), (0, 0)], 3),
        ([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)], 6),
    ],
)
def test_triangles_cover_their_polygon(node: Node, outline: list[tuple[int, int]], triangles: int) -> None:
    places = [(x, y, 0.5 * x + 3) for x, y in outline]
    found = node.call("mesh/polygons", "return m.trianglesOf(a.length, (i) => a[i]);", places)
    assert len(found) == 3 * triangles
    x, y = np.array(outline, float)[np.reshape(found, (-1, 3))].transpose(2, 0, 1)
    areas = ((x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])) / 2
    u, v = np.array(outline, float).T
    whole = float(np.sum(u * np.roll(v, -1) - v * np.roll(u, -1))) / 2
    assert areas.sum() == pytest.approx(whole)
    assert (np.sign(areas) == np.sign(whole)).all()


@pytest.mark.parametrize(
    ("outline", "is_first"),
    [
        ([(0, 0), (2, 0), (2, 2), (0, 2)], True),
        ([(0, 0), (4, 0), (1, 1), (0, 4)], True),
        ([(4, 0), (1, 1), (0, 4), (0, 0)], False),
        ([(0, 0), (0, 4), (1, 1), (4, 0)], True),
        ([(1, 1), (0, 4), (0, 0), (4, 0)], True),
    ],
)
def test_quadrilaterals_are_cut_inside(node: Node, outline: list[tuple[int, int]], is_first: bool) -> None:
    points = [value for x, y in outline for value in (x, y, x - y)]
    body = "return m.isCutFromFirst(Float64Array.from(a), 0, 1, 2, 3);"
    assert node.call("mesh/polygons", body, points) is is_first


def test_fbx_materials_equal_those_of_service(node: Node, tmp_path: Path) -> None:
    files = {"kit.fbx": (FBX / "kit.fbx").read_bytes()}
    found, known = read_in_page(node, files), read_by_service(tmp_path, files)
    assert surfaces_of(found["packet"]) == surfaces_of(plain(known))
    assert len(surfaces_of(plain(known))) == 5, "plastic, metal, a texture, a pane, and a lamp"


PAINTS = """
newmtl matt
Kd 0.2 0.3 0.4
newmtl gloss
Kd 0.5 0.1 0.1
Ks 0.5 0.5 0.5
Ns 100
d 0.5
newmtl gold
Kd 0 0 0
Ks 0.9 0.7 0.3
Ns 50
newmtl mirror
Kd 0 0 0
Ks 0.8 0.8 0.8
illum 3
newmtl glass
Kd 1 1 1
illum 7
Ni 1.33
newmtl coated
Kd 0.1 0.2 0.3
Pr 0.25
Pm 0.5
Pc 0.75
Pcr 0.125
newmtl lamp
Kd 0.5 0.5 0.5
Ke 0.01 0.02 0.03
"""


@pytest.mark.parametrize("first", ["", "# Blender 4.2.0 MTL File: 'None'"])
def test_obj_materials_equal_those_of_service(node: Node, tmp_path: Path, first: str) -> None:
    names = [line.split()[1] for line in PAINTS.splitlines() if line.startswith("newmtl")]
    faces = "".join(f"v {i} 0 0\nv {i} 1 0\nv {i} 0 1\nusemtl {name}\nf -3 -2 -1\n" for i, name in enumerate(names))
    files = {"a.obj": f"mtllib a.mtl\n{faces}".encode(), "a.mtl": (first + PAINTS).encode()}
    found, known = read_in_page(node, files), read_by_service(tmp_path, files)
    assert surfaces_of(found["packet"]) == surfaces_of(plain(known))


def plain(mesh: PreviewMesh) -> dict[str, Any]:
    """Returns what surfaces_of reads of a mesh by the service, as the page has it."""
    return {
        "parts": [part._asdict() for part in mesh.parts],
        "materials": [material._asdict() for material in mesh.materials],
        "indices": mesh.triangles.ravel().tolist(),
        "colors": mesh.colors.ravel().tolist(),
    }


def surfaces_of(packet: dict[str, Any]) -> list[str]:
    """Returns the surfaces of a packet with their colours, as sorted text. Numbers are rounded; a metal has no other f0."""
    colors = np.array(packet["colors"]).reshape(-1, 4)
    found = []
    for part in packet["parts"]:
        surface = dict(packet["materials"][part["material"]])
        if surface["metallic"] == 1:
            surface.pop("f0")
        surface.pop("thin")  # the service looks whether the surface is closed
        if surface["transmission"] == 0:
            surface.pop("ior")
        if surface["alpha_mode"] != "mask":
            surface.pop("cutoff")
        items = surface.items()
        corners = packet["indices"][part["first"] : part["first"] + part["corners"]]
        for color in sorted({tuple(row) for row in colors[corners].tolist()}):
            rounded = {
                name: value if isinstance(value, str) else np.round(np.float64(value), 4).tolist() for name, value in items
            }
            found.append(json.dumps([color, rounded], sort_keys=True))
    return sorted(found)


def test_fbx_is_seen_by_its_camera(node: Node) -> None:
    known = Shot(FBX, "kit.fbx")
    camera = known.scene_at(Moment(known.start)).cameras[0].view
    view = read_in_page(node, {"kit.fbx": (FBX / "kit.fbx").read_bytes()})["view"]
    np.testing.assert_allclose(view["eye"], camera.eye, atol=1e-4)
    np.testing.assert_allclose(view["up"], camera.up, atol=1e-4)
    assert view["fov"] == pytest.approx(camera.fov, abs=1e-3)
    forward, known_forward = (np.subtract(end, camera.eye) for end in (view["target"], camera.target))
    assert np.dot(forward, known_forward) / np.linalg.norm(forward) / np.linalg.norm(known_forward) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize(
    "names",
    [
        ["b.obj", "a.obj", "sub/c.glb"],
        ["long name.obj", "x/short.obj"],
        ["control.obj", "model_0.obj"],
        ["a.stl", ".hidden.glb", "__MACOSX/a.glb"],
        ["b.ply", "a.ply"],
        ["A.GLB", "notes.txt"],
        ["notes.txt"],
    ],
)
def test_page_reads_the_file_that_the_service_does(node: Node, names: list[str]) -> None:
    readable = any(name.lower().endswith(SCENE_SUFFIXES) for name in names)
    expected = pick_main(names)[0] if readable else None
    body = "return m.pickMain(a.names, a.formats) ?? null;"
    assert node.call("mesh/files", body, {"names": names, "formats": list(SCENE_SUFFIXES)}) == expected


def damaged() -> Iterator[Any]:
    stl = bytes_of(cup(up="z"), "stl")
    yield pytest.param({"a.stl": stl[:-70]}, id="binary STL, cut off")
    yield pytest.param({"a.stl": b"solid nothing\nendsolid"}, id="STL without triangles")
    yield pytest.param({"a.obj": b"v 0 0 0\nv 1 0 0\nf 1 2 3\n"}, id="OBJ that names a vertex which is not there")
    yield pytest.param({"a.obj": b"v 0 0 0\nv 1 0 0\nv 0 one 0\nf 1 2 3\n"}, id="OBJ with a word in place of a number")
    yield pytest.param(
        {"a.ply": b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n"}, id="PLY without faces"
    )
    fbx = (FBX / "kit.fbx").read_bytes()
    yield pytest.param({"a.fbx": fbx[: len(fbx) // 2]}, id="FBX, cut off")
    yield pytest.param({"a.fbx": b"; FBX 7.4.0 project file"}, id="FBX as text")
    yield pytest.param({"a.zip": b"PK no archive"}, id="no zip")
    yield pytest.param({"a.txt": b"text"}, id="no scene")


@pytest.mark.parametrize("files", list(damaged()))
def test_damaged_files_are_left_to_service(node: Node, files: dict[str, bytes]) -> None:
    assert read_in_page(node, files) is None


@pytest.mark.parametrize(
    "text", ["0", "-0.5", "+12.25", ".5", "7.", "1e3", "-2.5E-7", "123456789.123456789", "1e-320", "0.000123"]
)
def test_numbers_are_read_as_python_reads_them(node: Node, text: str) -> None:
    body = "return new m.Scanner(new TextEncoder().encode(a + ' 1')).number();"
    assert node.call("mesh/text", body, text) == pytest.approx(float(text), rel=1e-15, abs=1e-300)


def test_large_model_is_decimated(node: Node) -> None:
    ball = trimesh.creation.icosphere(subdivisions=5)  # 20,480 triangles
    body = """
        const { packet } = m.readStl(Uint8Array.from(atob(a), (c) => c.charCodeAt(0)), 2000);
        return [packet.triangles, Math.max(...packet.indices) < packet.vertices, packet.low, packet.high];"""
    triangles, is_valid, low, high = node.call("mesh/stl", body, base64.b64encode(bytes_of(ball, "stl")).decode())
    assert 500 < triangles < 4000
    assert is_valid
    np.testing.assert_allclose([low, high], [[-1] * 3, [1] * 3], atol=0.05)
