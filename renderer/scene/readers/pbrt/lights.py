"""Lights without a surface, environment light, and emission of surfaces.

pbrt scales a light's spectrum to a luminance of 1 before it applies scale, power or illuminance; RGB values are used unscaled.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.scene.description import EmissionMap, Environment, Image, Light, SceneDescription, Vec3
from renderer.scene.files import SceneFiles
from renderer.scene.matrices import Matrix, product
from renderer.scene.readers.linear_images import linear
from renderer.scene.readers.pbrt.equal_area import equirectangular
from renderer.scene.readers.pbrt.materials import Emission
from renderer.scene.readers.pbrt.notes import Notes
from renderer.scene.readers.pbrt.parameters import Parameters
from renderer.scene.readers.pbrt.projected_lights import goniometric, projected_power, projection
from renderer.scene.readers.pbrt.spectra import luminance
from renderer.scene.readers.pbrt.textures import Textures
from renderer.sentences import Sentence

__all__ = ["Lights"]

_MAX_RADIANCE = 1e9
_MOST_LIGHTS = 1_000_000


class Lights:
    """Adds pbrt's lights to a description.

    exposure: the film's exposure factor, applied to all lights; balance: (3, 3) matrix of its white balance, or None.
    """

    def __init__(self, files: SceneFiles, textures: Textures, description: SceneDescription, notes: Notes) -> None:
        self._files, self._textures, self._description, self._notes = files, textures, description, notes
        self._maps: dict[tuple[object, ...], EmissionMap] = {}
        self.exposure = 1.0
        self.balance: Matrix | None = None

    def add(self, source: Parameters, world: Matrix) -> None:
        """Adds a light to the description. world: (4, 4) from light space."""
        place = source.place
        if len(self._description.lights) >= _MOST_LIGHTS:
            raise place.error(
                Sentence(
                    "pbrt-lights-too-many",
                    "there are more than {most} lights; remove some",
                    most=_MOST_LIGHTS,
                )
            )
        if source.type == "infinite":
            self._infinite(source, world)
        elif source.type == "distant":
            start, end = source.vector("from", (0.0, 0.0, 0.0)), source.vector("to", (0.0, 0.0, 1.0))
            towards = product(world[:3, :3], (np.array(end) - np.array(start))[:, None])[:, 0]
            scale = source.number("scale", 1.0)
            illuminance = source.number("illuminance", -1.0)
            rgb = self._times(self._color(source, "L"), scale * (illuminance if illuminance > 0 else 1.0))
            self._description.lights.append(Light("directional", rgb, direction=_unit(towards), name="distant"))
        elif source.type in ("goniometric", "projection"):
            self._add_mapped_light(source, world)
        elif source.type == "point":
            scale = source.number("scale", 1.0)
            power = source.number("power", -1.0)
            rgb = self._times(self._color(source, "I"), power / (4 * math.pi) * scale if power > 0 else scale)
            at = self._transformed_point(source.vector("from", (0.0, 0.0, 0.0)), world)
            self._description.lights.append(Light("point", rgb, at, name=source.type))
        elif source.type == "spot":
            self._spot(source, world)
        else:
            source.used.update(source.values)
            self._notes.add(
                place, Sentence("light-type-unsupported", "{what} is not supported as a light: it is left out", what=source)
            )

    def surface_emission(self, source: Parameters, areas: np.ndarray) -> Emission:
        """Returns the emission of an area light's surface; none, with a note, for unsupported types.

        areas: (n,) areas of those parts of the surface that pbrt treats as separate lights; they convert a power to a radiance.
        """
        if source.type != "diffuse":
            self._notes.add(
                source.place,
                Sentence(
                    "pbrt-area-light-type-unsupported",
                    "{source} is not supported as a light: its surface does not emit",
                    source=source,
                ),
            )
            return Emission()
        both = source.boolean("twosided", False)
        factor = source.number("scale", 1.0)
        texture, mean = None, 1.0
        if source.text("filename"):
            texture = self._picture(source)
            if texture is not None:
                mean = luminance(self._mean_color(texture))
        power = source.number("power", -1.0)
        if power > 0:
            spread = float(areas.sum())
            if not spread > 0:
                return Emission()
            if len(areas) > 1 and areas.max() > 1.01 * areas.min():
                self._notes.add(
                    source.place,
                    Sentence(
                        "pbrt-area-light-power-spread",
                        "The power of an area light is spread evenly over its triangles",
                    ),
                )
            factor *= power * len(areas) / (math.pi * spread * (2 if both else 1) * max(mean, 1e-9))
        rgb = self._times(self._color(source, "L"), factor)
        return Emission(rgb, texture, both)

    def _picture(self, source: Parameters) -> int | None:
        name = self._files.find(source.text("filename"), source.place.file)
        if name is None:
            self._textures.shelf.warn_of_missing(source.text("filename"), str(source.place))
            return None
        return self._textures.shelf.texture(self._textures.shelf.image_file(name), "clamp", "clamp")

    def _mean_color(self, texture: int) -> Vec3:
        r, g, b = (float(v) for v in linear(self._textures.shelf.image_of(texture)).reshape(-1, 3).mean(axis=0))
        return r, g, b

    def _color(self, source: Parameters, name: str) -> Vec3:
        return self._textures.colors.light(source.color(name))

    def _times(self, rgb: Vec3, factor: float) -> Vec3:
        seen = rgb if self.balance is None else (float((row * rgb).sum()) for row in self.balance)
        r, g, b = (min(max(v * factor * self.exposure, 0.0), _MAX_RADIANCE) for v in seen)
        return r, g, b

    @staticmethod
    def _transformed_point(point: Vec3, world: Matrix) -> Vec3:
        x, y, z = (float(v) for v in product(world, np.array([*point, 1.0])[:, None])[:3, 0])
        return x, y, z

    def _add_mapped_light(self, source: Parameters, world: Matrix) -> None:
        """Adds a goniometric or projection light: a point light with an image of its emission by direction."""
        is_projection = source.type == "projection"
        name = self._files.find(source.text("filename"), source.place.file)
        image = None if name is None else self._textures.shelf.image_file(name)
        if name is None and source.text("filename"):
            self._textures.shelf.warn_of_missing(source.text("filename"), str(source.place))
        if image is None and is_projection:
            self._notes.add(
                source.place,
                Sentence("pbrt-projection-light-without-picture", "A projection light without an image is left out"),
            )
            return
        scale, power, fov = source.number("scale", 1.0), source.number("power", -1.0), source.number("fov", 90.0)
        pixels = np.ones((1, 1, 3), np.float32) if image is None else np.maximum(linear(self._description.images[image]), 0)
        if not is_projection and pixels.shape[0] != pixels.shape[1]:
            self._notes.add(
                source.place,
                Sentence(
                    "pbrt-goniometric-picture-not-square",
                    "The image of a goniometric light is not square, as pbrt requires: it emits evenly",
                ),
            )
            pixels = np.full((1, 1, 3), pixels.mean(), np.float32)
        if power > 0:
            whole = projected_power(pixels, fov) if is_projection else 4 * math.pi * float(pixels.mean())
            scale *= power / max(whole, 1e-12)
        is_mirrored = bool(np.linalg.det(world[:3, :3]) < 0)
        key = source.type, image, fov, is_mirrored
        if key not in self._maps:
            self._maps[key] = (
                projection(pixels, fov, is_mirrored) if is_projection else goniometric(pixels.mean(axis=2), is_mirrored)
            )
        rgb = self._times((1.0, 1.0, 1.0) if is_projection else self._color(source, "I"), scale)
        at = self._transformed_point((0.0, 0.0, 0.0), world)
        light = Light("point", rgb, at, _unit(world[:3, 2]), emission=self._maps[key], up=_unit(world[:3, 1]), name=source.type)
        self._description.lights.append(light)

    def _spot(self, source: Parameters, world: Matrix) -> None:
        outer = min(max(source.number("coneangle", 30.0), 0.01), 180.0)
        inner = min(max(outer - source.number("conedeltaangle", 5.0), 0.0), outer)
        end, start = math.cos(math.radians(outer)), math.cos(math.radians(inner))
        scale, power = source.number("scale", 1.0), source.number("power", -1.0)
        if power > 0:
            scale *= power / (2 * math.pi * ((1 - start) + (start - end) / 2))
        first, last = np.array(source.vector("from", (0.0, 0.0, 0.0))), np.array(source.vector("to", (0.0, 0.0, 1.0)))
        towards = product(world[:3, :3], (last - first)[:, None])[:, 0]
        x, y, z = (float(v) for v in first)
        rgb = self._times(self._color(source, "I"), scale)
        light = Light(
            "spot",
            rgb,
            self._transformed_point((x, y, z), world),
            _unit(towards),
            inner_cone=inner,
            outer_cone=outer,
            falloff="smooth",
            name="spot",
        )
        self._description.lights.append(light)

    def _infinite(self, source: Parameters, world: Matrix) -> None:
        if source.numbers("portal", "point3", "point") is not None:
            self._notes.add(
                source.place,
                Sentence(
                    "pbrt-infinite-light-portal-ignored",
                    "The portal of an infinite light is ignored: it emits from all directions",
                ),
            )
        scale, illuminance = source.number("scale", 1.0), source.number("illuminance", -1.0)
        if not source.text("filename"):
            factor = scale * (illuminance / math.pi if illuminance > 0 else 1.0)
            self._surround(Environment(self._times(self._color(source, "L"), factor)), source)
            return
        name = self._files.find(source.text("filename"), source.place.file)
        image = None
        if name is None:
            self._textures.shelf.warn_of_missing(source.text("filename"), str(source.place))
        else:
            image = self._textures.shelf.environment_file(name)
        if image is None:
            return
        pixels = np.maximum(linear(self._description.images[image]), 0)
        if pixels.shape[0] != pixels.shape[1]:
            self._notes.add(
                source.place,
                Sentence(
                    "pbrt-infinite-light-not-square",
                    "The image of an infinite light is not square, as pbrt requires: it is read as equirectangular, +Z up",
                ),
            )
            pixels = _square(pixels)
        if illuminance > 0:
            scale *= illuminance / max(_illuminance(pixels), 1e-9)
        if self.balance is not None:
            pixels = np.ascontiguousarray(np.maximum(pixels @ self.balance.T.astype(np.float32), 0))
        turn = _rotation(world[:3, :3])
        around = Image(f"{name} all around", equirectangular(pixels, turn), srgb=False)
        self._description.images[image] = around  # replaces the square image, which has no other use
        strength = min(max(scale * self.exposure, 0.0), _MAX_RADIANCE)
        self._surround(Environment((strength,) * 3, image), source)

    def _surround(self, environment: Environment, source: Parameters) -> None:
        first = self._description.environment
        if first is None:
            self._description.environment = environment
            return
        images = [each.image for each in (first, environment)]
        if None not in images:
            self._notes.add(
                source.place,
                Sentence("pbrt-second-environment-dropped", "A scene can have one environment image: this one is left out"),
            )
            return
        if images == [None, None]:
            r, g, b = (a + c for a, c in zip(first.color, environment.color, strict=True))
            self._description.environment = Environment((r, g, b))
            return
        pictured, even = (first, environment) if first.image is not None else (environment, first)
        assert pictured.image is not None
        image = self._description.images[pictured.image]
        added = image.pixels * np.array(pictured.color, np.float32) + np.array(even.color, np.float32)
        self._description.images[pictured.image] = Image(f"{image.name} and more", added.astype(np.float32), srgb=False)
        self._description.environment = Environment((1.0, 1.0, 1.0), pictured.image)


def _illuminance(pixels: np.ndarray) -> float:
    """Returns the illuminance of a horizontal surface from the upper half of a square equal-area image, estimated as in pbrt."""
    size = len(pixels)
    middles = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = np.meshgrid(middles, middles)
    depth = 1 - (np.abs(x) + np.abs(y))
    cosine = np.maximum(np.copysign(1 - (1 - np.abs(depth)) ** 2, depth), 0)
    bright = pixels @ np.array([0.2126, 0.7152, 0.0722])
    return float((bright * cosine).sum() * 2 * math.pi / size**2)


def _square(pixels: np.ndarray) -> np.ndarray:
    """Converts an equirectangular image, with +Z up and its left edge along +X, to a square equal-area image."""
    size = int(min(max(pixels.shape[0], 2), 2048))
    middles = (np.arange(size) + 0.5) / size * 2 - 1
    u, v = np.meshgrid(middles, middles)
    up, vp = np.abs(u), np.abs(v)
    depth = 1 - (up + vp)
    r = 1 - np.abs(depth)
    phi = np.where(r > 0, (vp - up) / np.maximum(r, 1e-300) + 1, 1) * np.pi / 4
    z = np.copysign(1 - r * r, depth)
    angle = np.arctan2(np.copysign(np.sin(phi), v), np.copysign(np.cos(phi), u)) % (2 * np.pi)
    row = np.clip((np.arccos(np.clip(z, -1, 1)) / np.pi * pixels.shape[0]).astype(int), 0, pixels.shape[0] - 1)
    column = np.clip((angle / (2 * np.pi) * pixels.shape[1]).astype(int), 0, pixels.shape[1] - 1)
    return np.ascontiguousarray(pixels[row, column])


def _rotation(matrix: Matrix) -> Matrix:
    """Returns a (3, 3) matrix with its columns scaled to length 1: a rotation, or a reflection if the matrix mirrors."""
    lengths = np.sqrt((matrix * matrix).sum(axis=0))
    return np.asarray(matrix / np.maximum(lengths, 1e-300))


def _unit(vector: np.ndarray) -> Vec3:
    length = float(np.sqrt((vector * vector).sum()))
    if not length > 0:
        return 0.0, 0.0, 1.0
    x, y, z = (float(v) / length for v in vector)
    return x, y, z
