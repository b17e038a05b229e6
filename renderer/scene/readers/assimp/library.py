"""A binding to assimp's C interface in the package `assimp-py`, whose Python objects lack animation, cameras and lights.

A file is passed as bytes, so that assimp opens no other file. Results are copied, and assimp's memory is freed.
"""

from __future__ import annotations

import ctypes
import functools
import importlib.util
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.confine.limits import importer_memory, limited_memory
from renderer.errors import SceneError
from renderer.scene.polygons import triangulate
from renderer.sentences import Sentence

__all__ = ["Animation", "Bone", "Camera", "Channel", "Imported", "Lamp", "Node", "Shape", "import_file"]

F64 = npt.NDArray[np.float64]
F32 = npt.NDArray[np.float32]

_INCOMPLETE = 0x1  # scene flag
_KNOWN = (5, 6)  # major versions that have the structures below
_JOIN, _INVALID, _UVS = 0x2, 0x20000, 0x40000
_STEPS = _JOIN | _INVALID | _UVS
_POINTS, _LINES, _TRIANGLES, _POLYGONS = 1, 2, 4, 8  # aiPrimitiveType
MAX_NODES = 200_000
# Settings that keep importers from opening a second file. In memory there is only one file, which assimp returns for every
# name: without these settings, an SMD file is read again as a list of animations, once for each of its lines.
_SETTINGS = {b"IMPORT_SMD_LOAD_ANIMATION_LIST": 0, b"IMPORT_MD5_NO_ANIM_AUTOLOAD": 1}

# Logged warnings and errors that do not affect the image.
_IGNORED_LOG_LINES = (
    "Collada: Orthographic cameras are not supported",  # renderer/scene/readers/collada.py reads them
    "Collada: Unexpected effect input mapping",
    "IRRMESH: Ignoring non buffer node",
    "No hierarchy information has been found",
    "ScenePreprocessor: UVs are declared to be 3D",
    "Simplified dummy tracks",
    "Unexpected ThumbNailHdrSize",
)
MAX_SAID = 50  # distinct log messages per file

_u, _f, _d, _p = ctypes.c_uint32, ctypes.c_float, ctypes.c_double, ctypes.c_void_p


class _String(ctypes.Structure):
    _fields_ = (("length", _u), ("data", ctypes.c_char * 1024))

    def __str__(self) -> str:
        return bytes(self.data[: min(self.length, 1024)]).decode("utf-8", "surrogateescape")


def _structure(*fields: tuple[str, Any]) -> Any:
    return type("Structure", (ctypes.Structure,), {"_fields_": fields})


_Node = _structure(
    ("name", _String), ("local", _f * 16), ("parent", _p), ("num_children", _u), ("children", _p), ("num_meshes", _u),
    ("meshes", _p), ("metadata", _p),
)  # fmt: skip
_Mesh = _structure(
    ("kinds", _u), ("num_vertices", _u), ("num_faces", _u), ("vertices", _p), ("normals", _p), ("tangents", _p),
    ("bitangents", _p), ("colors", _p * 8), ("uvs", _p * 8), ("components", _u * 8), ("faces", _p), ("num_bones", _u),
    ("bones", _p), ("material", _u), ("name", _String), ("num_morphs", _u),
)  # fmt: skip
_Bone = _structure(("name", _String), ("num_weights", _u), ("armature", _p), ("node", _p), ("weights", _p), ("offset", _f * 16))
_Property = _structure(("key", _String), ("semantic", _u), ("index", _u), ("length", _u), ("kind", ctypes.c_int32), ("data", _p))
_Material = _structure(("properties", _p), ("count", _u))
_Texture = _structure(("width", _u), ("height", _u), ("hint", ctypes.c_char * 9), ("data", _p), ("name", _String))
_Light = _structure(
    ("name", _String), ("kind", ctypes.c_int32), ("position", _f * 3), ("direction", _f * 3), ("up", _f * 3), ("constant", _f),
    ("linear", _f), ("quadratic", _f), ("color", _f * 3), ("specular", _f * 3), ("ambient", _f * 3), ("inner", _f),
    ("outer", _f), ("size", _f * 2),
)  # fmt: skip
_Camera = _structure(
    ("name", _String), ("position", _f * 3), ("up", _f * 3), ("towards", _f * 3), ("fov", _f), ("near", _f), ("far", _f),
    ("aspect", _f), ("width", _f),
)  # fmt: skip
_Channel = _structure(
    ("node", _String), ("num_places", _u), ("places", _p), ("num_turns", _u), ("turns", _p), ("num_scales", _u), ("scales", _p)
)
_Animation = _structure(
    ("name", _String), ("duration", _d), ("ticks", _d), ("num_channels", _u), ("channels", _p), ("num_meshes", _u), ("_1", _p),
    ("num_morphs", _u), ("_2", _p),
)  # fmt: skip
_Scene = _structure(
    ("flags", _u), ("root", _p), ("num_meshes", _u), ("meshes", _p), ("num_materials", _u), ("materials", _p),
    ("num_animations", _u), ("animations", _p), ("num_textures", _u), ("textures", _p), ("num_lights", _u), ("lights", _p),
    ("num_cameras", _u), ("cameras", _p),
)  # fmt: skip
_PLACE = np.dtype([("time", "f8"), ("value", "f4", 3), ("way", "i4")])  # aiVectorKey
_TURN = np.dtype([("time", "f8"), ("value", "f4", 4), ("way", "i4"), ("_", "i4")])  # aiQuatKey: w x y z


