"""glTF textures (specification 3.8): images in files, data URIs or buffer views, samplers, and KHR_texture_transform."""

from __future__ import annotations

import math
from typing import Any

from renderer.scene.description import TexelFilter, UvTransform, Wrap
from renderer.scene.files import SceneFiles, data_uri
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.faults import DamagedError
from renderer.scene.textures import IDENTITY_UV_TRANSFORM, TextureShelf
from renderer.sentences import Sentence

__all__ = ["EXTENSIONS", "UV_SETS", "Textures", "uv_sets_of"]

_FORMATS = ("EXT_texture_webp", "EXT_texture_avif", "KHR_texture_basisu")  # optional image formats
EXTENSIONS = {*_FORMATS, "KHR_texture_transform"}

_REPEAT, _LINEAR = 10497, 9729
_WRAP: dict[int, Wrap] = {_REPEAT: "repeat", 33648: "mirror", 33071: "clamp"}
_NEAREST = {9728}
_MIN_NEAREST = {9728, 9984, 9986}  # without mipmaps, nearest and linear between mipmaps
UV_SETS: tuple[int, ...] = (0, 1)  # the sets read by default; meshes have two here
_UNSEEN = "occlusionTexture"


def uv_sets_of(material: Any) -> tuple[int, ...]:
    """Returns the numbers of the UV sets that a material's textures use, two at most. material: its JSON."""
    used: set[int] = set()
    left = [material]
    while left:
        value = left.pop()
        if isinstance(value, list):
            left += value
        if not isinstance(value, dict):
            continue
        if "index" in value:
            extensions = value.get("extensions")
            moved = extensions.get("KHR_texture_transform") if isinstance(extensions, dict) else None
            given = moved.get("texCoord") if isinstance(moved, dict) else None
            number = value.get("texCoord", 0) if given is None else given
            used |= {number} if isinstance(number, int) else set()
        left += [each for key, each in value.items() if key not in (_UNSEEN, "extras")]
    if used <= {*UV_SETS}:
        return UV_SETS
    return tuple(sorted(used)[: len(UV_SETS)])


class Textures:
    """The textures of one file, each added to the description at first use."""

    def __init__(self, root: Json, accessors: Accessors, files: SceneFiles, shelf: TextureShelf) -> None:
        self._root, self._accessors, self._files, self._shelf = root, accessors, files, shelf
        self._images = root.objects("images")
        self._samplers = root.objects("samplers")
        self._textures = root.objects("textures")
        self.uv_sets = UV_SETS  # of the current material and its meshes

    def find(self, owner: Json, key: str, user: str, srgb: bool = False) -> int | None:
        """Returns the index, in the scene description, of the texture under a key of a material or extension; None if absent.

        owner: the JSON of the material or extension; user: name of the material, for warnings. srgb: True for colours, which are
        sRGB-encoded; False for linear data. An unusable texture is counted as a fault of the file.
        """
        try:
            return self._find(owner, key, user, srgb)
        except DamagedError as fault:
            owner.faults.add(fault)
            return None

    def _find(self, owner: Json, key: str, user: str, srgb: bool) -> int | None:
        info = owner.object(key)
        if info is None:
            return None
        texture = self._textures[info.integer("index", high=len(self._textures))]
        uv_set = info.integer("texCoord", 0, high=64)
        transform = IDENTITY_UV_TRANSFORM
        extension = info.extension("KHR_texture_transform")
        if extension:
            uv_set = extension.integer("texCoord", uv_set, high=64)
            transform = _uv_transform(extension)
        if uv_set not in self.uv_sets:
            self._shelf.warn_of_surface(
                Sentence(
                    "gltf-uv-set-unread",
                    "Material {name}: a texture uses UV set {uv_set}; only {read} are read. UV set {used} is used instead.",
                    name=user,
                    uv_set=uv_set,
                    read=[*self.uv_sets],
                    used=self.uv_sets[0],
                )
            )
            uv_set = self.uv_sets[0]
        uv_set = self.uv_sets.index(uv_set)
        wrap_s, wrap_t, filter = self._sampler(texture)
        return self._shelf.texture(self._image(texture, user, srgb), wrap_s, wrap_t, uv_set, transform, filter=filter)

    def _sampler(self, texture: Json) -> tuple[Wrap, Wrap, TexelFilter]:
        index = texture.index("sampler", self._samplers)
        if index is None:
            return "repeat", "repeat", "linear"
        sampler = self._samplers[index]
        s, t = (sampler.integer(k, _REPEAT) for k in ("wrapS", "wrapT"))
        for key, value, known in (
            ("wrapS", s, _WRAP),
            ("wrapT", t, _WRAP),
            ("magFilter", sampler.integer("magFilter", _LINEAR), {_LINEAR, *_NEAREST}),
        ):
            if value not in known:
                sampler.replace(
                    key,
                    Sentence("gltf-wrap-unknown", "unknown ({value}) and replaced by REPEAT", value=value)
                    if key != "magFilter"
                    else Sentence("gltf-filter-unknown", "unknown ({value}) and replaced by LINEAR", value=value),
                )
        # A path tracer averages many lookups of a minified texture whatever minFilter is; so minFilter
        # is only used if magFilter is missing.
        nearest = _NEAREST if "magFilter" in sampler else _MIN_NEAREST
        chosen = sampler.integer("magFilter" if "magFilter" in sampler else "minFilter", _LINEAR)
        return _WRAP.get(s, "repeat"), _WRAP.get(t, "repeat"), "nearest" if chosen in nearest else "linear"

    def _image(self, texture: Json, user: str, srgb: bool) -> int | None:
        other = next((found for name in _FORMATS if (found := texture.extension(name))), None)
        index = (other or texture).index("source", self._images)
        if index is None:
            self._shelf.warn_of_surface(
                Sentence(
                    "gltf-texture-format-unknown",
                    "Material {name}: a texture has no image in a supported format; rendered without it.",
                    name=user,
                )
            )
            return None
        image = self._images[index]
        place = f"{self._root.file}: {image.where}"
        if "uri" in image:
            uri = image.text("uri", "")
            if uri.startswith("data:"):
                return self._shelf.image_bytes(place, data_uri(uri, place), srgb)
            name = self._files.resolve_uri(uri, self._root.file)
            if name is None:
                self._shelf.warn_of_missing(uri, Sentence("label-material", "Material {name}", name=user))
                return None
            return self._shelf.image_file(name, srgb)
        view = image.integer("bufferView", high=len(self._accessors.views))
        name = f"{self._root.file}: {self._accessors.views[view].where}"  # several images may share one view
        return self._shelf.image_bytes(name, bytes(self._accessors.view_bytes(view)), srgb)


def _uv_transform(source: Json) -> UvTransform:
    # translation * rotation * scale on (u, v), as in the extension's specification.
    (x, y), (width, height) = source.vector("offset", (0.0, 0.0)), source.vector("scale", (1.0, 1.0))
    angle = source.number("rotation", 0.0)
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * width, sine * height, x, -sine * width, cosine * height, y
