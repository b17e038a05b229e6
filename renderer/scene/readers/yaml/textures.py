"""Reads the textures of a scene file: image files, and generated patterns."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.scene.description import Image, TextureLayer, UvTransform
from renderer.scene.files import SceneFiles
from renderer.scene.readers.yaml.lines import Path, Yaml
from renderer.scene.readers.yaml.values import color, srgb_bytes
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["Textures"]

_CHECKER_PIXELS = 32  # per square, so that edges are sharp to 1/32 of it


class Textures:
    """The textures of a scene file, by name."""

    def __init__(self, document: Yaml, files: SceneFiles, shelf: TextureShelf) -> None:
        self._document, self._files, self._shelf = document, files, shelf
        self._sources: dict[str, dict[str, Any]] = document.data.get("textures", {})
        self._images: dict[tuple[str, bool], int | None] = {}
        for name, source in self._sources.items():
            if ("image" in source) == ("checker" in source):
                raise document.error(("textures", name), Sentence("texture-source-choice", "needs either image or checker"))
            if "image" in source and files.find(source["image"], document.file) is None:
                shelf.warn_of_missing(source["image"], f"Texture {name}")
            if "colorspace" in source and ("encoding" in source or "image" not in source):
                raise document.error(
                    ("textures", name, "colorspace"),
                    Sentence("texture-colorspace-misplaced", "is for an image without an encoding; leave out one of them"),
                )

    def find(self, name: str, path: Path, srgb: bool) -> int | None:
        """Returns the index, in the scene description, of a texture; None if its image is missing.

        name: the texture's name in the file; raises SceneError if it is unknown. srgb: whether the texture is used for colours;
        the texture's own `encoding` takes precedence, and a colour texture's `colorspace`.
        """
        source = self._sources.get(name)
        if source is None:
            known = ", ".join(sorted(self._sources)[:10]) or "none"
            raise self._document.error(
                path,
                Sentence("texture-name-unknown", "there is no texture {name}; known are {known}", name=name[:80], known=known),
            )
        srgb = source.get("encoding", "srgb" if srgb else "linear") == "srgb"
        if (name, srgb) not in self._images:
            self._images[name, srgb] = self._image(name, source, srgb)
        wrap = source.get("wrap", "repeat")
        wrap_s, wrap_t = wrap if isinstance(wrap, list) else (wrap, wrap)
        return self._shelf.texture(
            self._images[name, srgb],
            wrap_s,
            wrap_t,
            source.get("uv_set", 0),
            _transform(source),
            filter=source.get("filter", "linear"),
        )

    def stack(self, entries: str | list[Any], path: Path, srgb: bool) -> int | None:
        """Returns the index of a texture given by name, or as a list of layers from the lowest up; None if the lowest is missing.

        Upper layers whose image is missing are left out.
        """
        if isinstance(entries, str):
            return self.find(entries, path, srgb)
        if not isinstance(entries[0], str):
            raise self._document.error(
                (*path, 0),
                Sentence("texture-list-base-layer", "has nothing beneath it: the first layer must be the name of a texture"),
            )
        lowest = self.find(entries[0], (*path, 0), srgb)
        layers = []
        for i, entry in enumerate(entries[1:], start=1):
            layer: dict[str, Any] = {"texture": entry} if isinstance(entry, str) else entry
            number = self.find(layer["texture"], (*path, i), srgb)
            if number is not None:
                layers.append(TextureLayer(number, layer.get("blend", "over"), float(layer.get("strength", 1))))
        return self._shelf.with_layers(lowest, tuple(layers))

    def _image(self, name: str, source: dict[str, Any], srgb: bool) -> int | None:
        if "image" in source:
            file = self._files.find(source["image"], self._document.file)
            # An encoding is explicit: no file rule of the scene's config applies.
            space = source.get("encoding", source.get("colorspace", "")) if srgb else ""
            return None if file is None else self._shelf.image_file(file, srgb, space)
        squares = source["checker"].get("squares", 8)
        colors = [color(c) for c in source["checker"]["colors"]]
        even, odd = (np.array(srgb_bytes(c) if srgb else [round(255 * v) for v in c], np.uint8) for c in colors)
        i = np.arange(squares * _CHECKER_PIXELS) // _CHECKER_PIXELS
        pixels = np.where(((i[:, None] + i) % 2 == 0)[..., None], even, odd).astype(np.uint8)
        opaque = np.full((*pixels.shape[:2], 1), 255, np.uint8)
        return self._shelf.add(Image(name, np.concatenate([pixels, opaque], axis=2), srgb))


def _transform(source: dict[str, Any]) -> UvTransform:
    # As in KHR_texture_transform: scale, rotation, translation.
    scale = source.get("scale", 1)
    across, down = scale if isinstance(scale, list) else (scale, scale)
    angle = np.radians(source.get("rotate", 0))
    cosine, sine = float(np.cos(angle)), float(np.sin(angle))
    x, y = source.get("offset", (0, 0))
    return cosine * across, sine * down, float(x), -sine * across, cosine * down, float(y)
