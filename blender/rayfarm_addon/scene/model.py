"""The exported scene as plain arrays, in Blender's axes and units. Independent of Blender."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["TO_Y_UP", "Image", "Material", "Mesh", "Node", "Scene", "TextureUse", "World", "to_y_up"]

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
U32 = npt.NDArray[np.uint32]

TO_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def to_y_up(vector: Any) -> list[float]:
    """Converts a point or direction from Blender's axes (Z up) to the farm's (Y up)."""
    x, y, z = (float(c) for c in vector)
    return [x, z, -y]


@dataclass
class Mesh:
    """A triangle mesh, with one part for each material slot.

    shapes: positions and normals at the shutter's keys; empty if the mesh does not deform.
    """

    key: str
    positions: F32  # (V, 3)
    parts: list[tuple[int, U32]]  # a slot, and (3 T,) corners
    normals: F32 | None = None  # (V, 3); None: flat
    uvs: tuple[F32, ...] = ()  # (V, 2) each, v downwards
    colors: F32 | None = None  # (V, 4) linear
    fibres: F32 | None = None  # (V, 4) of hair: its direction and diameter
    shapes: tuple[tuple[F32, F32 | None], ...] = ()


@dataclass
class Node:
    """An instance of a mesh.

    materials: material keys by slot. place: the instance's transform. places: if the instance moves, its transforms at the
    shutter's keys. number: the object's pass index. hidden_from: the kinds of rays that
    do not see the instance. matte: "holdout", "shadow_catcher", or empty.
    """

    name: str
    mesh: str
    materials: tuple[str, ...]
    place: F64  # (4, 4)
    places: tuple[F64, ...] = ()
    number: int = 0
    hidden_from: tuple[str, ...] = ()
    matte: str = ""


@dataclass(frozen=True)
class Image:
    """An image file. content: its bytes, or its path."""

    name: str
    content: bytes | Path


@dataclass(frozen=True)
class TextureUse:
    """An image as it is applied to a surface: the file, the mapping and the other properties of a glTF texture reference."""

    image: str
    uv_set: int = 0
    wrap: tuple[str, str] = ("repeat", "repeat")
    nearest: bool = False
    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)
    strength: float | None = None  # of a normal map


@dataclass
class Material:
    """A material as glTF JSON, with a TextureUse in place of each texture object."""

    name: str
    gltf: dict[str, Any] = field(default_factory=dict)
    number: int = 0  # its pass index


@dataclass
class World:
    """The environment light exported from Blender's world. rotation: degrees about the farm's up axis.

    The light is sent with the request and not in the scene, so that the scene need not be uploaded again when the light changes.
    """

    color: list[float] | None = None
    image: Image | None = None
    sky: dict[str, Any] | None = None  # in the form of the scene file, which contains it: requests cannot specify as much
    strength: float = 1.0
    rotation: float = 0.0
    medium: dict[str, Any] | None = None  # the medium that fills the world, in the form of the scene file


@dataclass
class Scene:
    """The exported scene of one frame, without the view. times: the shutter's keys, in seconds of the exported file."""

    meshes: dict[str, Mesh] = field(default_factory=dict)
    nodes: list[Node] = field(default_factory=list)
    materials: dict[str, Material] = field(default_factory=dict)
    images: dict[str, Image] = field(default_factory=dict)
    lights: list[dict[str, Any]] = field(default_factory=list)  # in the form of the scene file
    lamps: list[dict[str, Any]] = field(default_factory=list)  # emitting shapes, likewise
    lamp_materials: dict[str, dict[str, Any]] = field(default_factory=dict)
    world: World = field(default_factory=World)
    cameras: list[dict[str, Any]] = field(default_factory=list)  # with keys if the camera moves while the shutter is open
    times: tuple[float, ...] = ()
    warnings: list[str] = field(default_factory=list)

    def add_warning(self, what: str) -> None:
        """Adds a warning; `what` is its sentence without the full stop."""
        self.warn(f"{what}.")

    def warn(self, sentence: str) -> None:
        """Adds a warning about a difference from Blender, unless it is already present."""
        if sentence not in self.warnings:
            self.warnings.append(sentence)
