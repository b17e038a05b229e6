"""The material sheet: a set of GLB files, each showing one material, glTF extension or light.

Blender and our renderer must make the same picture of each. Each shows a ball on a floor, under a square light and a uniform sky.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.peers.glb import Glb

__all__ = ["SHEET", "write_sheet"]

Json = dict[str, Any]
SHEET: dict[str, Callable[[], Glb]] = {}

_RINGS, _SEGMENTS = 96, 192


def _ball() -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Returns (attributes, triangles) of a sphere of radius 1.

    It is so finely divided that differences in how renderers treat smooth normals do not matter.
    """
    theta = np.arange(_RINGS + 1) * (math.pi / _RINGS)
    phi = np.arange(_SEGMENTS + 1) * (2 * math.pi / _SEGMENTS)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    normals = np.stack([np.sin(t) * np.sin(p), np.cos(t), np.sin(t) * np.cos(p)], -1).reshape(-1, 3)
    uvs = np.stack([p / (2 * math.pi), t / math.pi], -1).reshape(-1, 2)
    corner = (np.arange(_RINGS)[:, None] * (_SEGMENTS + 1) + np.arange(_SEGMENTS)).reshape(-1)
    below = corner + _SEGMENTS + 1
    quads = [np.stack([corner, below, below + 1], 1)[_SEGMENTS * 0 :], np.stack([corner, below + 1, corner + 1], 1)]
    triangles = np.concatenate(
        [quads[0][: -_SEGMENTS or None], quads[1][_SEGMENTS:]]
    )  # one of each two triangles at the poles has no area
    return {"POSITION": normals, "NORMAL": normals, "TEXCOORD_0": uvs}, triangles


def _square(center: tuple[float, ...], u: tuple[float, ...], v: tuple[float, ...]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    c, a, b = (np.array(x, float) for x in (center, u, v))
    normal = np.cross(a, b)
    return {
        "POSITION": np.array([c - a - b, c + a - b, c + a + b, c - a + b]),
        "NORMAL": np.tile(normal / np.linalg.norm(normal), (4, 1)),
        "TEXCOORD_0": np.array([(0, 1), (1, 1), (1, 0), (0, 0)], float),
    }, np.array([(0, 1, 2), (0, 2, 3)])


def _turn(x: float, y: float) -> list[float]:
    """Returns the quaternion of a rotation by x degrees about X, then by y about Y."""
    a, b = math.radians(x) / 2, math.radians(y) / 2
    return [math.sin(a) * math.cos(b), math.cos(a) * math.sin(b), -math.sin(a) * math.sin(b), math.cos(a) * math.cos(b)]


def _stage(lamp: float = 8.0, camera: Json | None = None) -> Glb:
    """Returns a GLB of everything in a picture except the ball: floor, square light and camera.

    lamp: radiance of the light. camera: glTF camera; None: the default one.
    """
    glb = Glb()
    gray = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1], "metallicFactor": 0, "roughnessFactor": 1}}
    # Without specular reflection the floor looks the same on both sides, whatever the ball is.
    gray["extensions"] = {"KHR_materials_specular": {"specularFactor": 0}}
    glb.use("KHR_materials_specular")
    floor = glb.add("materials", {"name": "floor", **gray})
    glb.add_node(mesh=glb.add_mesh(*_square((0, -1.02, 0), (8, 0, 0), (0, 0, -8)), floor), name="floor")
    if lamp:
        glb.use("KHR_materials_emissive_strength")
        black = {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0, "roughnessFactor": 1}
        light = glb.add(
            "materials",
            {
                "name": "lamp",
                "pbrMetallicRoughness": black,
                "emissiveFactor": [1, 0.95, 0.9],
                "doubleSided": True,
                "extensions": {
                    "KHR_materials_emissive_strength": {"emissiveStrength": lamp},
                    "KHR_materials_specular": {"specularFactor": 0},
                },
            },
        )
        glb.add_node(mesh=glb.add_mesh(*_square((-1.5, 3.0, 1.5), (0.9, 0, 0), (0, -0.4, 0.8)), light), name="lamp")
    perspective = {"type": "perspective", "perspective": {"yfov": math.radians(30), "znear": 0.01, "zfar": 100}}
    eye = glb.add("cameras", camera or perspective)
    glb.add_node(camera=eye, translation=[0, 1.7, 5.6], rotation=_turn(-18, 0), name="camera")
    return glb


def _extension(glb: Glb, **extensions: Json) -> Json:
    for name in extensions:
        glb.use(f"KHR_materials_{name}")
    return {"extensions": {f"KHR_materials_{name}": values for name, values in extensions.items()}}


