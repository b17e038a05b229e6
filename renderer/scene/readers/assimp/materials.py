"""Converts assimp's materials."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any
from urllib.parse import unquote

import numpy as np

from renderer.scene.description import UvTransform, Vec3, Wrap
from renderer.scene.files import SceneFiles
from renderer.scene.material import Material
from renderer.scene.readers.assimp.library import Imported
from renderer.scene.readers.mtl_maps import holds_normals, with_opacity, with_roughness_and_metal
from renderer.scene.readers.number_ranges import clamped, unit
from renderer.scene.textures import IDENTITY_UV_TRANSFORM, TextureShelf
from renderer.scene.udim import composed_transform, is_tiled
from renderer.sentences import Sentence

__all__ = ["Materials"]

# aiTextureType
_DIFFUSE, _EMISSIVE, _HEIGHT, _NORMALS, _OPACITY, _BASE, _METAL, _ROUGH = 1, 4, 5, 6, 8, 12, 15, 16
_READ_TEXTURES = {_DIFFUSE, _EMISSIVE, _HEIGHT, _NORMALS, _OPACITY, _BASE, _METAL, _ROUGH}
_NAMES: dict[int, str] = {
    2: Sentence("texture-use-specular", "specular reflection"),
    3: Sentence("texture-use-ambient", "ambient light"),
    7: Sentence("texture-use-shininess", "shininess"),
    9: Sentence("texture-use-displacement", "displacement"),
    10: Sentence("texture-use-light-map", "baked light"),
    11: Sentence("texture-use-reflection", "reflected surroundings"),
}
_WRAPS: dict[int, Wrap] = {0: "repeat", 1: "clamp", 2: "mirror", 3: "clamp"}
_MATTE = (1, 2, 9)  # aiShadingMode: flat, Gouraud, none
_UNSHADED = 9
_MAX_RADIANCE = 1e9
# Properties without effect on the image or redundant ones: opacity includes both kinds of transparency.
# assimp converts texture mappings to UVs.
_IGNORED_PROPERTIES = (
    "$clr.ambient",
    "$clr.transparent",
    "$mat.transparencyfactor",
    "$mat.twosided",
    "$tex.file",
    "$tex.mapping",
    "$tex.mapaxis",
)
_NEUTRAL = {  # neutral values of unread properties; 0 for others
    "$clr.specular": (0.0, 1.0),
    "$mat.bumpscaling": (1.0,),
    "$mat.refracti": (0.0, 1.0, 1.5),
    "$mat.shininess": tuple(map(float, range(1001))),  # irrelevant without specular reflection
    "$mat.shinpercent": (0.0, 1.0),
    "$mat.shadingm": tuple(map(float, range(12))),
    "$tex.blend": (1.0,),
    "$tex.uvtrafo": (0.0, 1.0),
}


class _MaterialProperties(dict[tuple[str, int], Any]):
    """The properties of one assimp material. Records which of them have been read."""

    def __init__(self, properties: dict[tuple[str, int], Any]) -> None:
        super().__init__(properties)
        self._asked: set[tuple[str, int]] = set()

    def get(self, key: tuple[str, int], default: Any = None) -> Any:
        """Returns a property's value, or the default if it is absent."""
        self._asked.add(key)
        return super().get(key, default)

    def __contains__(self, key: object) -> bool:
        if isinstance(key, tuple):
            self._asked.add(key)
        return super().__contains__(key)

    def unread_names(self) -> list[str]:
        """Returns the names of the unread properties that affect the image."""
        found = []
        for (key, kind), value in self.items():
            name = key.rpartition(".")[2]
            is_of_texture = key.startswith("$tex.")
            if (
                (key, kind) in self._asked
                or key in _IGNORED_PROPERTIES
                or not key.startswith("$")
                or (is_of_texture and kind not in _READ_TEXTURES)
            ):
                continue
            numbers = value if isinstance(value, np.ndarray) else np.zeros(0)
            numbers = numbers[:3] if key.startswith("$clr.") else numbers  # without alpha
            if len(numbers) and not np.isin(numbers, _NEUTRAL.get(key, (0.0,))).all():
                found.append(name)
        return found