_Said = ctypes.CFUNCTYPE(None, ctypes.c_char_p, ctypes.c_char_p)
_Log = _structure(("callback", _Said), ("user", _p))


@dataclass
class Node:
    """A node of the hierarchy. parent: index of an earlier node, -1 for the root."""

    name: str
    parent: int
    local: F64  # (4, 4)
    meshes: list[int]


@dataclass
class Bone:
    """The vertices that a node deforms, and their weights. offset: (4, 4) from mesh space to the node's space."""

    node: str
    offset: F64
    vertices: npt.NDArray[np.uint32]
    weights: F32


@dataclass
class Shape:
    """A mesh of triangles that have the same material."""

    name: str
    positions: F32
    triangles: npt.NDArray[np.int32]
    normals: F32 | None
    uvs: list[F32]
    colors: F32 | None
    material: int
    bones: list[Bone] = field(default_factory=list)
    unfilled: int = 0  # number of concave polygons that could not be triangulated
    more_sets: int = 0  # UV sets beyond two, and colour sets beyond one


@dataclass
class Lamp:
    """A light. node: name of the node it is on; kind: 1 directional, 2 point, 3 spot, 4 ambient, 5 area.

    Inner and outer are a spot's full angles in radians; linear and quadratic are attenuation coefficients.
    """

    node: str
    kind: int
    position: F64
    direction: F64
    color: F64
    linear: float
    quadratic: float
    inner: float
    outer: float


@dataclass
class Camera:
    """A camera. node: name of the node it is on; fov: horizontal, in radians; aspect and width are 0 if not set."""

    node: str
    position: F64
    up: F64
    towards: F64
    fov: float
    aspect: float
    width: float  # half width if orthographic


@dataclass
class Channel:
    """The animation of one node. Translations, rotations and scales are each a pair: key times in seconds, and values.

    Rotations are quaternions x y z w.
    """

    node: str
    places: tuple[F64, F64]
    turns: tuple[F64, F64]
    scales: tuple[F64, F64]


@dataclass
class Animation:
    """An animation clip. others: number of mesh and morph channels, which are not supported."""

    name: str
    seconds: float
    channels: list[Channel]
    others: int


@dataclass
class Imported:
    """The contents of a file. Each material is a dict of property values by (key, semantic).

    The semantic is the texture's type, from 1, for properties of textures, and 0 for all other properties.
    """

    nodes: list[Node]
    meshes: dict[int, Shape]
    materials: list[dict[tuple[str, int], Any]]
    textures: list[tuple[str, bytes]]
    lamps: list[Lamp]
    cameras: list[Camera]
    animations: list[Animation]
    loose: int  # number of line and point meshes
    morphs: int
    stacked: int = 0  # number of textures beyond the first of a type
    is_whole: bool = True
    said: Counter[str] = field(default_factory=Counter)  # count by log message


@functools.cache
def _library() -> Any:
    spec = importlib.util.find_spec("assimp_py")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        for path in sorted(Path(folder).glob("*.so")):
            found = ctypes.CDLL(str(path))
            if hasattr(found, "aiImportFileFromMemoryWithProperties") and found.aiGetVersionMajor() in _KNOWN:
                found.aiImportFileFromMemoryWithProperties.restype = _p
                found.aiImportFileFromMemoryWithProperties.argtypes = [ctypes.c_char_p, _u, _u, ctypes.c_char_p, _p]
                found.aiAttachLogStream.argtypes = found.aiDetachLogStream.argtypes = [_p]
                found.aiCreatePropertyStore.restype = _p
                found.aiReleasePropertyStore.argtypes = [_p]
                found.aiSetImportPropertyInteger.argtypes = [_p, ctypes.c_char_p, ctypes.c_int]
                found.aiReleaseImport.argtypes = [_p]
                found.aiGetErrorString.restype = ctypes.c_char_p
                return found
    raise SceneError(
        Sentence(
            "assimp-not-installed",
            "Files of this format need the package assimp-py, which is not installed: pip install assimp-py",
        )
    )


