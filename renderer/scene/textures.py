"""Loads a scene's images: each is opened once, missing ones are reported, and their total size is limited."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.image import read
from renderer.scene.description import Image, SceneDescription, SurfaceNote, TexelFilter, Texture, TextureLayer, UvTransform, Wrap
from renderer.scene.files import SceneFiles
from renderer.scene.texture_colors import LINEAR, SRGB, TextureColors
from renderer.scene.udim import atlas_transform, composed_transform, is_tiled, side_by_side, tile_name, tiles_of
from renderer.scene.warning_list import WarningList
from renderer.sentences import Sentence, with_full_stop

__all__ = ["IDENTITY_UV_TRANSFORM", "MAX_IMAGE_BYTES", "TextureShelf"]

IDENTITY_UV_TRANSFORM: UvTransform = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
MAX_IMAGE_BYTES = 4 << 30  # of all decoded images of a scene
_NOTES_ON_COLORS = {"image-primaries-ignored", "image-colour-profile-ignored"}  # not of images whose colour space is known


class TextureShelf:
    """Adds images and textures to a description. Equal images and equal textures get the same index."""

    def __init__(self, description: SceneDescription, files: SceneFiles) -> None:
        self._description = description
        self._files = files
        self._warned = WarningList(description.warnings)
        self._images: dict[tuple[str, bool], int | None] = {}
        self._textures: dict[Texture, int] = {}
        self._bytes = 0
        self.colors = TextureColors(files, self.warn_of_surface)
        self.spectra = description.spectra

    def warn_of_surface(self, sentence: str) -> None:
        """Adds a warning about a material's appearance, unless the description already has it."""
        self.warn(SurfaceNote.from_text(sentence))

    def warn(self, sentence: str) -> None:
        """Adds a warning, unless the description already has it."""
        self._warned.add(sentence)

    def image_file(self, name: str, srgb: bool = True, space: str = "", data: Callable[[], bytes] | None = None) -> int | None:
        """Returns the index of the image in the scene file `name` (from SceneFiles.find); None, with a warning, if unreadable.

        space: as of TextureColors.encoding. data: returns the image's bytes if they are not those of the file `name`; may raise
        SceneError.
        """
        encoding = self.colors.encoding(name, srgb, space)
        if encoding in (SRGB, LINEAR):
            if data is not None:
                return self.computed_image(name, data, encoding == SRGB)
            return self._file_as_stored(name, encoding == SRGB)
        key = (f"\0{name} of {encoding}", True)
        if key not in self._images:
            try:
                pixels = self._pixels(name, name, data or (lambda: self._files.read(name)), is_converted=True)
                self._images[key] = self.add(Image(name, self._converted(pixels, encoding, name), srgb=True))
            except SceneError as error:
                self._images[key] = None
                self.warn_of_surface(Sentence("texture-left-out", "{error}; rendered without it.", error=error))
        return self._images[key]

    def _file_as_stored(self, name: str, srgb: bool) -> int | None:
        key = (name, srgb)
        if key not in self._images:
            try:
                self._images[key] = self.add(Image(name, self._pixels(name, name, lambda: self._files.read(name)), srgb))
            except SceneError as error:
                self._images[key] = None
                self.warn_of_surface(Sentence("texture-left-out", "{error}; rendered without it.", error=error))
        return self._images[key]

    def environment_file(self, name: str, data: Callable[[], bytes] | None = None, space: str = "") -> int | None:
        """Adds the image of an environment and returns its index; None, with a warning, if the image is unreadable.

        Its colours are unchanged unless a colour space applies; it is scaled down if too large. data: returns the image's bytes
        if they are not those of the file `name`; may raise SceneError. space: as of TextureColors.encoding.
        """
        encoding = self.colors.encoding(name, True, space)
        is_stored = encoding in (SRGB, LINEAR)
        key = (f"\0environment {name}{'' if is_stored else f' of {encoding}'}", encoding != LINEAR)
        if key not in self._images:
            try:
                read = data or (lambda: self._files.read(name))
                pixels = self._pixels(f"\0environment {name}", name, read, is_environment=True, is_converted=not is_stored)
                srgb = encoding != LINEAR or pixels.dtype == np.float32
                self._images[key] = self.add(Image(name, self._converted(pixels, encoding, name), srgb))
            except SceneError as error:
                self._images[key] = None
                self.warn_of_surface(Sentence("environment-left-out", "{error}; the environment is left out.", error=error))
        return self._images[key]

    def image_bytes(self, name: str, data: bytes, srgb: bool = True) -> int | None:
        """Returns the index of an image embedded in a scene file; None, with a warning, if unreadable. name: identifies it."""
        return self.computed_image(name, lambda: data, srgb)

    def computed_image(self, name: str, data: Callable[[], bytes], srgb: bool = True) -> int | None:
        """Returns the index of an image whose bytes are computed by `data` when first needed; None, with a warning, if it fails.

        data: may raise SceneError. name: identifies the image.
        """
        key = (f"\0{name}", srgb)
        if key not in self._images:
            try:
                self._images[key] = self.add(Image(name, self._pixels(f"\0{name}", name, data), srgb))
            except SceneError as error:
                self._images[key] = None
                self.warn_of_surface(Sentence("texture-left-out", "{error}; rendered without it.", error=error))
        return self._images[key]

    @property
    def last_warning(self) -> str:
        """Returns the last added warning."""
        return self._description.warnings[-1] if self._description.warnings else ""

    def _pixels(
        self, key: str, name: str, data: Callable[[], bytes], is_environment: bool = False, is_converted: bool = False
    ) -> npt.NDArray[Any]:
        decoded: read.Decoded = self._files.get_or_make(("pixels", key), lambda: read.decode(data(), name, is_environment))
        for note in decoded.notes:
            if not (is_converted and getattr(note, "code", "") in _NOTES_ON_COLORS):
                self.warn_of_surface(with_full_stop(note))
        return decoded.pixels

    def _converted(self, pixels: npt.NDArray[Any], encoding: str, name: str) -> npt.NDArray[Any]:
        """Returns pixels as those of an `Image` with `srgb`, converted once for all frames. encoding: from TextureColors."""
        if encoding in (SRGB, LINEAR):
            return pixels
        key = ("converted", self.colors.own, encoding, id(pixels))
        # The pixels are stored with the result, so that their id is not reused.
        made, _ = self._files.get_or_make(key, lambda: (self.colors.convert(pixels, encoding, name), pixels))
        converted: npt.NDArray[Any] = made
        return converted

    def texture(
        self,
        image: int | None,
        wrap_s: Wrap = "repeat",
        wrap_t: Wrap = "repeat",
        uv_set: int = 0,
        transform: UvTransform = IDENTITY_UV_TRANSFORM,
        layers: tuple[TextureLayer, ...] = (),
        filter: TexelFilter = "linear",
    ) -> int | None:
        """Returns the index of the texture with this image, wrap modes, UV set, UV transform, layers and filter.

        Returns None if `image` is None, as for a missing image.
        """
        if image is None:
            return None
        return self._texture_index(Texture(image, wrap_s, wrap_t, uv_set, transform, layers, filter))

    def _texture_index(self, texture: Texture) -> int:
        if texture not in self._textures:
            self._description.textures.append(texture)
            self._textures[texture] = len(self._description.textures) - 1
        return self._textures[texture]

    def derived_texture(self, texture: int | None, what: str, make: Callable[[Image], Image]) -> int | None:
        """Returns the index of a texture like this one, but with an image computed from its image; None if `texture` is None.

        what: identifies the computation, which is done once per image.
        """
        if texture is None:
            return None
        source = self._description.textures[texture]
        image = self._description.images[source.image]
        key = (f"\0{what} of image {source.image}", image.srgb)
        if key not in self._images:
            self._images[key] = self.add(make(image))
        made = self._images[key]
        return None if made is None else self._texture_index(replace(source, image=made))

    def calculated(self, what: str, sources: list[Image], make: Callable[[], Image]) -> int | None:
        """Returns the index of an image computed from others, cached between frames; None if it fails.

        what: names the computation. The result of an earlier frame is taken if `what` and `sources` are the same, else that of
        `make`.
        """
        key = (f"\0{what}", False)
        if key not in self._images:
            pixels = [source.pixels for source in sources]
            known = ("calculated", what, *map(id, pixels))  # the pixels are stored with it, so that their ids are not reused
            self._images[key] = self.add(self._files.get_or_make(known, lambda: (make(), pixels))[0])
        return self._images[key]

    def with_layers(self, texture: int | None, layers: tuple[TextureLayer, ...]) -> int | None:
        """Returns the index of a texture like this one with these layers; that of the texture itself if there are no layers."""
        if texture is None or not layers:
            return texture
        return self._texture_index(replace(self._description.textures[texture], layers=layers))

    def combined(self, first: int | None, second: int | None, what: str, make: Callable[[Image, Image], Image]) -> int | None:
        """Returns the index of the first texture with an image computed from both textures' images; None if either is missing.

        UV transform, wrap modes and layers are the first texture's. what: identifies the computation.
        """
        if first is None or second is None:
            return None
        other = self._description.textures[second].image
        return self.derived_texture(
            first, f"{what} with image {other}", lambda image: make(image, self._description.images[other])
        )

    def texture_of(self, number: int) -> Texture:
        """Returns the texture with this index."""
        return self._description.textures[number]

    def image_of(self, texture: int) -> Image:
        """Returns the image of a texture."""
        return self._description.images[self._description.textures[texture].image]

    def find(
        self,
        reference: str,
        beside: str,
        user: str,
        srgb: bool = True,
        wrap: Wrap = "repeat",
        transform: UvTransform = IDENTITY_UV_TRANSFORM,
    ) -> int | None:
        """Returns the index of the texture whose file the scene file `beside` names; warns if that is missing.

        reference: the file's name in the scene file. user: the object named in the warning.
        """
        image, place = self.image_and_transform(reference, beside, user, srgb)
        return self.texture(
            image, wrap, wrap, transform=composed_transform(transform, place) if place != IDENTITY_UV_TRANSFORM else transform
        )

    def image_and_transform(self, reference: str, beside: str, user: str, srgb: bool = True) -> tuple[int | None, UvTransform]:
        """Returns the index of the image to which the scene file `beside` refers, and the UV transform into it.

        The image may be combined from UDIM tiles. If it is missing, the index is None and a warning names it and its `user`.
        """
        if not is_tiled(reference):
            name = self._files.find(reference, beside)
            if name is None:
                self.warn_of_missing(reference, user)
                return None, IDENTITY_UV_TRANSFORM
            return self.image_file(name, srgb), IDENTITY_UV_TRANSFORM
        tiles = tiles_of(reference, lambda name: self._files.find(name, beside))
        if not tiles:
            self.warn_of_missing(tile_name(reference, 1001), user)
            return None, IDENTITY_UV_TRANSFORM
        return self.tiles(reference, tiles, self._files.read, srgb), atlas_transform(tiles)

    def tiles(
        self, reference: str, tiles: dict[int, str], data: Callable[[str], bytes], srgb: bool, space: str = ""
    ) -> int | None:
        """Returns the index of the image that combines UDIM tiles; None, with a warning, if one is unreadable.

        tiles: file name by tile number. data: returns a file's bytes. space: as of TextureColors.encoding, of all tiles.
        """
        encoding = self.colors.encoding(next(iter(tiles.values())), srgb, space)
        is_srgb = encoding != LINEAR

        def read_tiles() -> npt.NDArray[Any]:
            pixels = {number: self.colors.convert(read.read(data(name), name), encoding, name) for number, name in tiles.items()}
            return side_by_side(pixels, is_srgb)

        key = (f"\0tiles {tiles} {encoding}", is_srgb)
        if key not in self._images:
            try:
                pixels = self._files.get_or_make(("tiles", tuple(tiles.values()), encoding), read_tiles)
                self._images[key] = self.add(Image(reference, pixels, is_srgb))
            except SceneError as error:
                self._images[key] = None
                self.warn_of_surface(Sentence("texture-left-out", "{error}; rendered without it.", error=error))
        return self._images[key]

    def warn_of_missing(self, reference: str, user: str) -> None:
        """Warns about a texture that is not among the files."""
        wanted = PurePosixPath(reference.strip().replace("\\", "/")).name or reference[:80]
        self.warn_of_surface(
            Sentence(
                "texture-file-missing",
                "{user}: its texture {texture} is not among the files; add it. Rendered in the base colour until then.",
                user=user,
                texture=wanted[:120],
            )
        )

    def add(self, image: Image) -> int:
        """Adds an image. Raises SceneError if all images together are too large."""
        self._bytes += image.pixels.nbytes
        if self._bytes > MAX_IMAGE_BYTES:
            raise SceneError(
                Sentence(
                    "scene-images-too-large",
                    "{name}: with it the scene's images need more than {most_gib} GiB; make them smaller",
                    name=image.name,
                    most_gib=MAX_IMAGE_BYTES >> 30,
                )
            )
        self._description.images.append(image)
        return len(self._description.images) - 1
