"""Exports the images of one material: unchanged, or repacked where glTF needs several of them in one image."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from . import images
from .image_nodes import LUMINANCE
from .model import Scene, TextureUse
from .textures import GREY, Value

__all__ = ["Pictures"]


class Pictures:
    """Exports the images of one material.

    as_color, in all methods: True if the image contains colours; False if it contains data.
    """

    def __init__(self, scene: Scene, name: str) -> None:
        self._scene, self._name = scene, name

    def name(self, value: Value, as_color: bool, deep: bool = False) -> str | None:
        """Exports the image of a Value and returns the image's file name; None if the image has no pixels."""
        return images.register(self._scene, value.image, as_color, deep)

    def image_use(self, value: Value, as_color: bool, deep: bool = False) -> Any:
        """Returns the TextureUse of the image of a Value, with all channels; None if the image has no pixels.

        deep: whether an image that has to be converted has 16 bits per channel, as heights need, not 8.
        """
        if value.inverted:
            return self.packed([(value, 0), (value, 1), (value, 2)], value, as_color)
        name = self.name(value, as_color, deep)
        return None if name is None or value.use is None else replace(value.use, image=name)

    def packed(self, channels: list[tuple[Value | None, int]], mapped_value: Value, as_color: bool) -> TextureUse | None:
        """Returns the TextureUse of a new image that combines one channel of each value; None if there are no pixels.

        channels: (value, channel). mapped_value: the value whose mapping is used.
        """
        planes: dict[int, np.ndarray] = {}
        names = []
        for value, channel in channels:
            if value is None or value.image is None:
                continue
            found = images.pixels(value.image)
            if found is None:
                continue
            names.append(value.image.name)
            which = channel if value.channel is None else value.channel
            if which == GREY:
                plane = images.encoded(found[..., :3], images.encoding_of(value.image, False)) @ LUMINANCE
            else:
                plane = found[..., which]
            if which != GREY and channel < 3 and which < 3:
                plane = images.encoded(plane, images.encoding_of(value.image, as_color))
            planes[channel] = 1 - plane if value.inverted else plane
            if value.use != mapped_value.use and value.image != mapped_value.image:
                self._scene.warn(f"Material {self._name}: pictures that lie differently are laid as one of them.")
        if not planes or mapped_value.use is None:
            return None
        height, width = max(plane.shape for plane in planes.values())
        whole = np.ones((height, width, 4), np.float32)
        for channel, plane in planes.items():
            rows, columns = (np.arange(n) * plane.shape[i] // n for i, n in enumerate((height, width)))
            whole[..., channel] = plane[rows][:, columns]
        return replace(mapped_value.use, image=images.add_pixels(self._scene, " ".join([self._name, *names]), whole))
