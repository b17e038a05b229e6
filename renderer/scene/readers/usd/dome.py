"""Converts UsdLux dome lights to the scene's environment."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import UsdLux

from renderer.scene.description import Environment, SceneDescription
from renderer.scene.matrices import Matrix
from renderer.scene.readers.turned_sky import FROM_PLUS_Z, rotate_environment
from renderer.scene.readers.usd.light_links import has_targets
from renderer.scene.readers.usd.lights import note_black_body, radiance_of
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.textures import Images, color_space
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["add_dome", "is_dome"]

_Z_POLE = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # rotates Y to Z
_LEAST_HEIGHT = 64


def is_dome(prim: Any) -> bool:
    """Returns True if a prim is a dome light."""
    return bool(prim.IsA(UsdLux.DomeLight) or prim.IsA(UsdLux.DomeLight_1))


def add_dome(
    prim: Any, world: Matrix, up: str, images: Images, shelf: TextureShelf, description: SceneDescription, time: Any, notes: Notes
) -> None:
    """Sets the environment from a dome light; of several domes, only the first is used.

    world: transform to world space, Y up. up: the stage's up axis, Y or Z.
    """
    name = str(prim.GetPath())
    if description.environment is not None:
        notes.add(Sentence("usd-dome-lights-several", "Only the first dome light is used; left out are"), name)
        return
    light = UsdLux.LightAPI(prim)
    color = radiance_of(light, time)
    note_black_body(light, time, description.spectra)
    if has_targets(light.GetLightLinkCollectionAPI()):
        notes.add(Sentence("usd-dome-linking-ignored", "Light linking of domes is ignored: they illuminate all objects"), name)
    turned = world[:3, :3] / np.maximum(np.linalg.norm(world[:3, :3], axis=0), 1e-300)
    if prim.IsA(UsdLux.DomeLight_1):
        dome = UsdLux.DomeLight_1(prim)
        axis = str(dome.GetPoleAxisAttr().Get(time))
        if axis == "Z" or (axis == "scene" and up == "Z"):
            turned = turned @ _Z_POLE
    else:
        dome = UsdLux.DomeLight(prim)
    if dome.GetTextureFormatAttr().Get(time) not in ("automatic", "latlong", None):
        notes.add(
            Sentence("usd-dome-texture-format", "Dome lights whose texture is not in latitude-longitude format emit evenly"),
            name,
        )
        description.environment = Environment(color)
        return
    file = dome.GetTextureFileAttr()
    user = Sentence("label-light", "Light {name}", name=prim.GetName())
    found = (
        images.find(file, user, True, time, is_environment=True, space=color_space(file))
        if images.asset_path(file, time)
        else None
    )
    if found is None:
        if images.asset_path(file, time):
            notes.add(
                Sentence("usd-dome-texture-unreadable", "Dome lights whose image cannot be read emit their colour evenly"),
                name,
            )
        description.environment = Environment(color)
        return
    # The centre of a USD image is at +Z; that of an environment image is at -Z.
    turned = turned @ FROM_PLUS_Z
    upright = abs(turned[1, 1] - 1) < 1e-6
    image = found[0]
    if not upright:
        image = shelf.add(rotate_environment(description.images[image], turned, _LEAST_HEIGHT))
        description.environment = Environment(color, image)
        return
    description.environment = Environment(color, image, rotation=math.degrees(math.atan2(turned[0, 2], turned[0, 0])))