def _sheet_of(
    name: str, color: tuple[float, ...] = (0.8, 0.8, 0.8), metallic: float = 0.0, roughness: float = 0.5, **extensions: Json
) -> None:
    """Registers in SHEET a GLB of a ball with a material of uniform colour. extensions: glTF extensions of the material."""

    def build() -> Glb:
        glb = _stage()
        factors = {"baseColorFactor": [*color, 1], "metallicFactor": metallic, "roughnessFactor": roughness}
        material = {"name": name, "pbrMetallicRoughness": factors}
        if extensions:
            material |= _extension(glb, **extensions)
        glb.add_node(mesh=glb.add_mesh(*_ball(), glb.add("materials", material)), name="ball")
        return glb

    SHEET[name] = build


_GOLD = (1.0, 0.77, 0.34)
_RED = (0.7, 0.1, 0.08)
_sheet_of("rough_white", roughness=1.0)
_sheet_of("plastic_smooth", _RED, roughness=0.1)
_sheet_of("plastic_rough", _RED, roughness=0.5)
_sheet_of("metal_smooth", _GOLD, 1.0, 0.1)
_sheet_of("metal_half_rough", _GOLD, 1.0, 0.4)
_sheet_of("metal_rough", _GOLD, 1.0, 0.9)
_sheet_of("half_metal", _GOLD, 0.5, 0.4)
_sheet_of("ior_low", _RED, roughness=0.2, ior={"ior": 1.2})
_sheet_of("ior_high", _RED, roughness=0.2, ior={"ior": 2.2})
_sheet_of("specular", _RED, roughness=0.2, specular={"specularFactor": 0.6, "specularColorFactor": [0.3, 0.6, 1.0]})
_sheet_of("clearcoat", _RED, 1.0, 0.6, clearcoat={"clearcoatFactor": 1.0, "clearcoatRoughnessFactor": 0.05})
_sheet_of("clearcoat_rough", _RED, 0.0, 1.0, clearcoat={"clearcoatFactor": 0.7, "clearcoatRoughnessFactor": 0.4})
_sheet_of("sheen", (0.2, 0.05, 0.3), roughness=1.0, sheen={"sheenColorFactor": [0.8, 0.7, 0.9], "sheenRoughnessFactor": 0.5})
_CLEAR = (1.0, 1.0, 1.0)
_SOLID = {"thicknessFactor": 1.0}
_sheet_of("glass", _CLEAR, roughness=0.0, transmission={"transmissionFactor": 1}, volume=_SOLID, ior={"ior": 1.5})
_sheet_of("glass_rough", _CLEAR, roughness=0.4, transmission={"transmissionFactor": 1}, volume=_SOLID, ior={"ior": 1.5})
_sheet_of("glass_half", (0.8, 0.6, 0.3), roughness=0.2, transmission={"transmissionFactor": 0.5}, volume=_SOLID)
_sheet_of(
    "glass_attenuating",
    _CLEAR,
    roughness=0.0,
    transmission={"transmissionFactor": 1},
    volume={"thicknessFactor": 1.0, "attenuationDistance": 1.5, "attenuationColor": [0.2, 0.7, 0.9]},
)
# Not stronger, since Cycles compensates the energy loss of isotropic surfaces only, and brushed ones lose more
# (docs/correctness.md).
_sheet_of("anisotropy", _GOLD, 1.0, 0.4, anisotropy={"anisotropyStrength": 0.4, "anisotropyRotation": 0.4})
_sheet_of("unlit", (0.3, 0.5, 0.2), unlit={})


def _case(build: Callable[[], Glb]) -> Callable[[], Glb]:
    SHEET[build.__name__] = build
    return build


def _textured(glb: Glb, material: Json, **factors: Any) -> Glb:
    pbr = {"metallicFactor": 0, "roughnessFactor": 0.5} | factors
    glb.add_node(mesh=glb.add_mesh(*_ball(), glb.add("materials", {"pbrMetallicRoughness": pbr} | material)), name="ball")
    return glb


def _squares(columns: int, rows: int, seed: int, channels: int = 3, size: int = 16) -> np.ndarray:
    """Returns an image of squares of random colours.

    Each square has many texels, so that the renderers' texture filtering differs only at edges of squares.
    """
    codes = np.random.default_rng(seed).integers(20, 250, (rows, columns, channels)).astype(np.uint8)
    return codes.repeat(size, 0).repeat(size, 1)


@_case
def base_color_texture() -> Glb:
    glb = _stage()
    return _textured(glb, {}, baseColorTexture={"index": glb.add_texture(_squares(8, 4, 1))})


@_case
def texture_transform() -> Glb:
    glb = _stage()
    glb.use("KHR_texture_transform")
    transform = {"offset": [0.1, 0.3], "rotation": 0.5, "scale": [1.5, 0.7]}
    texture = {"index": glb.add_texture(_squares(4, 4, 2)), "extensions": {"KHR_texture_transform": transform}}
    return _textured(glb, {}, baseColorTexture=texture)


