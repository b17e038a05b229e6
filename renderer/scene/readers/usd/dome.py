"""UsdLux's dome lights as the environment."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdLux

from renderer.image.tonemap import decode_srgb
from renderer.scene.description import Environment, Image, SceneDescription
from renderer.scene.matrices import Matrix
from renderer.scene.readers.usd.lights import radiance_of
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.textures import Images
from renderer.scene.textures import TextureShelf

__all__ = ["add_dome", "is_dome"]

_Z_POLE = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # Y becomes Z
_LEAST_HEIGHT = 64


def is_dome(prim: Any) -> bool:
    """Whether a prim is light from all around."""
    return bool(prim.IsA(UsdLux.DomeLight) or prim.IsA(UsdLux.DomeLight_1))


def add_dome(
    prim: Any, world: Matrix, up: str, images: Images, shelf: TextureShelf, description: SceneDescription, time: Any, notes: Notes
) -> None:
    """Makes a dome the environment; of several, the first. world: to our space, Y up. up: the stage's axis, Y or Z."""
    name = str(prim.GetPath())
    if description.environment is not None:
        notes.add("Of several dome lights the first is taken; left out are", name)
        return
    light = UsdLux.LightAPI(prim)
    color = radiance_of(light, time)
    turned = world[:3, :3] / np.maximum(np.linalg.norm(world[:3, :3], axis=0), 1e-300)
    if prim.IsA(UsdLux.DomeLight_1):
        dome = UsdLux.DomeLight_1(prim)
        axis = str(dome.GetPoleAxisAttr().Get(time))
        if axis == "Z" or (axis == "scene" and up == "Z"):
            turned = turned @ _Z_POLE
    else:
        dome = UsdLux.DomeLight(prim)
    if dome.GetTextureFormatAttr().Get(time) not in ("automatic", "latlong", None):
        notes.add("Dome lights whose texture is not in latitudes and longitudes shine evenly", name)
        description.environment = Environment(color)
        return
    file = dome.GetTextureFileAttr()
    found = images.find(file, f"Light {prim.GetName()}", True, time) if images.named(file, time) else None
    if found is None:
        description.environment = Environment(color)
        return
    # USD's middle column looks along +Z, ours along -Z.
    turned = turned @ np.diag([-1.0, 1.0, -1.0])
    upright = abs(turned[1, 1] - 1) < 1e-6
    image = found[0]
    if not upright:
        image = shelf.add(_turned(description.images[image], turned))
        description.environment = Environment(color, image)
        return
    description.environment = Environment(color, image, rotation=math.degrees(math.atan2(turned[0, 2], turned[0, 0])))


def _turned(image: Image, turn: Matrix) -> Image:
    """An equirectangular image as it is seen when its sphere is turned."""
    pixels = image.pixels
    if pixels.dtype == np.uint8:
        pixels = (decode_srgb(np.arange(256, dtype=np.float32) / 255) if image.srgb else np.arange(256, dtype=np.float32) / 255)[
            pixels[..., :3]
        ]
    height = max(pixels.shape[0], _LEAST_HEIGHT)
    theta = (np.arange(height) + 0.5)[:, None] * np.pi / height
    phi = (np.arange(2 * height) + 0.5)[None, :] * np.pi / height - np.pi
    directions = np.stack(np.broadcast_arrays(np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)), axis=-1)
    x, y, z = np.moveaxis(directions @ turn, -1, 0)  # by the inverse, which is the transposed
    row = np.arccos(np.clip(y, -1, 1)) / np.pi * pixels.shape[0] - 0.5
    column = (np.arctan2(x, -z) + np.pi) / (2 * np.pi) * pixels.shape[1] - 0.5
    return Image(f"{image.name} turned", _mixed(pixels[..., :3], row, column), srgb=False)


def _mixed(pixels: npt.NDArray[Any], row: npt.NDArray[Any], column: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """Bilinear; around the edge to the left and right."""
    height, width = pixels.shape[:2]
    above, left = np.floor(row).astype(int), np.floor(column).astype(int)
    down, right = (row - above)[..., None], (column - left)[..., None]
    rows = [np.clip(above + k, 0, height - 1) for k in (0, 1)]
    columns = [(left + k) % width for k in (0, 1)]
    upper, lower = (pixels[r, columns[0]] * (1 - right) + pixels[r, columns[1]] * right for r in rows)
    result: npt.NDArray[np.float32] = (upper * (1 - down) + lower * down).astype(np.float32)
    return result