class Materials:
    """Converts the file's materials to materials of the scene description; each is converted once."""

    def __init__(self, imported: Imported, main: str, files: SceneFiles, shelf: TextureShelf, materials: list[Material]) -> None:
        self._imported, self._main, self._files, self._shelf, self._materials = imported, main, files, shelf, materials
        self._known: dict[int, int] = {}
        self.odd: Counter[str] = Counter()  # count by unsupported content
        self._inside = {name: i for i, (name, _) in reversed(list(enumerate(imported.textures)))}

    def number(self, source: int) -> int:
        """Returns the index, in the scene description, of one of the file's materials.

        source: the material's index in the file.
        """
        if source not in self._known:
            sources = self._imported.materials
            self._materials.append(self._read(_MaterialProperties(sources[source])) if 0 <= source < len(sources) else Material())
            self._known[source] = len(self._materials) - 1
        return self._known[source]

    def _read(self, properties: _MaterialProperties) -> Material:
        name = str(properties.get(("?mat.name", 0), "") or "material")
        material = Material(name, base_color=_color(properties, "$clr.base", _color(properties, "$clr.diffuse", (0.8, 0.8, 0.8))))
        texture = self._texture(properties, _BASE, name, srgb=True)
        if texture is None:
            texture = self._texture(properties, _DIFFUSE, name, srgb=True)
        material.base_color_texture = texture
        is_said = ("$clr.base", 0) in properties or ("$clr.diffuse", 0) in properties
        if texture is not None and (max(material.base_color) == 0 or not is_said):
            material.base_color = (1.0, 1.0, 1.0)
        material.emission = _color(properties, "$clr.emissive", (0.0, 0.0, 0.0), _MAX_RADIANCE)
        material.emission_texture = self._texture(properties, _EMISSIVE, name, srgb=True)
        if material.emission_texture is not None and max(material.emission) == 0:
            material.emission = (1.0, 1.0, 1.0)
        if texture is None and int(_number(properties, "$mat.shadingm", 0)) == _UNSHADED and max(material.emission) > 0:
            material.base_color = (0.0, 0.0, 0.0)  # Collada's constant colour
        self._surface(properties, material)
        self._opacity(properties, material)
        self._normals(properties, material)
        left = [_texture_use_name(kind) for key, kind in properties if key == "$tex.file" and kind not in _READ_TEXTURES]
        if left:
            self._shelf.warn_of_surface(
                Sentence(
                    "assimp-material-textures-dropped",
                    "Material {name}: its textures for {textures} are left out.",
                    name=name,
                    textures=sorted(set(left)),
                )
            )
        for key in properties.unread_names():
            self.odd[Sentence("assimp-material-properties", "properties of materials: {key}", key=key)] += 1
        return material

    def _surface(self, properties: dict[tuple[str, int], Any], material: Material) -> None:
        rough, metal = (self._texture(properties, kind, material.name, srgb=False) for kind in (_ROUGH, _METAL))
        if (
            rough is not None
            or metal is not None
            or ("$mat.roughnessFactor", 0) in properties
            or ("$mat.metallicFactor", 0) in properties
        ):
            material.kind = "metallic_roughness"
            material.metallic_roughness_texture = with_roughness_and_metal(self._shelf, rough, metal)
            material.roughness = 1.0 if rough is not None else unit(_number(properties, "$mat.roughnessFactor", 0.5))
            material.metallic = 1.0 if metal is not None else unit(_number(properties, "$mat.metallicFactor", 0.0))
            return
        strength = _number(properties, "$mat.shinpercent", 1.0)
        r, g, b = (unit(c * strength) for c in _color(properties, "$clr.specular", (0.0, 0.0, 0.0)))
        shininess = _number(properties, "$mat.shininess", 0.0)
        if max(r, g, b) > 0 and shininess > 1 and int(_number(properties, "$mat.shadingm", 3)) not in _MATTE:
            material.kind, material.specular_color = "metallic_roughness", (r, g, b)
            material.roughness = unit((2 / (shininess + 2)) ** 0.25)  # as for MTL

    def _opacity(self, properties: dict[tuple[str, int], Any], material: Material) -> None:
        opacity = unit(_number(properties, "$mat.opacity", 1.0))
        self.odd[Sentence("assimp-opacities-zero", "opacities of 0, which many programs write for opaque materials")] += (
            opacity == 0
        )
        if 0 < opacity < 1:
            material.opacity, material.alpha_mode = opacity, "blend"
        mask = self._texture(properties, _OPACITY, material.name, srgb=False)
        if mask is not None:
            material.base_color_texture = with_opacity(self._shelf, material.base_color_texture, mask)
            material.alpha_mode = "blend"

    def _normals(self, properties: dict[tuple[str, int], Any], material: Material) -> None:
        for kind in (_NORMALS, _HEIGHT):
            texture = self._texture(properties, kind, material.name, srgb=False)
            if texture is not None and holds_normals(self._shelf.image_of(texture)):
                material.normal_texture = texture
                return
            if texture is not None:
                self._shelf.warn_of_surface(
                    Sentence(
                        "material-bump-heights-dropped",
                        "Material {name}: its bump map contains heights and is left out; bake it to a normal map.",
                        name=material.name,
                    )
                )

    def _texture(self, properties: dict[tuple[str, int], Any], kind: int, name: str, srgb: bool) -> int | None:
        reference = str(properties.get(("$tex.file", kind), "")).strip()
        if not reference:
            return None
        wraps = [_WRAPS.get(int(_number(properties, key, 0, kind)), "repeat") for key in ("$tex.mapmodeu", "$tex.mapmodev")]
        number = int(_number(properties, "$tex.uvwsrc", 0, kind))
        uv_set = min(max(number, 0), 1)
        self.odd[Sentence("assimp-texture-coordinate-sets", "textures that name a set of texture coordinates")] += (
            uv_set != number
        )
        place = _transform(properties.get(("$tex.uvtrafo", kind)), self._main.lower().endswith((".x3d", ".x3db", ".wrl")))
        image, tiled = self._image(reference, Sentence("label-material", "Material {name}", name=name), srgb)
        return self._shelf.texture(image, wraps[0], wraps[1], uv_set, composed_transform(place, tiled))

    def _image(self, reference: str, user: str, srgb: bool) -> tuple[int | None, UvTransform]:
        number = reference[1:] if reference.startswith("*") else ""
        inside = self._inside.get(reference)
        if number.isascii() and number.isdigit() and len(number) < 10 and int(number) < len(self._imported.textures):
            inside = int(number)
        if inside is not None and self._imported.textures[inside][1]:
            name, data = self._imported.textures[inside]
            return self._shelf.image_bytes(
                f"{self._main} (picture {inside}): {name or reference}", data, srgb
            ), IDENTITY_UV_TRANSFORM
        if is_tiled(unquote(reference)):
            return self._shelf.image_and_transform(unquote(reference).removeprefix("file:"), self._main, user, srgb)
        found = self._files.resolve_uri(reference, self._main)
        if found is None:
            self._shelf.warn_of_missing(reference, user)
            return None, IDENTITY_UV_TRANSFORM
        return self._shelf.image_file(found, srgb), IDENTITY_UV_TRANSFORM


