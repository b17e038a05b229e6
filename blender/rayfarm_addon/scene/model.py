"""The exported scene, in Blender's axes and units, as plain arrays. Independent of Blender."""

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
    """Converts a point or direction from Blender's axes to the farm's, with Y up."""
    x, y, z = (float(c) for c in vector)
    return [x, z, -y]


@dataclass
class Mesh:
    """Triangles, with one part for each material slot.

    shapes: positions and normals at the shutter's keys, for deforming meshes.
    """

    key: str
    positions: F32  # (V, 3)
    parts: list[tuple[int, U32]]  # a slot, and (3 T,) corners
    normals: F32 | None = None  # (V, 3); None: flat
    uvs: tuple[F32, ...] = ()  # (V, 2) each, v downwards
    colors: F32 | None = None  # (V, 4) linear
    shapes: tuple[tuple[F32, F32 | None], ...] = ()


@dataclass
class Node:
    """An instance of a mesh. materials: keys by slot. places: at the shutter's keys, if it moves. number: its pass index.

    unseen: by the camera. shadeless: does not block the light of lamps.
    """

    name: str
    mesh: str
    materials: tuple[str, ...]
    place: F64  # (4, 4)
    places: tuple[F64, ...] = ()
    number: int = 0
    unseen: bool = False
    shadeless: bool = False


@dataclass(frozen=True)
class Image:
    """An image file. content: its bytes, or its path."""

    name: str
    content: bytes | Path


@dataclass(frozen=True)
class TextureUse:
    """The use of an image on a surface, in glTF's terms."""

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
    """The glTF JSON of a material, with a TextureUse in place of each texture object."""

    name: str
    gltf: dict[str, Any] = field(default_factory=dict)
    number: int = 0  # its pass index


@dataclass
class World:
    """The environment light.

    Part of the request, so that changing it needs no new scene. rotation: degrees about the farm's up axis.
    """

    color: list[float] | None = None
    image: Image | None = None
    sky: dict[str, Any] | None = None  # as a scene file has it, whose it is: no request says as much
    strength: float = 1.0
    rotation: float = 0.0
    medium: dict[str, Any] | None = None  # what fills it, as a scene file has it


@dataclass
class Scene:
    """A frame's scene without the view. times: of the shutter's keys, in seconds of the file's clock."""

    meshes: dict[str, Mesh] = field(default_factory=dict)
    nodes: list[Node] = field(default_factory=list)
    materials: dict[str, Material] = field(default_factory=dict)
    images: dict[str, Image] = field(default_factory=dict)
    lights: list[dict[str, Any]] = field(default_factory=list)  # as a scene file has them
    lamps: list[dict[str, Any]] = field(default_factory=list)  # shapes that shine, as a scene file has them
    lamp_materials: dict[str, dict[str, Any]] = field(default_factory=dict)
    world: World = field(default_factory=World)
    cameras: list[dict[str, Any]] = field(default_factory=list)  # with keys, where the camera moves while the shutter is open
    times: tuple[float, ...] = ()
    warnings: list[str] = field(default_factory=list)

    def tell(self, what: str) -> None:
        """Adds a warning, given without its full stop; see `warn`."""
        self.warn(f"{what}.")

    def warn(self, sentence: str) -> None:
        """Adds a warning about a difference from Blender, once."""
        if sentence not in self.warnings:
            self.warnings.append(sentence)