@_case
def metallic_roughness_texture() -> Glb:
    glb = _stage()
    pixels = _squares(6, 4, 3)
    pixels[..., 2] = np.where(pixels[..., 2] > 128, 255, 0)
    factors = {"metallicFactor": 1, "roughnessFactor": 1, "baseColorFactor": [0.9, 0.6, 0.3, 1]}
    return _textured(glb, {}, **factors, metallicRoughnessTexture={"index": glb.add_texture(pixels)})


@_case
def normal_map() -> Glb:
    y, x = np.meshgrid(np.arange(64) / 64 * 2 * math.pi, np.arange(64) / 64 * 2 * math.pi, indexing="ij")
    n = np.stack([0.3 * np.cos(x * 4), 0.2 * np.cos(y * 3), np.ones_like(x)], -1)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    glb = _stage()
    texture = glb.add_texture(np.rint((n * 0.5 + 0.5) * 255).astype(np.uint8))
    return _textured(glb, {"normalTexture": {"index": texture}}, baseColorFactor=[0.6, 0.6, 0.7, 1])


@_case
def emissive_texture() -> Glb:
    glb = _stage(lamp=0)
    material = {"emissiveFactor": [1, 0.8, 0.6], "emissiveTexture": {"index": glb.add_texture(_squares(6, 3, 4))}}
    material |= _extension(glb, emissive_strength={"emissiveStrength": 4.0})
    return _textured(glb, material, baseColorFactor=[0.1, 0.1, 0.1, 1])


@_case
def alpha_blend() -> Glb:
    glb = _stage()
    return _textured(
        glb, {"alphaMode": "BLEND", "doubleSided": True}, baseColorTexture={"index": glb.add_texture(_squares(6, 4, 5, 4))}
    )


@_case
def alpha_mask() -> Glb:
    glb = _stage()
    pixels = _squares(6, 4, 6, 4)
    pixels[..., 3] = np.where(pixels[..., 3] > 128, 255, 0)
    material = {"alphaMode": "MASK", "alphaCutoff": 0.5, "doubleSided": True}
    return _textured(glb, material, baseColorTexture={"index": glb.add_texture(pixels)})


@_case
def vertex_color() -> Glb:
    glb = _stage()
    attributes, triangles = _ball()
    n = attributes["NORMAL"]
    attributes["COLOR_0"] = np.column_stack([0.5 + 0.5 * n, np.ones(len(n))])
    factors = {"metallicFactor": 0, "roughnessFactor": 1, "baseColorFactor": [0.9, 0.9, 0.9, 1]}
    material = glb.add("materials", {"pbrMetallicRoughness": factors})
    glb.add_node(mesh=glb.add_mesh(attributes, triangles, material), name="ball")
    return glb


@_case
def point_light() -> Glb:
    glb = _stage(lamp=0)
    glb.add_light({"type": "point", "color": [1, 0.8, 0.6], "intensity": 2e4}, translation=[-1.5, 2.5, 2.0])
    return _textured(glb, {}, baseColorFactor=[0.6, 0.6, 0.7, 1], roughnessFactor=1.0)


@_case
def spot_light() -> Glb:
    glb = _stage(lamp=0)
    cone = {"innerConeAngle": 0.39, "outerConeAngle": 0.4}
    glb.add_light(
        {"type": "spot", "color": [0.7, 0.8, 1], "intensity": 5e4, "spot": cone},
        translation=[-2.0, 3.0, 2.0],
        rotation=_turn(-45, -45),
    )
    return _textured(glb, {}, baseColorFactor=[0.6, 0.6, 0.7, 1], roughnessFactor=1.0)


@_case
def directional_light() -> Glb:
    glb = _stage(lamp=0)
    glb.add_light({"type": "directional", "color": [1, 0.9, 0.8], "intensity": 2000.0}, rotation=_turn(-50, -40))
    return _textured(glb, {}, baseColorFactor=[0.6, 0.6, 0.7, 1], roughnessFactor=1.0)


@_case
def orthographic_camera_and_instances() -> Glb:
    glb = _stage(camera={"type": "orthographic", "orthographic": {"xmag": 1.8, "ymag": 1.8, "znear": 0.01, "zfar": 100}})
    factors = {"baseColorFactor": [0.3, 0.5, 0.7, 1], "metallicFactor": 0, "roughnessFactor": 0.5}
    ball = glb.add_mesh(*_ball(), glb.add("materials", {"pbrMetallicRoughness": factors}))
    for i in range(5):
        side = 0.35 + 0.1 * i
        glb.add_node(mesh=ball, translation=[-1.5 + 0.7 * i, side - 1, 0.8 - 0.5 * (i % 2)], scale=[side, side, side * 0.6])
    return glb


def write_sheet(folder: Path) -> dict[str, Path]:
    """Writes all GLBs of the sheet; returns their paths by name."""
    return {name: build().save(folder / f"{name}.glb") for name, build in SHEET.items()}
