"""Reads the images of FBX materials, embedded in the file or in separate files."""

from __future__ import annotations

import ctypes
import math
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.image.read import IMAGE_SUFFIXES
from renderer.scene.description import UvTransform, Wrap
from renderer.scene.files import SceneFiles
from renderer.scene.readers.fbx import layout
from renderer.scene.readers.fbx.library import each, matrix, pointed, text
from renderer.scene.textures import IDENTITY_UV_TRANSFORM, TextureShelf
from renderer.scene.udim import composed_transform, is_tiled, tiles_of
from renderer.sentences import Sentence

__all__ = ["Pictures"]

_WRAPS: tuple[Wrap, Wrap] = ("repeat", "clamp")
_FILE, _LAYERED = 0, 1


class Pictures:
    """Adds the file's textures to the scene description; each keeps the name of the UV set that it uses."""

    def __init__(self, scene: Any, main: str, files: SceneFiles, shelf: TextureShelf, by_blender: bool = False) -> None:
        self._main, self._files, self._shelf, self._by_blender = main, files, shelf, by_blender
        self._sets: dict[str, int] = {}
        for mesh in pointed(scene.meshes, layout.Mesh):
            for i, uv_set in enumerate(each(mesh.uv_sets, layout.UvSet)):
                self._sets.setdefault(text(uv_set.name), i)

    def find(self, address: int | None, user: str, srgb: bool) -> int | None:
        """Returns the scene description's index of the texture at an address; None, with a warning, if its image is missing.

        user: the material named in warnings. srgb: whether the image is sRGB-encoded.
        """
        if not address:
            return None
        source = layout.Texture.from_address(address)
        files = pointed(source.files, layout.Texture)
        if source.kind != _FILE or not files:
            self._shelf.warn_of_surface(_unread_warning(user, source.kind == _LAYERED, bool(files)))
        if not files:
            return None
        picture = files[0]
        wraps = [_WRAPS[1 if way == 1 else 0] for way in (picture.wrap_u, picture.wrap_v)]
        uv_set = self._sets.get(text(picture.uv_set), 0)
        if uv_set > 1:
            self._shelf.warn_of_surface(
                Sentence(
                    "fbx-texture-uv-set-unread",
                    "{user}: a texture uses the UV set {uv_set}; only a mesh's first two UV sets are read. "
                    "The first is used instead.",
                    user=user,
                    uv_set=text(picture.uv_set)[:60],
                )
            )
            uv_set = 0
        place = _transform(picture, self._by_blender)
        image, tiled = self._image(picture, user, srgb)
        return self._shelf.texture(image, wraps[0], wraps[1], uv_set, composed_transform(place, tiled))

    def _image(self, picture: Any, user: str, srgb: bool) -> tuple[int | None, UvTransform]:
        said = [text(name) for name in (picture.relative, picture.filename, picture.absolute)]
        named = [name for name in said if name]
        if picture.content.count:
            names = [name.replace("\\", "/").rsplit("/", 1)[-1] for name in (*named, text(picture.name), "picture") if name]
            name = next((each for each in names if PurePosixPath(each).suffix.lower() in IMAGE_SUFFIXES), names[0])
            data = ctypes.string_at(picture.content.data, picture.content.count)
            return self._shelf.image_bytes(f"{self._main} ({picture.element_id}): {name}", data, srgb), IDENTITY_UV_TRANSFORM
        for name in named:
            tiles = tiles_of(name, lambda each: self._files.find(each, self._main)) if is_tiled(name) else None
            if tiles or (tiles is None and self._files.find(name, self._main) is not None):
                return self._shelf.image_and_transform(name, self._main, user, srgb)
        self._shelf.warn_of_missing(named[0] if named else text(picture.name), user)
        return None, IDENTITY_UV_TRANSFORM


def _transform(picture: Any, by_blender: bool) -> UvTransform:
    """Returns the texture's UV transform, for v measured downwards from the upper edge.

    FBX's matrix M takes v upwards, so v is flipped before and after M. by_blender: the file is from Blender, which writes M
    differently.
    """
    if not picture.has_transform:
        return IDENTITY_UV_TRANSFORM
    m = matrix(picture.uv_to_texture)
    if not np.isfinite(m).all():
        return IDENTITY_UV_TRANSFORM
    if by_blender:
        m = _blender_matrix(m)
    (a, b, c), (d, e, f) = m[0, [0, 1, 3]], m[1, [0, 1, 3]]
    found = (a, -b, b + c, -d, e, 1 - e - f)
    first, second, third, fourth, fifth, sixth = (float(x) for x in found)
    return first, second, third, fourth, fifth, sixth


def _blender_matrix(m: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Returns the matrix of Blender's Mapping node: t = R S uv + T, with R in radians.

    Blender's exporter writes these T, S and R into FBX's fields, which mean degrees and t = S R (uv - T).
    """
    scale = [math.copysign(math.hypot(*m[k, :2]), m[k, k]) for k in (0, 1)]
    if not all(scale):
        return m
    turn = math.degrees(math.atan2(-m[0, 1] / scale[0], m[0, 0] / scale[0]))
    moved = -np.linalg.solve(m[:2, :2], m[:2, 3])
    made = np.eye(4)
    made[:2, :2] = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]) * scale
    made[:2, 3] = moved
    return made


def _unread_warning(user: str, is_layered: bool, has_image: bool) -> str:
    if has_image and is_layered:
        return Sentence("fbx-layers-first-shown", "{user}: a texture has layers; only its lowest image is shown.", user=user)
    if has_image:
        return Sentence("fbx-nodes-first-shown", "{user}: a texture is made by nodes; only its first image is shown.", user=user)
    if is_layered:
        return Sentence("fbx-layers-dropped", "{user}: a texture has layers without an image; it is left out.", user=user)
    return Sentence("fbx-nodes-dropped", "{user}: a texture is made by nodes without an image; it is left out.", user=user)
