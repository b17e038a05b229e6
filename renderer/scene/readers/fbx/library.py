"""The C library of the package `ufbx`, called through ctypes.

The package's Python objects are not used: in version 0.0.5 they return elements without counting the reference, so that a
second access reads freed memory. The C library exports its whole interface and has no such fault.
"""

from __future__ import annotations

import ctypes
import functools
import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.readers.fbx import layout
from renderer.sentences import Sentence

__all__ = [
    "FbxScene",
    "array",
    "each",
    "is_set",
    "is_visible",
    "list_view",
    "matrix",
    "number_of",
    "pointed",
    "struct_at",
    "text",
    "value_at",
]

_KNOWN = range(21_000, 22_000)  # 0.21: the versions whose structures layout.py describes
_OUT_OF_MEMORY = {5, 6, 7}  # ufbx_error_type: memory, memory limit, allocation limit
_RIGHT_Y_FRONT = (0, 2, 4)  # +X to the right, +Y up, +Z to the front
_DEPTH = 1000
_FBX = 1
_KEEP_BYTES = 5  # ufbx_unicode_error_handling: strings are returned as in the file
_TURNS = (b"RotationOrder", b"PreRotation", b"PostRotation")


@functools.cache
def _library() -> ctypes.CDLL:
    spec = importlib.util.find_spec("ufbx")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        for path in sorted(Path(folder).glob("_*.so")):
            found = ctypes.CDLL(str(path))
            if hasattr(found, "ufbx_load_memory"):
                return _declared(found)
    raise SceneError(
        Sentence("fbx-ufbx-not-installed", "FBX files need the package ufbx, which is not installed: pip install ufbx")
    )


def _declared(library: ctypes.CDLL) -> ctypes.CDLL:
    version = ctypes.c_uint32.in_dll(library, "ufbx_source_version").value
    if version not in _KNOWN:
        said = f"{version // 1_000_000}.{version // 1000 % 1000}.{version % 1000}"
        raise SceneError(
            Sentence(
                "fbx-ufbx-too-old",
                "The installed ufbx contains version {version} of its library, but FBX files need 0.21 or "
                "later: pip install -U ufbx",
                version=said,
            )
        )
    opened: Any = ctypes.POINTER(layout.Scene)
    library.ufbx_load_memory.restype = opened
    library.ufbx_load_memory.argtypes = [
        ctypes.c_char_p,
        ctypes.c_size_t,
        ctypes.POINTER(layout.LoadOptions),
        ctypes.POINTER(layout.Error),
    ]
    library.ufbx_evaluate_scene.restype = opened
    library.ufbx_evaluate_scene.argtypes = [
        opened,
        ctypes.c_void_p,
        ctypes.c_double,
        ctypes.POINTER(layout.EvaluateOptions),
        ctypes.POINTER(layout.Error),
    ]
    library.ufbx_create_anim.restype = ctypes.c_void_p
    library.ufbx_create_anim.argtypes = [opened, ctypes.POINTER(layout.AnimOptions), ctypes.POINTER(layout.Error)]
    library.ufbx_free_anim.restype = None
    library.ufbx_free_anim.argtypes = [ctypes.c_void_p]
    library.ufbx_free_scene.restype = None
    library.ufbx_free_scene.argtypes = [opened]
    library.ufbx_evaluate_curve.restype = ctypes.c_double
    library.ufbx_evaluate_curve.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_double]
    library.ufbx_find_bool_len.restype = ctypes.c_bool
    library.ufbx_find_bool_len.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t, ctypes.c_bool]
    library.ufbx_find_real_len.restype = ctypes.c_double
    library.ufbx_find_real_len.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t, ctypes.c_double]
    return library


