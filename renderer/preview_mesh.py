"""The preview mesh of a scene: what a viewer draws until there are path-traced samples. Its packet is protocol/mesh.py."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.settings import Vec3

__all__ = ["NO_TEXTURE", "PreviewLamp", "PreviewMaterial", "PreviewMesh", "PreviewPart", "PreviewTexture"]

F32 = npt.NDArray[np.float32]
NO_TEXTURE = -1
OMNI = (-2.0, -1.0)  # cosines of a lamp that shines in all directions


class PreviewMaterial(NamedTuple):
    """A surface. Its base colour and opacity are in the colours of the vertices, which the texture multiplies.

    f0: reflectance of its dielectric part at normal incidence. transmission: part of the light that is not reflected and passes
    through, tinted with the base colour. thin: passes without refraction. emission: radiance. unlit: shows its base colour.
    alpha_mode: as in glTF. Textures are numbers, or NO_TEXTURE: of the base colour and opacity, of roughness (green) and metal
    (blue), which multiply, and of emission.
    """

    metallic: float = 0.0
    roughness: float = 1.0
    f0: Vec3 = (0.0, 0.0, 0.0)
    transmission: float = 0.0
    ior: float = 1.5
    thin: bool = False
    coat: float = 0.0
    coat_roughness: float = 0.0
    emission: Vec3 = (0.0, 0.0, 0.0)
    unlit: bool = False
    alpha_mode: Literal["opaque", "mask", "blend"] = "opaque"
    cutoff: float = 0.5
    texture: int = NO_TEXTURE
    metallic_roughness_texture: int = NO_TEXTURE
    emission_texture: int = NO_TEXTURE


class PreviewPart(NamedTuple):
    """Consecutive triangles of one material: `corners`, three a triangle, from corner `first` on."""

    first: int
    corners: int
    material: int


class PreviewTexture(NamedTuple):
    """An image file, reduced for a preview."""

    data: bytes
    type: str  # media type
    wrap_s: str = "repeat"  # repeat, mirror or clamp
    wrap_t: str = "repeat"
    nearest: bool = False  # texels are squares of constant colour


class PreviewLamp(NamedTuple):
    """A lamp. at: its place, or if it is far away the direction to it.

    color: radiance that it gives a white surface at the middle of the scene's bounds that faces it. axis: the direction in which
    it shines; its light falls off linearly between the inner and the outer cosine, which are `cosines` from the outer one.
    """

    at: Vec3
    far: bool
    color: Vec3
    axis: Vec3 = (0.0, 0.0, 0.0)
    cosines: tuple[float, float] = OMNI


class PreviewMesh(NamedTuple):
    """Triangles in world space, with V vertices and T triangles, their materials, and the light.

    normals: unit vectors, or 0 for flat shading. colors: sRGB and opacity. uvs: of the textures, whose origin is the upper left
    corner; None: there are no textures. environment: equirectangular radiance in the layout of Environment, unrotated; (1, 1, 3)
    if constant, None if black. studio: whether it is the light that scenes without lights are given.
    """

    positions: npt.NDArray[np.float64]  # (V, 3)
    normals: F32  # (V, 3)
    colors: npt.NDArray[np.uint8]  # (V, 4)
    triangles: npt.NDArray[np.uint32]  # (T, 3)
    uvs: F32 | None = None  # (V, 2)
    parts: tuple[PreviewPart, ...] = ()  # all triangles
    materials: tuple[PreviewMaterial, ...] = ()
    textures: tuple[PreviewTexture, ...] = ()
    lamps: tuple[PreviewLamp, ...] = ()
    environment: F32 | None = None  # (h, w, 3)
    studio: bool = False
