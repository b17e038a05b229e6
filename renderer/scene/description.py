"""What every reader gives and the compiler takes: a scene in the terms of its author.

Right-handed world space, any up direction. Colours are linear Rec.709; distances are in the file's own unit.
Indices (`material`, `texture`, `image`, `mesh`) point into the lists of the SceneDescription.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from renderer.settings import Vec3, View

__all__ = [
    "Camera",
    "Environment",
    "Image",
    "Instance",
    "Material",
    "MaterialKind",
    "Mesh",
    "SceneDescription",
    "Sphere",
    "Texture",
    "Wrap",
]

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]
MaterialKind = Literal["diffuse", "mirror", "glass", "metallic_roughness"]
Wrap = Literal["repeat", "mirror", "clamp"]


@dataclass
class Image:
    """Pixels (h, w, 4) uint8 (colour is sRGB-encoded where `srgb`), or (h, w, 3) float32 linear for HDR."""

    name: str
    pixels: npt.NDArray[Any]
    srgb: bool = True


@dataclass
class Texture:
    """An image and how it repeats. UV (0, 0) is the image's upper left corner, as in glTF; readers of others flip v."""

    image: int
    wrap_s: Wrap = "repeat"
    wrap_t: Wrap = "repeat"


@dataclass
class Material:
    """A surface. `base_color` is reflectance (diffuse, mirror), tint (glass) or glTF's base colour; textures multiply it.

    metallic_roughness_texture: glTF's packing, linear: G is roughness, B is metallic.
    emission: radiance; emission_texture multiplies it. It leaves the front face (counter-clockwise side, or a sphere's
    outside), and the back face too where `double_sided`. Scattering is the same from both sides in any case.
    """

    name: str = "default"
    kind: MaterialKind = "diffuse"
    base_color: Vec3 = (0.8, 0.8, 0.8)
    base_color_texture: int | None = None
    metallic: float = 0.0
    roughness: float = 1.0
    metallic_roughness_texture: int | None = None
    ior: float = 1.5
    emission: Vec3 = (0.0, 0.0, 0.0)
    emission_texture: int | None = None
    double_sided: bool = False


@dataclass
class Mesh:
    """Triangles in the mesh's own space. normals None: flat shading. uvs None: (0, 0). One material a mesh."""

    name: str
    positions: F32  # (V, 3)
    triangles: I32  # (T, 3)
    normals: F32 | None = None  # (V, 3), need not be unit
    uvs: F32 | None = None  # (V, 2)
    material: int = 0


@dataclass
class Instance:
    """A mesh placed in the world by a 4x4 matrix on column vectors; `material` replaces the mesh's where given."""

    mesh: int
    transform: npt.NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    material: int | None = None


@dataclass
class Sphere:
    """A sphere in world space."""

    center: Vec3
    radius: float
    material: int = 0
    name: str = "sphere"


@dataclass
class Environment:
    """Light from infinitely far: `color` radiance, multiplied by an equirectangular image where one is given.

    The image's middle column looks along -Z and its top row up (+Y) before `rotation`, in degrees about +Y
    (counter-clockwise seen from above). `image` indexes SceneDescription.images (float32 pixels).
    """

    color: Vec3 = (1.0, 1.0, 1.0)
    image: int | None = None
    strength: float = 1.0
    rotation: float = 0.0


@dataclass
class Camera:
    """A named view."""

    name: str
    view: View


@dataclass
class SceneDescription:
    """A whole scene. `defaults` holds settings the file asks for (width, height, spp, max_depth, integrator)."""

    name: str = "scene"
    meshes: list[Mesh] = field(default_factory=list)
    instances: list[Instance] = field(default_factory=list)
    spheres: list[Sphere] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)
    textures: list[Texture] = field(default_factory=list)
    images: list[Image] = field(default_factory=list)
    environment: Environment | None = None
    cameras: list[Camera] = field(default_factory=list)
    up: Vec3 = (0.0, 1.0, 0.0)
    studio_for_accents: bool = False  # without environment and with weak lights, compiling adds the studio's
    defaults: dict[str, Any] = field(default_factory=dict)
    animations: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)  # sentences a person can act on