def import_file(data: bytes, name: str) -> Imported:
    """Imports a file, given as bytes; the suffix of its name determines the format.

    Raises SceneError if it cannot be imported.
    """
    if not data:
        raise SceneError(Sentence("file-empty", "{name} is empty; export it again", name=name))
    library = _library()
    hint = Path(name).suffix[1:].lower().encode()
    said: Counter[str] = Counter()
    log = _Log(_Said(lambda line, _: _count_log_line(line, said)), None)
    settings = library.aiCreatePropertyStore()
    library.aiAttachLogStream(ctypes.byref(log))
    try:
        for key, value in _SETTINGS.items():
            library.aiSetImportPropertyInteger(settings, key, value)
        with limited_memory(importer_memory(len(data))) as is_less_than_asked:
            address = library.aiImportFileFromMemoryWithProperties(data, len(data), _STEPS, hint, settings)
    finally:
        library.aiDetachLogStream(ctypes.byref(log))
        library.aiReleasePropertyStore(settings)
    if not address:
        reason = (library.aiGetErrorString() or b"").decode("utf-8", "replace").strip().splitlines() or ["unknown"]
        if is_less_than_asked and "bad_alloc" in reason[0]:
            raise MemoryError
        raise SceneError(
            Sentence(
                "file-damaged-or-misnamed",
                "{name} is damaged or not a {format} file. Export it again ({reason})",
                name=name,
                format=Path(name).suffix,
                reason=reason[0][:160],
            )
        )
    try:
        found = _copied(_Scene.from_address(address), name)
        found.said = said
        return found
    finally:
        library.aiReleaseImport(address)


def _count_log_line(line: bytes, counts: Counter[str]) -> None:
    """Counts a line of assimp's log if it is a warning or an error, such as `Warn,  T0: 3DS: Skipping TCB animation info`."""
    kind, _, text = line.decode("utf-8", "replace").strip().partition(": ")
    text = " ".join(text.split())[:160].rstrip(".")
    if (
        kind.startswith(("Warn", "Error"))
        and not text.startswith(_IGNORED_LOG_LINES)
        and (text in counts or len(counts) < MAX_SAID)
    ):
        counts[text] += 1


def _copied(scene: Any, name: str) -> Imported:
    nodes = _nodes(scene.root, name)
    meshes: dict[int, Shape] = {}
    loose = morphs = 0
    for i, mesh in enumerate(_structures_at(scene.meshes, scene.num_meshes, _Mesh)):
        if mesh.kinds & (_TRIANGLES | _POLYGONS) and mesh.num_faces and mesh.num_vertices:
            meshes[i] = _shape(mesh, name)
            morphs += mesh.num_morphs
        if mesh.num_faces:
            loose += bool(mesh.kinds & _POINTS) + bool(mesh.kinds & _LINES)
    return Imported(
        nodes,
        meshes,
        [_material(m) for m in _structures_at(scene.materials, scene.num_materials, _Material)],
        [_texture(t) for t in _structures_at(scene.textures, scene.num_textures, _Texture)],
        [
            Lamp(
                str(x.name),
                x.kind,
                _vector(x.position),
                _vector(x.direction),
                _vector(x.color),
                x.linear,
                x.quadratic,
                x.inner,
                x.outer,
            )
            for x in _structures_at(scene.lights, scene.num_lights, _Light)
        ],
        [
            Camera(str(x.name), _vector(x.position), _vector(x.up), _vector(x.towards), x.fov, x.aspect, x.width)
            for x in _structures_at(scene.cameras, scene.num_cameras, _Camera)
        ],
        [_animation(a, i) for i, a in enumerate(_structures_at(scene.animations, scene.num_animations, _Animation))],
        loose,
        morphs,
        sum(
            said.index > 0 and str(said.key) == "$tex.file"
            for material in _structures_at(scene.materials, scene.num_materials, _Material)
            for said in _structures_at(material.properties, material.count, _Property)
        ),
        is_whole=not scene.flags & _INCOMPLETE,
    )


def _structures_at(address: int | None, count: int, kind: Any) -> list[Any]:
    """Returns the structures that a table of pointers refers to; null pointers are skipped."""
    if not address or not count:
        return []
    table = (ctypes.c_void_p * count).from_address(address)
    return [kind.from_address(each) for each in table if each]


def _array(address: int | None, count: int, dtype: Any, width: int = 1) -> npt.NDArray[Any]:
    kind = np.dtype(dtype)
    if not address or not count:
        return np.zeros((0, width) if width > 1 else 0, kind)
    found = np.frombuffer(ctypes.string_at(address, count * width * kind.itemsize), kind)
    return found.reshape(-1, width) if width > 1 else found


def _vector(values: Any) -> F64:
    return np.array(list(values), np.float64)


