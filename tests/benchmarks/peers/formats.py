"""Row `formats`: reads the same mesh in each format that can store it, from the file to a renderable scene. No peer.

It is measured as in row `ready`, but by the processor time of all processes, since Blender is a separate process.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from renderer.blender.program import NAMED
from renderer.scene.description import Mesh
from tests.benchmarks.peers.files import large_file
from tests.benchmarks.peers.measure import Line
from tests.benchmarks.peers.meshes import displaced_sphere
from tests.benchmarks.peers.sizes import Sizes
from tests.helpers import ROOT
from tests.peers.blender import python_with_bpy

__all__ = ["WRITERS", "format_lines"]

_SAVE = """
import sys, bpy, numpy as np
bpy.ops.wm.read_factory_settings(use_empty=True)
found = np.load(sys.argv[1])
points, triangles, uvs = found["points"], found["triangles"], found["uvs"]
mesh = bpy.data.meshes.new("sphere")
mesh.vertices.add(len(points))
mesh.vertices.foreach_set("co", points.ravel())
mesh.loops.add(triangles.size)
mesh.loops.foreach_set("vertex_index", triangles.ravel())
mesh.polygons.add(len(triangles))
mesh.polygons.foreach_set("loop_start", np.arange(0, triangles.size, 3))
mesh.polygons.foreach_set("use_smooth", np.ones(len(triangles), bool))
mesh.uv_layers.new(name="map").data.foreach_set("uv", uvs[triangles.ravel()].ravel())
mesh.update(calc_edges=True)
bpy.context.scene.collection.objects.link(bpy.data.objects.new("sphere", mesh))
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[2], compress=sys.argv[3] == "1", check_existing=False)
"""


def _arrays(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    assert mesh.normals is not None and mesh.uvs is not None
    return mesh.positions, mesh.normals, mesh.uvs, mesh.triangles


def _ply(path: Path, mesh: Mesh) -> None:
    points, normals, uvs, triangles = _arrays(mesh)
    names = ("x", "y", "z", "nx", "ny", "nz", "s", "t")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {name}\n" for name in names)
    head += f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    faces = np.zeros(len(triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    path.write_bytes(head.encode() + np.hstack([points, normals, uvs]).astype("<f4").tobytes() + faces.tobytes())


def _stl(path: Path, mesh: Mesh) -> None:
    points, _, _, triangles = _arrays(mesh)
    rows = np.zeros(len(triangles), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("_", "<u2")])
    rows["corners"] = points[triangles]
    path.write_bytes(bytes(80) + np.uint32(len(rows)).tobytes() + rows.tobytes())


def _usdc(path: Path, mesh: Mesh) -> None:
    from pxr import Sdf, Usd, UsdGeom, Vt

    points, normals, uvs, triangles = _arrays(mesh)
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    made = UsdGeom.Mesh.Define(stage, "/sphere")
    made.CreateSubdivisionSchemeAttr("none")
    made.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    made.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals))
    made.SetNormalsInterpolation("vertex")
    made.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(triangles), 3, np.int32)))
    made.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(triangles.ravel()))
    st = UsdGeom.PrimvarsAPI(made).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set(Vt.Vec2fArray.FromNumpy(uvs))
    stage.GetRootLayer().Save()


def _fbx(path: Path, mesh: Mesh) -> None:
    """Writes the mesh as FBX 7.4, as exporters do: compressed arrays, and normals and UVs for each triangle corner."""
    points, normals, uvs, triangles = _arrays(mesh)

    def array(code: bytes, values: np.ndarray) -> bytes:
        packed = zlib.compress(values.tobytes(), 1)
        return code + np.array([values.size, 1, len(packed)], "<u4").tobytes() + packed

    def text(words: bytes) -> bytes:
        return b"S" + np.uint32(len(words)).tobytes() + words

    def number(value: int) -> bytes:
        return b"L" + np.int64(value).tobytes()

    def node(name: bytes, properties: list[bytes], children: list[Node], at: int) -> bytes:
        body = b"".join(properties)
        begin = at + 13 + len(name) + len(body)
        inside = b""
        for child in children:
            inside += node(*child, begin + len(inside))
        inside += bytes(13) if children else b""
        head = np.array([begin + len(inside), len(properties), len(body)], "<u4").tobytes()
        return head + bytes([len(name)]) + name + body + inside

    corners = triangles.astype(np.int32).copy()
    corners[:, 2] = -1 - corners[:, 2]
    layers: list[Node] = []
    for kind, name, values in ((b"Normal", b"Normals", normals), (b"UV", b"UV", uvs)):
        flat = values[triangles.ravel()].astype("<f8").ravel()
        ways = [(b"MappingInformationType", [text(b"ByPolygonVertex")], []), (b"ReferenceInformationType", [text(b"Direct")], [])]
        layers.append((b"LayerElement" + kind, [b"I" + bytes(4)], [*ways, (name, [array(b"d", flat)], [])]))
    geometry: Node = (
        b"Geometry",
        [number(1), text(b"sphere\0\x01Geometry"), text(b"Mesh")],
        [
            (b"Vertices", [array(b"d", points.astype("<f8").ravel())], []),
            (b"PolygonVertexIndex", [array(b"i", corners.ravel())], []),
            *layers,
        ],
    )
    model: Node = (b"Model", [number(2), text(b"sphere\0\x01Model"), text(b"Mesh")], [])
    links: list[Node] = [(b"C", [text(b"OO"), number(1), number(2)], []), (b"C", [text(b"OO"), number(2), number(0)], [])]
    data = b"Kaydara FBX Binary  \0\x1a\0" + np.uint32(7400).tobytes()
    for each in ((b"Objects", [], [geometry, model]), (b"Connections", [], links)):
        data += node(*each, len(data))
    path.write_bytes(data + bytes(13))


Node = tuple[bytes, list[bytes], "list[Node]"]


def _threemf(path: Path, mesh: Mesh) -> None:
    points, _, _, triangles = _arrays(mesh)
    vertices = "".join(f'<vertex x="{x:.6g}" y="{y:.6g}" z="{z:.6g}"/>\n' for x, y, z in points.tolist())
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>\n' for a, b, c in triangles.tolist())
    core = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
    text = (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<model unit="millimeter" xmlns="{core}"><resources><object '
        f'id="1" type="model"><mesh>'
        f"<vertices>\n{vertices}</vertices><triangles>\n{faces}</triangles></mesh></object></resources>"
        '<build><item objectid="1"/></build></model>'
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as package:
        package.writestr("3D/3dmodel.model", text)


def _obj(path: Path, mesh: Mesh) -> None:
    points, normals, uvs, triangles = _arrays(mesh)
    lines = [f"v {x:.6g} {y:.6g} {z:.6g}\n" for x, y, z in points.tolist()]
    lines += [f"vn {x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in normals.tolist()]
    lines += [f"vt {u:.6f} {v:.6f}\n" for u, v in uvs.tolist()]
    lines += [f"f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}\n" for a, b, c in (triangles + 1).tolist()]
    path.write_text("".join(lines))


def _blend(is_compressed: bool) -> Callable[[Path, Mesh], None]:
    def write(path: Path, mesh: Mesh) -> None:
        points, _, uvs, triangles = _arrays(mesh)
        given = path.with_suffix(".npz")
        np.savez(given, points=points, triangles=triangles, uvs=uvs)
        python = python_with_bpy()
        assert python is not None
        command = [python, "-I", "-c", _SAVE, given, path, str(int(is_compressed))]
        subprocess.run(command, check=True, capture_output=True, timeout=600)
        given.unlink()

    return write


# File name -> function that writes the mesh in its format.
WRITERS: dict[str, Callable[[Path, Mesh], object]] = {
    "a.glb": lambda path, mesh: large_file(path, len(mesh.triangles)),
    "a.ply": _ply,
    "a.stl": _stl,
    "a.usdc": _usdc,
    "a.fbx": _fbx,
    "a.3mf": _threemf,
    "a.obj": _obj,
    "a.blend": _blend(is_compressed=False),
    "compressed.blend": _blend(is_compressed=True),
}


def format_lines(sizes: Sizes, folder: Path) -> Iterator[Line]:
    """Measures the reading of each format; yields two lines per format.

    The values are processor seconds, and bytes of the compiled scene per triangle.
    """
    triangles = sizes.ready[0]
    mesh = displaced_sphere(triangles)
    environment = dict(os.environ)
    if python := python_with_bpy():
        environment.setdefault(NAMED, str(python))
    for name, write in WRITERS.items():
        if (name.endswith(".blend") and python is None) or not sizes.wants(name):
            continue
        path = folder / name
        write(path, mesh)
        path.read_bytes()
        runs = []
        for _ in range(sizes.rounds):
            command = [sys.executable, "-m", "tests.benchmarks.peers.ready_once", str(path)]
            done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
            runs.append(json.loads(done.stdout.splitlines()[-1]))
        notes = {key: statistics.median(run[key] for run in runs) for key in ("wall", "read", "most_memory")}
        notes["file"] = path.stat().st_size
        path.unlink()
        used = tuple(run["user"] + run["system"] for run in runs)
        yield Line("formats", f"{name}, seconds", statistics.median(used), (min(used), max(used)), "s", used, notes=notes)
        size = runs[0]["bytes_a_triangle"]
        yield Line("formats", f"{name}, bytes each", size, (size, size), "bytes", (size,))
