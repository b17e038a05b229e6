"""What varies over a surface: pbrt's textures as ours.

An image, how it repeats and where it lies is taken over as it is; what textures are made of others, is worked out as a picture.
pbrt counts v from below, ours from above: meshes are turned so when they are made, and the transforms of textures here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from renderer.image.tonemap import decode_srgb, encode_srgb
from renderer.scene.description import Image, SceneDescription, TexelFilter, UvTransform, Vec3, Wrap
from renderer.scene.files import SceneFiles
from renderer.scene.readers.pbrt.baked import SIZE, Grid, checks, grid, looked_up
from renderer.scene.readers.pbrt.notes import Notes
from renderer.scene.readers.pbrt.parameters import Parameter, Parameters
from renderer.scene.readers.pbrt.spectra import Colors
from renderer.scene.textures import TextureShelf

__all__ = ["Definition", "Textures", "Varying"]

_WRAPS: dict[str, Wrap] = {"repeat": "repeat", "clamp": "clamp", "black": "clamp"}
_MAX_NESTED = 24
_SOLID = {"fbm": 0.0, "wrinkled": 0.3, "windy": 0.3}  # what varies in space, and a middling value of it
_ONE: Vec3 = (1.0, 1.0, 1.0)


class Definition(NamedTuple):
    """A texture as a file names it: of floats or of spectra."""

    kind: str
    parameters: Parameters


@dataclass(frozen=True)
class Varying:
    """A value, and the texture that it is multiplied by."""

    value: Vec3
    texture: int | None = None

    @property
    def is_constant(self) -> bool:
        """Whether there is no texture."""
        return self.texture is None


class Textures:
    """Looks up values of materials, lights and shapes."""

    def __init__(self, files: SceneFiles, colors: Colors, notes: Notes, description: SceneDescription) -> None:
        self._files, self._notes, self._description = files, notes, description
        self.shelf = TextureShelf(description, files)
        self.colors = colors
        self.named: dict[tuple[str, str], Definition] = {}
        self._known: dict[int, Varying] = {}

    def define(self, name: str, kind: str, parameters: Parameters) -> None:
        """A name for a texture; kind: float or spectrum."""
        self.named["float" if kind == "float" else "spectrum", name] = Definition(kind, parameters)

    def color(self, owner: Parameters, name: str, default: Vec3) -> Varying:
        """A colour of a surface."""
        if owner.names_texture(name):
            return self._of_name(owner, name, "spectrum", default)
        found = owner.get(name, "rgb", "spectrum", "float")
        if found is None:
            return Varying(default)
        return Varying(_unit(self.colors.numbers(found)) if found.type == "float" else self.colors.albedo(found))

    def number(self, owner: Parameters, name: str, default: float) -> Varying:
        """A number."""
        if owner.names_texture(name):
            return self._of_name(owner, name, "float", (default,) * 3)
        return Varying((owner.number(name, default),) * 3)

    def mean(self, varying: Varying) -> Vec3:
        """The mean of a value over its texture."""
        if varying.texture is None:
            return varying.value
        r, g, b = (float(v) for v in linear(self.shelf.image_of(varying.texture)).reshape(-1, 3).mean(axis=0) * varying.value)
        return r, g, b

    def one_number(self, owner: Parameters, name: str, default: float) -> float:
        """A number that does not vary: of a texture the mean, which is noted."""
        found = self.number(owner, name, default)
        if not found.is_constant:
            self._notes.add(owner.place, f"{name} of {owner} varies over the surface: its mean is taken")
        return self.mean(found)[0]

    def normals(self, wanted: str, owner: Parameters) -> int | None:
        """The texture of a file of normals."""
        name = self._files.find(wanted, owner.place.file)
        if name is None:
            self.shelf.missing(wanted, str(owner.place))
            return None
        return self.shelf.texture(self.shelf.image_file(name, srgb=False))

    def without_metal(self, texture: int | None) -> int | None:
        """A texture of roughness in glTF's packing: green roughness, and blue as much metal as there is."""

        def packed(image: Image) -> Image:
            pixels = np.array(linear(image))
            pixels[..., 2] = 1.0
            return Image(f"{image.name} packed", pixels, srgb=False)

        return self.shelf.derived(texture, "roughness packed", packed)

    def with_alpha(self, color: int | None, alpha: Varying) -> int | None:
        """The texture of a colour (None: white) with holes; None where the two do not lie on each other."""
        if alpha.texture is None:
            return color
        holes = self._description.textures[alpha.texture]
        factor = alpha.value[0]

        def cut(image: Image | None, by: Image) -> Image:
            mask = np.clip(linear(by)[..., 0] * factor, 0, 1)
            rgb = np.full((*mask.shape, 3), 255, np.uint8)
            if image is not None:
                if image.pixels.dtype == np.uint8 and image.srgb:
                    rgb = image.pixels[..., :3]
                else:
                    rgb = np.rint(encode_srgb(np.clip(linear(image), 0, 1)) * 255).astype(np.uint8)
            if rgb.shape[:2] != mask.shape:
                rows, columns = (np.arange(n) * m // n for n, m in zip(rgb.shape[:2], mask.shape, strict=True))
                mask = mask[rows[:, None], columns[None, :]]
            return Image(f"{by.name} as holes", np.dstack([rgb, np.rint(mask * 255).astype(np.uint8)]))

        if color is None:
            return self.shelf.derived(alpha.texture, f"holes by {factor}", lambda it: cut(None, it))
        own = self._description.textures[color]
        if (own.transform, own.wrap_s, own.wrap_t) != (holes.transform, holes.wrap_s, holes.wrap_t):
            return None
        return self.shelf.combined(color, alpha.texture, f"holes by {factor}", cut)

    def _of_name(self, owner: Parameters, name: str, kind: str, default: Vec3) -> Varying:
        wanted = owner.text(name)
        definition = self.named.get((kind, wanted))
        if definition is None:
            raise owner.place.wrong(
                f"{owner} has the texture {wanted[:60]!r} as {name}, but no {kind} texture of this name stands before"
            )
        return self.of(definition, default)

    def of(self, definition: Definition, default: Vec3 = _ONE) -> Varying:
        """A texture; the default where it shows nothing."""
        key = id(definition.parameters)
        if key not in self._known:
            self._known[key] = self._made(definition, default, 0)
        return self._known[key]

    def _made(self, definition: Definition, default: Vec3, depth: int) -> Varying:
        kind, source = definition
        if depth > _MAX_NESTED:
            raise source.place.wrong(f"{source} is made of textures that are nested too deep")
        if source.type == "constant":
            return Varying(self._value(source, "value", kind, _ONE))
        if source.type == "imagemap":
            return self._image(source, default)
        if source.type in _SOLID or source.type in ("marble", "ptex"):
            value = _SOLID.get(source.type, 0.5)
            self._notes.add(source.place, f"{source} is not read: one value stands for all of it")
            source.used.update(source.values)
            return Varying((value,) * 3)
        parts = self._parts(definition, depth)
        if source.type == "scale" and parts is not None:
            first, second = parts
            if first.is_constant or second.is_constant:
                return Varying(_times(first.value, second.value), first.texture if second.is_constant else second.texture)
        if source.type == "mix" and parts is not None and all(part.is_constant for part in parts):
            amount = self._amount(source, depth)
            if amount.is_constant:
                share = amount.value[0]
                a, b = (np.array(part.value) for part in parts)
                return Varying(_vec(a * (1 - share) + b * share))
        even = parts is not None and all(part.is_constant for part in parts)
        if parts is not None and even and source.type == "checkerboard" and source.integer("dimension", 2) == 2:
            return self._checks(source, parts[0].value, parts[1].value)
        return self._baked(definition, depth)

    def _parts(self, definition: Definition, depth: int) -> tuple[Varying, Varying] | None:
        source = definition.parameters
        names = {"scale": ("tex", "scale"), "mix": ("tex1", "tex2"), "checkerboard": ("tex1", "tex2")}.get(source.type)
        if names is None:
            return None
        defaults = (_ONE, _ONE) if source.type == "scale" else ((0.0,) * 3, _ONE) if source.type == "mix" else (_ONE, (0.0,) * 3)
        kinds = (definition.kind, "float" if source.type == "scale" else definition.kind)
        found = [self._part(source, n, k, d, depth) for n, k, d in zip(names, kinds, defaults, strict=True)]
        return found[0], found[1]

    def _part(self, source: Parameters, name: str, kind: str, default: Vec3, depth: int) -> Varying:
        if source.names_texture(name):
            return self._made(self._child(source, name, kind), default, depth + 1)
        return Varying(self._value(source, name, kind, default))

    def _child(self, source: Parameters, name: str, kind: str) -> Definition:
        wanted = source.text(name)
        found = self.named.get(("float" if kind == "float" else "spectrum", wanted))
        if found is None:
            raise source.place.wrong(f"{source} is made of the texture {wanted[:60]!r}, which does not stand before")
        return found

    def _value(self, source: Parameters, name: str, kind: str, default: Vec3) -> Vec3:
        found: Parameter | None = source.get(name, "float", "rgb", "spectrum", "blackbody")
        if found is None:
            return default
        if found.type == "float":
            return (source.number(name, 1.0),) * 3
        return self.colors.albedo(found) if found.type != "blackbody" else self.colors.light(found)

    def _amount(self, source: Parameters, depth: int) -> Varying:
        return self._part(source, "amount", "float", (0.5,) * 3, depth)

    def _place(self, source: Parameters) -> UvTransform:
        """How our UVs become those of an image or of squares, both counted from above."""
        mapping = source.text("mapping", "uv")
        su, sv = source.number("uscale", 1.0), source.number("vscale", 1.0)
        du, dv = source.number("udelta", 0.0), source.number("vdelta", 0.0)
        if mapping != "uv":
            self._notes.add(source.place, f"{source} is laid on by its {mapping[:30]} mapping; it is laid on by UVs here")
        return su, 0.0, du, 0.0, sv, 1 - sv - dv

    def _image(self, source: Parameters, default: Vec3) -> Varying:
        wanted = source.text("filename")
        name = self._files.find(wanted, source.place.file)
        if name is None:
            self.shelf.missing(wanted, str(source.place))
            source.used.update(source.values)
            return Varying(default)
        encoding = source.text("encoding", "sRGB")
        if encoding.startswith("gamma"):
            self._notes.add(source.place, f"{source}: its encoding {encoding[:20]!r} is taken as sRGB")
        image = self.shelf.image_file(name, encoding.lower() != "linear")
        if image is None:
            return Varying(default)
        said = source.text("wrap", "repeat")
        if said not in ("repeat", "clamp"):
            self._notes.add(source.place, f"{source}: beyond its edges it is {said[:30]}; its edges go on here")
        wrap = _WRAPS.get(said, "clamp")
        filter: TexelFilter = "nearest" if source.text("filter", "bilinear") == "point" else "linear"
        source.used.add("maxanisotropy")
        texture = self.shelf.texture(image, wrap, wrap, 0, self._place(source), (), filter)
        scale = source.number("scale", 1.0)
        if source.flag("invert", False):
            texture = self.shelf.derived(
                texture,
                f"inverted by {scale}",
                lambda it: Image(f"{it.name} inverted", np.maximum(1 - scale * linear(it), 0), False),
            )
            scale = 1.0
        return Varying((scale,) * 3, texture)

    def _checks(self, source: Parameters, first: Vec3, second: Vec3) -> Varying:
        su, _, du, _, sv, _ = self._place(source)
        # Two squares each way are one image; from above, its lower left one is the first.
        pixels = np.array([[second, first], [first, second]], np.float32)
        image = self.shelf.add(Image(f"checkerboard {len(self._description.images)}", pixels, srgb=False))
        transform = (su / 2, 0.0, du / 2, 0.0, sv / 2, (1 - sv - source.number("vdelta", 0.0)) / 2 + 0.5)
        return Varying(_ONE, self.shelf.texture(image, "repeat", "repeat", 0, transform, (), "nearest"))

    def _baked(self, definition: Definition, depth: int) -> Varying:
        source = definition.parameters
        pixels = self._on_grid(definition, grid(), depth)
        image = self.shelf.add(
            Image(f"{source.type} {len(self._description.images)}", np.ascontiguousarray(pixels, np.float32), False)
        )
        self._notes.add(source.place, f"{source} is worked out as a picture of {SIZE} x {SIZE}, which repeats with the UVs")
        return Varying(_ONE, self.shelf.texture(image))

    def _on_grid(self, definition: Definition, at: Grid, depth: int) -> np.ndarray:
        """(SIZE, SIZE, 3) a texture over the unit square."""
        kind, source = definition
        if depth > _MAX_NESTED:
            raise source.place.wrong(f"{source} is made of textures that are nested too deep")

        def part(name: str, of: str, default: Vec3) -> np.ndarray:
            if source.names_texture(name):
                return self._on_grid(self._child(source, name, of), at, depth + 1)
            return np.broadcast_to(np.array(self._value(source, name, of, default)), (SIZE, SIZE, 3))

        if source.type == "scale":
            return part("tex", kind, _ONE) * part("scale", "float", _ONE)
        if source.type == "mix":
            amount = part("amount", "float", (0.5,) * 3)
            return part("tex1", kind, (0.0,) * 3) * (1 - amount) + part("tex2", kind, _ONE) * amount
        if source.type == "checkerboard":
            if source.integer("dimension", 2) != 2:
                self._notes.add(source.place, f"{source} of cubes in space is laid on as squares, by UVs")
            return np.where(checks(at, self._place(source)), part("tex1", kind, _ONE), part("tex2", kind, (0.0,) * 3))
        if source.type == "bilerp":
            corners = [np.array(self._value(source, f"v{k}", kind, (float(k[1]),) * 3)) for k in ("00", "01", "10", "11")]
            x, y = at.moved(self._place(source))
            s, t = x[..., None], 1 - y[..., None]
            return (1 - s) * ((1 - t) * corners[0] + t * corners[1]) + s * ((1 - t) * corners[2] + t * corners[3])
        if source.type in ("imagemap", "constant"):
            found = self._made(definition, _ONE, depth)
            if found.texture is None:
                return np.broadcast_to(np.array(found.value), (SIZE, SIZE, 3))
            return (
                looked_up(self._description.textures[found.texture], linear(self.shelf.image_of(found.texture)), at) * found.value
            )
        self._notes.add(source.place, f"{source} is not read: one value stands for all of it")
        source.used.update(source.values)
        return np.full((SIZE, SIZE, 3), 0.5)


def linear(image: Image) -> np.ndarray:
    """(h, w, 3) float32 of an image's pixels, as light is added."""
    pixels = np.asarray(image.pixels[..., :3])
    if pixels.dtype != np.uint8:
        return np.asarray(pixels, np.float32)
    table = np.arange(256, dtype=np.float32) / 255
    return np.asarray((decode_srgb(table) if image.srgb else table)[pixels], np.float32)


def _unit(rgb: Vec3) -> Vec3:
    r, g, b = (min(max(v, 0.0), 1.0) for v in rgb)
    return r, g, b


def _times(a: Vec3, b: Vec3) -> Vec3:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


def _vec(values: np.ndarray) -> Vec3:
    r, g, b = (float(v) for v in values)
    return r, g, b