def _nodes(root: int | None, name: str) -> list[Node]:
    found: list[Node] = []
    stack = [(root, -1)] if root else []
    while stack:
        address, parent = stack.pop()
        node = _Node.from_address(address)
        local = _vector(node.local).reshape(4, 4)
        found.append(Node(str(node.name), parent, local, _array(node.meshes, node.num_meshes, np.uint32).tolist()))
        if len(found) > MAX_NODES:
            raise SceneError(
                Sentence(
                    "assimp-nodes-too-many",
                    "{name} has more than {most} nodes; simplify it",
                    name=name,
                    most=MAX_NODES,
                )
            )
        children = _array(node.children, node.num_children, np.uint64).tolist()
        stack += [(child, len(found) - 1) for child in reversed(children) if child]
        parent = len(found) - 1
    return found


def _shape(mesh: Any, name: str) -> Shape:
    count = mesh.num_vertices
    table = _array(mesh.faces, mesh.num_faces, np.uint64, 2)
    counts = (table[:, 0] & 0xFFFFFFFF).astype(np.int64)
    whole = counts >= 3
    counts = counts[whole]
    words = map(ctypes.string_at, table[whole, 1].tolist(), (4 * counts).tolist())
    corners = np.frombuffer(b"".join(words), np.uint32)
    if len(corners) and corners.max() >= count:
        raise SceneError(
            Sentence(
                "face-vertex-out-of-range",
                "{name}: a face refers to vertex {vertex}, but there are {count}; export the file again",
                name=name,
                vertex=corners.max(),
                count=count,
            )
        )
    normals = _array(mesh.normals, count, np.float32, 3) if mesh.normals else None
    uvs = [_array(a, count, np.float32, 3)[:, :2] for a in mesh.uvs[:2] if a]
    colors = _array(mesh.colors[0], count, np.float32, 4) if mesh.colors[0] else None
    bones = []
    for bone in _structures_at(mesh.bones, mesh.num_bones, _Bone):
        weights = _array(bone.weights, bone.num_weights, np.dtype([("vertex", "u4"), ("weight", "f4")]))
        weights = weights[weights["vertex"] < count]
        offset = _vector(bone.offset).reshape(4, 4)
        bones.append(Bone(str(bone.name), offset, weights["vertex"], weights["weight"]))
    positions = _array(mesh.vertices, count, np.float32, 3)
    cut = triangulate(counts, corners, positions)
    triangles = corners[cut.triangles].astype(np.int32)
    more = sum(map(bool, mesh.uvs[2:])) + sum(map(bool, mesh.colors[1:]))
    return Shape(str(mesh.name), positions, triangles, normals, uvs, colors, int(mesh.material), bones, cut.unfilled, more)


def _material(material: Any) -> dict[tuple[str, int], Any]:
    found: dict[tuple[str, int], Any] = {}
    for said in _structures_at(material.properties, material.count, _Property):
        key = str(said.key), int(said.semantic)
        if said.index or not said.data:
            continue
        data = ctypes.string_at(said.data, said.length)
        if said.kind == 3:  # a string: length in four bytes, text, 0
            found[key] = data[4 : 4 + int.from_bytes(data[:4], "little")].decode("utf-8", "surrogateescape")
        elif said.kind in (1, 2, 4):
            found[key] = np.frombuffer(
                data[: len(data) // 8 * 8 if said.kind == 2 else len(data) // 4 * 4],
                {1: np.float32, 2: np.float64, 4: np.int32}[said.kind],
            ).astype(np.float64)
        else:
            found[key] = data
    return found


def _texture(texture: Any) -> tuple[str, bytes]:
    """Returns the name and bytes of an embedded texture; the bytes are empty for uncompressed pixels, which are not supported."""
    size = texture.width if texture.height == 0 else 0
    return str(texture.name), ctypes.string_at(texture.data, size) if texture.data and size else b""


def _animation(animation: Any, number: int) -> Animation:
    ticks = animation.ticks if animation.ticks > 0 else 25.0  # default of assimp's viewer
    channels = []
    for channel in _structures_at(animation.channels, animation.num_channels, _Channel):
        places = _array(channel.places, channel.num_places, _PLACE)
        turns = _array(channel.turns, channel.num_turns, _TURN)
        scales = _array(channel.scales, channel.num_scales, _PLACE)
        xyzw = turns["value"][:, [1, 2, 3, 0]] if len(turns) else np.zeros((0, 4))
        keys = [
            (k["time"] / ticks, v.astype(np.float64))
            for k, v in ((places, places["value"]), (turns, xyzw), (scales, scales["value"]))
        ]
        channels.append(Channel(str(channel.node), *keys))
    others = animation.num_meshes + animation.num_morphs
    return Animation(str(animation.name) or f"animation {number}", animation.duration / ticks, channels, others)
