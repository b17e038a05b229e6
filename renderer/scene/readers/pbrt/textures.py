"""Converts pbrt's textures.

Images retain their wrapping and mapping; textures computed from others are baked to images.
pbrt measures v from the bottom, this renderer from the top: UVs of meshes are flipped when the meshes are made, texture
transforms in this module.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from renderer.scene.description import Image, SceneDescription, TexelFilter, UvTransform, Vec3, Wrap
from renderer.scene.files import SceneFiles
from renderer.scene.matrices import Matrix
from renderer.scene.readers.image_baking import SIZE, Grid, checks, grid, looked_up
from renderer.scene.readers.linear_images import encoded, linear
from renderer.scene.readers.pbrt.mappings import UPRIGHT, Mapping, mapping_of
from renderer.scene.readers.pbrt.notes import Notes
from renderer.scene.readers.pbrt.parameters import Parameter, Parameters, text_of
from renderer.scene.readers.pbrt.spectra import Colors
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["Definition", "Textures", "Varying"]

_WRAPS: dict[str, Wrap] = {"repeat": "repeat", "clamp": "clamp", "black": "clamp"}
_MAX_NESTED = 24
_MOST_PARTS = 32  # of a baked texture
_SOLID = {"fbm": 0.0, "wrinkled": 0.3, "windy": 0.3}  # 3D noise textures, and their mean values
_LAID_ON = ("imagemap", "checkerboard", "bilerp")
_ONE: Vec3 = (1.0, 1.0, 1.0)
_BLACK: Vec3 = (0.0, 0.0, 0.0)


class Definition(NamedTuple):
    """The definition of a texture with float or spectrum values. parts: the textures that it may refer to, by (kind, name)."""

    kind: str
    parameters: Parameters
    parts: dict[tuple[str, str], Definition]
    mapping: Mapping | None = None  # only its own, not those of its parts


@dataclass(frozen=True)
class Varying:
    """A constant value and, optionally, a texture that multiplies it."""

    value: Vec3
    texture: int | None = None
    mapping: Mapping | None = None

    @property
    def is_constant(self) -> bool:
        """True if there is no texture."""
        return self.texture is None


class Textures:
    """Looks up the parameters of materials, lights and shapes that may refer to textures."""

    def __init__(self, files: SceneFiles, colors: Colors, notes: Notes, description: SceneDescription) -> None:
        self._files, self._notes, self._description = files, notes, description
        self.shelf = TextureShelf(description, files)
        self.colors = colors
        self.named: dict[tuple[str, str], Definition] = {}
        self._known: dict[int, Varying] = {}
        self._constants: dict[int, Vec3 | None] = {}
        self.mappings: list[Mapping] = []  # of the textures that were looked up

    def define(self, name: str, kind: str, parameters: Parameters, ctm: Matrix) -> None:
        """Adds the definition of a named texture.

        kind: float or spectrum; ctm: the transformation in effect there.
        """
        wanted = [text_of(each) for each in parameters.values.values() if each.type == "texture"]
        parts = {(k, n): self.named[k, n] for n in wanted for k in ("float", "spectrum") if (k, n) in self.named}
        mapping = mapping_of(parameters, ctm)
        self.named["float" if kind == "float" else "spectrum", name] = Definition(kind, parameters, parts, mapping)

    def color(self, owner: Parameters, name: str, default: Vec3) -> Varying:
        """Returns a colour parameter of a surface, constant or textured."""
        if owner.names_texture(name):
            return self._named_parameter(owner, name, "spectrum", default)
        found = owner.get(name, "rgb", "spectrum", "float")
        if found is None:
            return Varying(default)
        return Varying(_unit(self.colors.numbers(found)) if found.type == "float" else self.colors.albedo(found))

    def number(self, owner: Parameters, name: str, default: float) -> Varying:
        """Returns a float parameter, constant or textured."""
        if owner.names_texture(name):
            return self._named_parameter(owner, name, "float", (default,) * 3)
        return Varying((owner.number(name, default),) * 3)

    def index(self, owner: Parameters, name: str) -> Parameter | None:
        """Returns an index of refraction. For a texture: its constant value, or its mean with a note."""
        if not owner.names_texture(name):
            return owner.get(name, "float", "spectrum", "rgb")
        wanted = owner.text(name)
        found = self.named.get(("spectrum", wanted)) or self.named.get(("float", wanted))
        if found is not None and found.parameters.type == "constant":
            return found.parameters.get("value", "float", "rgb", "spectrum")
        kind = "float" if ("spectrum", wanted) not in self.named else "spectrum"
        mean = self.mean_value(self._named_parameter(owner, name, kind, _ONE))
        self._notes.add(
            owner.place,
            Sentence(
                "texture-averaged",
                "{name} of {what} is a texture: its mean is used",
                name=name,
                what=owner,
            ),
        )
        return Parameter("rgb", np.array(mean), owner.place, owner.space)

    def mean_value(self, varying: Varying) -> Vec3:
        """Returns the mean of a value over its texture."""
        if varying.texture is None:
            return varying.value
        r, g, b = (float(v) for v in linear(self.shelf.image_of(varying.texture)).reshape(-1, 3).mean(axis=0) * varying.value)
        return r, g, b

    def one_number(self, owner: Parameters, name: str, default: float) -> float:
        """Returns a float parameter as one number; for a texture its mean, with a note."""
        found = self.number(owner, name, default)
        if not found.is_constant:
            self._notes.add(
                owner.place,
                Sentence(
                    "texture-averaged",
                    "{name} of {what} is a texture: its mean is used",
                    name=name,
                    what=owner,
                ),
            )
        return self.mean_value(found)[0]

    def normals(self, file_name: str, owner: Parameters) -> int | None:
        """Returns the texture of a normal map file; None, with a warning, if the file is missing."""
        name = self._files.find(file_name, owner.place.file)
        if name is None:
            self.shelf.warn_of_missing(file_name, str(owner.place))
            return None
        return self.shelf.texture(self.shelf.image_file(name, srgb=False))

    def without_metal(self, texture: int | None) -> int | None:
        """Returns the index of a copy of a roughness texture, packed as in glTF: roughness in green, 1 in blue."""

        def packed(image: Image) -> Image:
            pixels = np.array(linear(image))
            pixels[..., 2] = 1.0
            return Image(f"{image.name} packed", pixels, srgb=False)

        return self.shelf.derived_texture(texture, "roughness packed", packed)

    def with_alpha(self, color: int | None, alpha: Varying) -> int | None:
        """Returns a colour texture with an alpha channel; None if the two have different mappings.

        color: the colour texture, None for white. alpha: the opacity; if constant, the colour texture is returned unchanged.
        """
        if alpha.texture is None:
            return color
        holes = self._description.textures[alpha.texture]
        factor = alpha.value[0]

        def add_alpha(image: Image | None, mask_image: Image) -> Image:
            mask = np.clip(linear(mask_image)[..., 0] * factor, 0, 1)
            sources = [mask_image] if image is None else [image, mask_image]
            if image is not None and image.pixels.dtype == np.uint8 and image.srgb and mask_image.pixels.dtype == np.uint8:
                rgb = image.pixels[..., :3]
            else:
                color = np.ones((*mask.shape, 3), np.float32) if image is None else linear(image)
                rgb = encoded(color, *sources, srgb=True)
            if rgb.shape[:2] != mask.shape:
                rows, columns = (np.arange(n) * m // n for n, m in zip(rgb.shape[:2], mask.shape, strict=True))
                mask = mask[rows[:, None], columns[None, :]]
            return Image(f"{mask_image.name} as holes", np.dstack([rgb, encoded(mask, *sources)]))

        if color is None:
            return self.shelf.derived_texture(alpha.texture, f"holes by {factor}", lambda it: add_alpha(None, it))
        own = self._description.textures[color]
        if replace(own, image=0, layers=(), filter="linear") != replace(holes, image=0, layers=(), filter="linear"):
            return None
        return self.shelf.combined(color, alpha.texture, f"holes by {factor}", add_alpha)

    def _named_parameter(self, owner: Parameters, name: str, kind: str, default: Vec3) -> Varying:
        wanted = owner.text(name)
        definition = self.named.get((kind, wanted))
        if definition is None:
            raise owner.place.error(
                Sentence(
                    "pbrt-texture-undefined",
                    "{owner} uses the texture {texture} as {name}, but no {kind} texture of this name is defined before it",
                    owner=owner,
                    texture=repr(wanted[:60]),
                    name=name,
                    kind=kind,
                )
            )
        found = self.value_of(definition, default)
        self.mappings += [found.mapping] if found.mapping is not None else []
        return found

    def value_of(self, definition: Definition, default: Vec3 = _ONE) -> Varying:
        """Returns the value of a texture, constant or varying; the default if the texture cannot be evaluated."""
        return self._get_or_read(definition, default, 0)

    def _get_or_read(self, definition: Definition, default: Vec3, depth: int) -> Varying:
        key = id(definition.parameters)
        if key not in self._known:
            self._known[key] = self._read_texture(definition, default, depth)
        return self._known[key]

    def _read_texture(self, definition: Definition, default: Vec3, depth: int) -> Varying:
        kind, source, *_ = definition
        if depth > _MAX_NESTED:
            raise source.place.error(
                Sentence("pbrt-textures-nested-too-deep", "{source} uses textures that are nested too deeply", source=source)
            )
        if source.type == "imagemap":
            return self._image(definition, default)
        if source.type in _SOLID or source.type in ("marble", "ptex"):
            value = _SOLID.get(source.type, 0.5)
            self._notes.add(
                source.place,
                Sentence("pbrt-texture-type-unsupported", "{source} is not supported: a constant value is used", source=source),
            )
            source.used.update(source.values)
            return Varying((value,) * 3)
        constant = self._constant(definition, depth)
        if constant is not None:
            return Varying(constant)
        if source.type == "scale":
            for name, of, other, kind_of_other in (("scale", "float", "tex", kind), ("tex", kind, "scale", "float")):
                factor = self._constant_part(definition, name, of, _ONE, depth)
                if factor is not None:
                    scaled = self._get_or_read(self._child(definition, other, kind_of_other), _ONE, depth + 1)
                    return replace(scaled, value=_multiply(scaled.value, factor))
        if source.type == "checkerboard" and source.integer("dimension", 2) == 2:
            first = self._constant_part(definition, "tex1", kind, _ONE, depth)
            second = self._constant_part(definition, "tex2", kind, _BLACK, depth)
            if first is not None and second is not None:
                return self._checks(definition, first, second)
        return self._baked(definition, depth)

    def _constant(self, definition: Definition, depth: int) -> Vec3 | None:
        """Returns the value of a texture that is the same everywhere; None if it varies."""
        key = id(definition.parameters)
        if key not in self._constants:
            self._constants[key] = self._constant_value(definition, depth)
        return self._constants[key]

    def _constant_value(self, definition: Definition, depth: int) -> Vec3 | None:
        kind, source, *_ = definition
        if depth > _MAX_NESTED:
            raise source.place.error(
                Sentence("pbrt-textures-nested-too-deep", "{source} uses textures that are nested too deeply", source=source)
            )
        if source.type == "constant":
            return self._value(source, "value", kind, _ONE)
        if source.type == "scale":
            parts = [self._constant_part(definition, n, k, _ONE, depth) for n, k in (("tex", kind), ("scale", "float"))]
            return None if parts[0] is None or parts[1] is None else _multiply(parts[0], parts[1])
        if source.type != "mix":
            return None
        first, second = (self._constant_part(definition, n, kind, d, depth) for n, d in (("tex1", _BLACK), ("tex2", _ONE)))
        amount = self._constant_part(definition, "amount", "float", (0.5,) * 3, depth)
        if first is None or second is None or amount is None:
            return None
        return _vec(np.array(first) * (1 - amount[0]) + np.array(second) * amount[0])

    def _constant_part(self, definition: Definition, name: str, kind: str, default: Vec3, depth: int) -> Vec3 | None:
        if definition.parameters.names_texture(name):
            return self._constant(self._child(definition, name, kind), depth + 1)
        return self._value(definition.parameters, name, kind, default)

    def _child(self, definition: Definition, name: str, kind: str) -> Definition:
        source = definition.parameters
        wanted = source.text(name)
        found = definition.parts.get(("float" if kind == "float" else "spectrum", wanted))
        if found is None:
            raise source.place.error(
                Sentence(
                    "pbrt-texture-input-undefined",
                    "{source} uses the texture {texture}, which is not defined before it",
                    source=source,
                    texture=repr(wanted[:60]),
                )
            )
        return found

    def _value(self, source: Parameters, name: str, kind: str, default: Vec3) -> Vec3:
        found: Parameter | None = source.get(name, "float", "rgb", "spectrum", "blackbody")
        if found is None:
            return default
        if found.type == "float":
            return (source.number(name, 1.0),) * 3
        return self.colors.albedo(found) if found.type != "blackbody" else self.colors.light(found)

    def _uv_transform(self, definition: Definition) -> UvTransform:
        """Returns the transform from a mesh's UVs to those of an image or checkerboard, both with v from the top."""
        source = definition.parameters
        source.used.update(("mapping", "uscale", "vscale", "udelta", "vdelta", "v1", "v2"))
        if definition.mapping is not None:
            return UPRIGHT
        su, sv = source.number("uscale", 1.0), source.number("vscale", 1.0)
        du, dv = source.number("udelta", 0.0), source.number("vdelta", 0.0)
        return su, 0.0, du, 0.0, sv, 1 - sv - dv

    def _image(self, definition: Definition, default: Vec3) -> Varying:
        source, mapping = definition.parameters, definition.mapping
        wanted = source.text("filename")
        name = self._files.find(wanted, source.place.file)
        if name is None:
            self.shelf.warn_of_missing(wanted, str(source.place))
            source.used.update(source.values)
            return Varying(default)
        encoding = source.text("encoding", "sRGB")
        if encoding.startswith("gamma"):
            self._notes.add(
                source.place,
                Sentence(
                    "pbrt-texture-encoding-replaced",
                    "{source}: its encoding {encoding} is read as sRGB",
                    source=source,
                    encoding=repr(encoding[:20]),
                ),
            )
        image = self.shelf.image_file(name, encoding.lower() != "linear")
        if image is None:
            return Varying(default)
        said = source.text("wrap", "repeat")
        if said not in ("repeat", "clamp"):
            self._notes.add(
                source.place,
                Sentence(
                    "pbrt-texture-wrap-replaced",
                    "{source}: its wrap mode {wrap} is replaced by clamp",
                    source=source,
                    wrap=said[:30],
                ),
            )
        wrap = _WRAPS.get(said, "clamp")
        filter: TexelFilter = "nearest" if source.text("filter", "bilinear") == "point" else "linear"
        source.used.add("maxanisotropy")
        texture = self.shelf.texture(image, wrap, wrap, int(mapping is not None), self._uv_transform(definition), (), filter)
        if definition.kind == "float" and texture is not None:
            texture = self._first_channel_in_all(texture)
        scale = source.number("scale", 1.0)
        if source.boolean("invert", False):
            texture = self.shelf.derived_texture(
                texture,
                f"inverted by {scale}",
                lambda it: Image(f"{it.name} inverted", np.maximum(1 - scale * linear(it), 0), False),
            )
            scale = 1.0
        return Varying((scale,) * 3, texture, mapping)

    def _first_channel_in_all(self, texture: int) -> int:
        """Returns the index of a copy of a texture with its first channel in all channels; pbrt uses only that one."""
        pixels = self.shelf.image_of(texture).pixels
        if all(np.array_equal(pixels[..., 0], pixels[..., channel]) for channel in (1, 2)):
            return texture
        made = self.shelf.derived_texture(
            texture, "red", lambda it: Image(f"{it.name} of red", np.repeat(linear(it)[..., :1], 3, axis=-1), False)
        )
        return texture if made is None else made

    def _checks(self, definition: Definition, first: Vec3, second: Vec3) -> Varying:
        su, _, du, _, sv, dv = self._uv_transform(definition)
        # The image has 2 x 2 squares; the lower left one is the first.
        pixels = np.array([[second, first], [first, second]], np.float32)
        image = self.shelf.add(Image(f"checkerboard {len(self._description.images)}", pixels, srgb=False))
        transform = (su / 2, 0.0, du / 2, 0.0, sv / 2, dv / 2 + 0.5)
        uv_set = int(definition.mapping is not None)
        return Varying(_ONE, self.shelf.texture(image, "repeat", "repeat", uv_set, transform, (), "nearest"), definition.mapping)

    def _baked(self, definition: Definition, depth: int) -> Varying:
        source = definition.parameters
        pixels = self._on_grid(definition, grid(), depth, {})
        image = self.shelf.add(
            Image(f"{source.type} {len(self._description.images)}", np.ascontiguousarray(pixels, np.float32), False)
        )
        self._notes.add(
            source.place,
            Sentence(
                "pbrt-texture-baked",
                "{source} is baked to an image of {size} x {size}, which repeats with the UVs",
                source=source,
                size=SIZE,
            ),
        )
        ways = self._mappings(definition, {})
        mapping = next((way for way in ways if way is not None), None)
        if len(ways) > 1:
            self._notes.add(
                source.place,
                Sentence(
                    "pbrt-texture-mappings-differ",
                    "{source} uses textures with different mappings: all use one",
                    source=source,
                ),
            )
        return Varying(_ONE, self.shelf.texture(image, uv_set=int(mapping is not None)), mapping)

    def _mappings(self, definition: Definition, cache: dict[int, set[Mapping | None]]) -> set[Mapping | None]:
        """Returns the mappings used by a texture and by the textures that it refers to; None stands for UV mapping."""
        key = id(definition.parameters)
        if key not in cache:
            own = {definition.mapping} if definition.parameters.type in _LAID_ON else set()
            cache[key] = own.union(*(self._mappings(part, cache) for part in definition.parts.values()))
        return cache[key]

    def _on_grid(self, definition: Definition, grid_points: Grid, depth: int, cache: dict[int, np.ndarray]) -> np.ndarray:
        """Returns (SIZE, SIZE, 3) values of a texture over the unit square of UVs.

        depth: nesting level of the texture. cache: values of the textures already evaluated for the same image.
        """
        key = id(definition.parameters)
        if key not in cache:
            if len(cache) >= _MOST_PARTS:
                raise definition.parameters.place.error(
                    Sentence(
                        "pbrt-texture-inputs-too-many",
                        "a texture uses more than {most} others; reduce them",
                        most=_MOST_PARTS,
                    )
                )
            cache[key] = np.asarray(self._on_new_grid(definition, grid_points, depth, cache), np.float32)
        return cache[key]

    def _on_new_grid(self, definition: Definition, grid_points: Grid, depth: int, cache: dict[int, np.ndarray]) -> np.ndarray:
        kind, source, *_ = definition
        if depth > _MAX_NESTED:
            raise source.place.error(
                Sentence("pbrt-textures-nested-too-deep", "{source} uses textures that are nested too deeply", source=source)
            )

        def values_of_input(name: str, kind: str, default: Vec3) -> np.ndarray:
            if source.names_texture(name):
                return self._on_grid(self._child(definition, name, kind), grid_points, depth + 1, cache)
            return np.broadcast_to(np.array(self._value(source, name, kind, default)), (SIZE, SIZE, 3))

        if source.type == "scale":
            return values_of_input("tex", kind, _ONE) * values_of_input("scale", "float", _ONE)
        if source.type == "mix":
            amount = values_of_input("amount", "float", (0.5,) * 3)
            return values_of_input("tex1", kind, _BLACK) * (1 - amount) + values_of_input("tex2", kind, _ONE) * amount
        if source.type == "checkerboard":
            if source.integer("dimension", 2) != 2:
                self._notes.add(
                    source.place,
                    Sentence(
                        "pbrt-texture-3d-flattened", "{source} in three dimensions is replaced by one in UVs", source=source
                    ),
                )
            return np.where(
                checks(grid_points, self._uv_transform(definition)),
                values_of_input("tex1", kind, _ONE),
                values_of_input("tex2", kind, _BLACK),
            )
        if source.type == "bilerp":
            corners = [np.array(self._value(source, f"v{k}", kind, (float(k[1]),) * 3)) for k in ("00", "01", "10", "11")]
            x, y = grid_points.transformed_uvs(self._uv_transform(definition))
            s, t = x[..., None], 1 - y[..., None]
            return (1 - s) * ((1 - t) * corners[0] + t * corners[1]) + s * ((1 - t) * corners[2] + t * corners[3])
        if source.type in ("imagemap", "constant"):
            found = self._get_or_read(definition, _ONE, depth)
            if found.texture is None:
                return np.broadcast_to(np.array(found.value), (SIZE, SIZE, 3))
            return (
                looked_up(self._description.textures[found.texture], linear(self.shelf.image_of(found.texture)), grid_points)
                * found.value
            )
        self._notes.add(
            source.place,
            Sentence("pbrt-texture-type-unsupported", "{source} is not supported: a constant value is used", source=source),
        )
        source.used.update(source.values)
        return np.full((SIZE, SIZE, 3), 0.5)


def _unit(rgb: Vec3) -> Vec3:
    r, g, b = (min(max(v, 0.0), 1.0) for v in rgb)
    return r, g, b


def _multiply(a: Vec3, b: Vec3) -> Vec3:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


def _vec(values: np.ndarray) -> Vec3:
    r, g, b = (float(v) for v in values)
    return r, g, b
