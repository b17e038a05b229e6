"""Merges the UV transforms that textures have at several times while the shutter is open into keys.

Readers store equal textures once. Two textures that are equal at one time and differ at another therefore have a single index
in one description and two in the other, so textures are matched by the material slots that use them, not by index.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from renderer.scene.description import Material, SceneDescription, Texture
from renderer.scene.material import PARAMETERS
from renderer.scene.scene_equality import are_equal

__all__ = ["merge_moving_textures"]

_SLOTS = tuple(parameter.name for parameter in PARAMETERS if parameter.form == "texture")

_Over = list[tuple[SceneDescription, int]]  # a texture at each time: the scene and the texture's index in it


def merge_moving_textures(
    middle: SceneDescription, found: Sequence[SceneDescription]
) -> tuple[SceneDescription, list[SceneDescription], bool]:
    """Merges the textures of a scene at several times into textures whose UV transforms have keys.

    middle: the scene in the middle of the shutter interval. found: the scene at each key time. Returns (`middle` with the merged
    textures, the other descriptions with materials that refer to those textures, whether anything but the transform of a
    texture changes). Such a change is ignored: the texture stays as in the middle.
    """
    every = [middle, *found]
    if all(are_equal(each.textures, middle.textures) for each in found):
        return middle, list(found), False
    if any(len(each.materials) != len(middle.materials) for each in found):
        return middle, list(found), True
    shelf = _MovingTextures()
    materials: list[list[Material]] = [[] for _ in every]
    for over in zip(*(each.materials for each in every), strict=True):
        slots = {slot: [getattr(material, slot) for material in over] for slot in _SLOTS}
        used = {slot: numbers for slot, numbers in slots.items() if numbers[0] is not None}
        named = {slot: shelf.number([*zip(every, numbers, strict=True)]) for slot, numbers in used.items() if None not in numbers}
        lost = {slot: shelf.number([(middle, numbers[0])]) for slot, numbers in used.items() if None in numbers}
        materials[0].append(replace(over[0], **named, **lost))
        for of_moment, material in zip(materials[1:], over[1:], strict=True):
            of_moment.append(replace(material, **named))
    others = [replace(each, materials=own) for each, own in zip(found, materials[1:], strict=True)]
    return replace(middle, materials=materials[0], textures=shelf.textures), others, shelf.changes


class _MovingTextures:
    """List of the textures of a moving scene, with a transform for each key of the shutter; equal textures are stored once."""

    def __init__(self) -> None:
        self.textures: list[Texture] = []
        self.changes = False
        self._numbers: dict[Texture, int] = {}

    def number(self, keyed_textures: _Over) -> int:
        """Adds a texture that may move, and returns its index.

        keyed_textures: for each time, the middle first, the scene description and the texture's index there.
        """
        textures = [scene.textures[number] for scene, number in keyed_textures]
        own = textures[0]
        if any(_static_properties(each) != _static_properties(own) for each in textures):
            self.changes = True
            textures, keyed_textures = [own], keyed_textures[:1]
        scenes = [scene for scene, _ in keyed_textures]
        layers = []
        for i, layer in enumerate(own.layers):
            beneath = [each.layers[i].texture for each in textures]
            layers.append(replace(layer, texture=self.number([*zip(scenes, beneath, strict=True)])))
        places = tuple(each.transform for each in textures[1:])
        keys = places if any(place != own.transform for place in places) else ()
        texture = replace(own, layers=tuple(layers), keys=keys)
        if texture not in self._numbers:
            self._numbers[texture] = len(self.textures)
            self.textures.append(texture)
        return self._numbers[texture]


def _static_properties(texture: Texture) -> object:
    """Returns the properties of a texture that cannot have keys: all except its transform."""
    layers = tuple((layer.blend, layer.strength) for layer in texture.layers)
    return texture.image, texture.wrap_s, texture.wrap_t, texture.uv_set, texture.filter, layers