class FbxScene:
    """A scene in ufbx's memory, which is freed with this object. Arrays that were copied from the scene remain valid."""

    def __init__(self, pointer: Any) -> None:
        self._pointer = pointer
        self.scene = pointer.contents
        self._made: dict[tuple[int, ...], int] = {}  # animations by their layers

    def __del__(self) -> None:
        for anim in self._made.values():
            _library().ufbx_free_anim(anim)
        _library().ufbx_free_scene(self._pointer)

    @classmethod
    def parse(cls, data: bytes, name: str) -> FbxScene:
        """Parses a file's bytes into a scene in metres with Y up. Opens no other file.

        Raises SceneError if the file is damaged, MemoryError if memory is exhausted.
        """
        options = layout.LoadOptions()
        options.blender_pbr = True
        options.connect_broken = options.make_normals = options.normalize = options.clean_skin_weights = True
        options.depth_limit = _DEPTH
        options.axes.right, options.axes.up, options.axes.front = _RIGHT_Y_FRONT
        options.unit_meters = 1.0
        options.format = _FBX
        options.unsafe, options.unicode_errors = True, _KEEP_BYTES
        error = layout.Error()
        found = _library().ufbx_load_memory(data, len(data), ctypes.byref(options), ctypes.byref(error))
        return cls(found) if found else _raise_error(error, name)

    def evaluate(self, anim: int, seconds: float, name: str) -> FbxScene:
        """Returns a copy of the scene with an animation's values at a time in seconds.

        anim: address of the animation; name: name of the file, for errors. Raises SceneError if ufbx cannot create the copy.
        """
        options, error = layout.EvaluateOptions(), layout.Error()
        found = _library().ufbx_evaluate_scene(self._pointer, anim, seconds, ctypes.byref(options), ctypes.byref(error))
        return FbxScene(found) if found else _raise_error(error, name)

    def combined_animation(self, layers: list[int], name: str) -> int:
        """Returns the address of an animation that combines layers of the scene, the last on top, and respects RotationActive.

        Raises SceneError if ufbx cannot create it.
        """
        key = tuple(layers)
        if key not in self._made:
            numbers = (ctypes.c_uint32 * len(layers))(*layers)
            options, error = layout.AnimOptions(), layout.Error()
            options.layers.data, options.layers.count = ctypes.addressof(numbers), len(layers)
            nodes_with_ignored_rotation = self.nodes_with_ignored_rotation
            overrides = (layout.PropOverride * (len(nodes_with_ignored_rotation) * len(_TURNS)))()
            names = [ctypes.create_string_buffer(each) for each in _TURNS]
            for i, override in enumerate(overrides):
                override.element = nodes_with_ignored_rotation[i // len(_TURNS)]
                turn = i % len(_TURNS)
                override.name.data, override.name.count = ctypes.addressof(names[turn]), len(_TURNS[turn])
            options.overrides.data, options.overrides.count = ctypes.addressof(overrides), len(overrides)
            made = _library().ufbx_create_anim(self._pointer, ctypes.byref(options), ctypes.byref(error))
            self._made[key] = made or int(_raise_error(error, name))
        return self._made[key]

    @functools.cached_property
    def nodes_with_ignored_rotation(self) -> list[int]:
        """Returns the ids of nodes on which this version of ufbx wrongly applies rotation order, pre-rotation and post-rotation.

        The FBX SDK ignores these three on nodes without RotationActive or with RotationSpaceForLimitOnly; so does ufbx from 0.23
        on.
        """
        return [
            node.element_id
            for node in pointed(self.scene.nodes, layout.Node)
            if not is_set(node, b"RotationActive", True) or is_set(node, b"RotationSpaceForLimitOnly")
        ]


_MESSAGES: dict[str, str] = {
    str.__str__(each): each
    for each in (
        Sentence("ufbx-empty-file", "Empty file"),
        Sentence("ufbx-truncated-file", "Truncated file"),
        Sentence("ufbx-memory-limit", "Memory limit exceeded"),
        Sentence("ufbx-input-output", "IO error"),
        Sentence("ufbx-format-unknown", "Unrecognized file format"),
        Sentence("ufbx-vertices-truncated", "Truncated vertex stream"),
        Sentence("ufbx-not-utf8", "Invalid UTF-8"),
        Sentence("ufbx-bad-nurbs", "Bad NURBS geometry"),
        Sentence("ufbx-bad-index", "Bad index"),
        Sentence("ufbx-nodes-too-deep", "Node depth limit exceeded"),
        Sentence("ufbx-version-unsupported", "Unsupported version"),
        Sentence("ufbx-bad-deflate", "Bad DEFLATE data"),
        Sentence("ufbx-index-clamped", "Clamped index"),
        Sentence("ufbx-object-duplicate", "Duplicate object ID"),
        Sentence("ufbx-bad-string", "Bad UTF-8 string"),
        Sentence("ufbx-empty-face", "Empty face has been removed"),
        Sentence("ufbx-unknown", "Unknown error"),
    )
}


def message_of(notice: Any) -> str:
    """Returns the description that ufbx gives of an error or a warning."""
    said = text(notice.description)[:160]
    return _MESSAGES.get(said, said)


def _raise_error(error: Any, name: str) -> Any:
    if error.kind in _OUT_OF_MEMORY:
        raise MemoryError
    raise SceneError(
        Sentence(
            "fbx-file-damaged",
            "{name} is damaged or not an FBX file. Export it again ({error})",
            name=name,
            error=message_of(error),
        )
    )


def text(string: Any) -> str:
    """Returns one of ufbx's strings; bytes that are not UTF-8 become lone surrogates (renderer/scene/text_encoding.py)."""
    return ctypes.string_at(string.data, string.count).decode("utf-8", "surrogateescape") if string.data else ""


def struct_at(kind: Any, address: int | None) -> Any:
    """Returns the structure of type `kind` at an address; None if the address is null."""
    return kind.from_address(address) if address else None


def each(values: Any, kind: Any) -> list[Any]:
    """Returns the elements of one of ufbx's lists, as structures of type `kind`."""
    return [kind.from_address(values.data + i * ctypes.sizeof(kind)) for i in range(values.count)] if values.data else []


def pointed(values: Any, kind: Any, max_count: int | None = None) -> list[Any]:
    """Returns the structures of type `kind` to which one of ufbx's lists of pointers refers.

    Null pointers are skipped. max_count: maximum number of structures to return.
    """
    if not values.data:
        return []
    count = values.count if max_count is None else min(values.count, max_count)
    addresses = (ctypes.c_void_p * count).from_address(values.data)
    return [kind.from_address(address) for address in addresses if address]


def array(values: Any, dtype: Any, width: int = 1) -> npt.NDArray[Any]:
    """Returns a copy of one of ufbx's lists of numbers, as (N,) or, with a width, (N, width)."""
    return list_view(values, dtype, width).copy()


def list_view(values: Any, dtype: Any, width: int = 1) -> npt.NDArray[Any]:
    """Returns a view of one of ufbx's lists of numbers, as (N,) or, with a width, (N, width).

    The view is valid only while the FbxScene exists.
    """
    item = np.dtype(dtype).itemsize * width
    if not values.data or not values.count:
        return np.zeros((0, width) if width > 1 else 0, dtype)
    found = np.frombuffer((ctypes.c_char * (values.count * item)).from_address(values.data), dtype)
    return found.reshape(-1, width) if width > 1 else found


def matrix(values: Any) -> npt.NDArray[np.float64]:
    """Returns a (4, 4) matrix from the library's twelve numbers, which are stored column by column."""
    found = np.eye(4)
    found[:3] = np.array(values, np.float64).reshape(4, 3).T
    return found


def is_set(element: Any, name: bytes, default: bool = False) -> bool:
    """Returns a boolean property of an element; the default if it is absent."""
    return bool(_library().ufbx_find_bool_len(ctypes.addressof(element.props), name, len(name), default))


def number_of(element: Any, name: bytes) -> float:
    """Returns a numeric property of an element; 0 if it is absent."""
    return float(_library().ufbx_find_real_len(ctypes.addressof(element.props), name, len(name), 0.0))


def is_visible(node: Any) -> bool:
    """Returns True if a node is visible.

    Files before FBX 6 store a percentage, which ufbx 0.21 does not convert.
    """
    return bool(node.visible) or abs(number_of(node, b"Visibility")) >= 1


def value_at(curve: int, seconds: float) -> float:
    """Returns the value of an animation curve, given by its address, at a time in seconds."""
    return float(_library().ufbx_evaluate_curve(curve, seconds, 0.0))