def _transform(given: Any, is_x3d: bool) -> UvTransform:
    """Returns a UV transform, for v downwards, from assimp's offset, scale and rotation.

    These are applied in this order: scale, rotation about the centre (0.5, 0.5), offset. In X3D the order is offset, rotation
    about the corner (0, 0), scale.
    """
    if not isinstance(given, np.ndarray) or len(given) < 5 or not np.isfinite(given[:5]).all():
        return IDENTITY_UV_TRANSFORM
    x, y, wide, high, turn = (float(v) for v in given[:5])
    cosine, sine, middle = math.cos(turn), math.sin(turn), 0.0 if is_x3d else 0.5
    scaled, moved = np.diag([wide, high, 1.0]), np.array([(1, 0, x), (0, 1, y), (0, 0, 1)])
    turned = np.array([(cosine, -sine, middle), (sine, cosine, middle), (0, 0, 1)]) @ np.array(
        [(1, 0, -middle), (0, 1, -middle), (0, 0, 1)]
    )
    upward = scaled @ turned @ moved if is_x3d else moved @ turned @ scaled
    flip = np.array([(1, 0, 0), (0, -1, 1), (0, 0, 1)])  # from v upwards to v downwards
    a, b, c, d, e, f = (float(v) for v in (flip @ upward @ flip)[:2].reshape(-1))
    return a, b, c, d, e, f


def _number(properties: dict[tuple[str, int], Any], key: str, default: float, kind: int = 0) -> float:
    value = properties.get((key, kind))
    if not isinstance(value, np.ndarray) or not len(value) or not np.isfinite(value[0]):
        return default
    return float(value[0])


def _color(properties: dict[tuple[str, int], Any], key: str, default: Vec3, high: float = 1.0) -> Vec3:
    value = properties.get((key, 0))
    if not isinstance(value, np.ndarray) or len(value) < 3 or not np.isfinite(value[:3]).all():
        return default
    r, g, b = (clamped(float(c), 0.0, high) for c in value[:3])
    return r, g, b


def _texture_use_name(kind: int) -> str:
    return _NAMES.get(kind) or Sentence("texture-use-number", "use number {number}", number=kind)
