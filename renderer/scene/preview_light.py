"""The light of a preview mesh: the environment in a few texels, and lamps."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.image import rgbe9995
from renderer.luminance import luminance
from renderer.preview_mesh import PreviewLamp
from renderer.scene.description import Environment, Light, SceneDescription, Sphere
from renderer.scene.environment import are_accents
from renderer.scene.material import Material
from renderer.scene.readers.linear_images import linear
from renderer.scene.sky import image_of_sky, sun_of_sky
from renderer.scene.studio import STUDIO, studio_image
from renderer.settings import Vec3

__all__ = ["emitted_power", "environment_texels", "is_studio", "lamp_of_mesh", "lamp_of_sphere", "lamps_of", "strongest"]

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
_HEIGHT = 64  # rows of texels
_SAMPLED = 8  # pixels of an image of 8 or 16 bits for a texel, along a side
_FACING = 0.9  # length of the mean normal above which an emitter is flat
_MOST_LAMPS = 16
_NEAREST = 1e-3  # of a lamp to the middle of the bounds, by their diagonal


def is_studio(description: SceneDescription, emitted: float, bounds: F64) -> bool:
    """Returns whether the scene is lit by the studio that scenes without lights are given.

    emitted: power of its surfaces. bounds: (2, 3), of what is seen.
    """
    environment = description.environment
    if environment is None:  # emitting surfaces alone may be accents, to which compiling adds the studio
        return description.studio_for_accents and not description.lights and are_accents(emitted, bounds.astype(np.float32))
    return environment.image is not None and description.images[environment.image].name == STUDIO


def environment_texels(description: SceneDescription, in_studio: bool) -> F32 | None:
    """Returns the environment's radiance, (64, 128, 3) unrotated or (1, 1, 3) if it is constant; None if it is black.

    in_studio: as is_studio returns it.
    """
    environment = description.environment
    if environment is None:
        return studio_image() if in_studio else None
    color = environment.strength * np.asarray(environment.color, np.float64)
    if environment.sky is not None:
        reduced = _reduced(image_of_sky(environment.sky))
    elif environment.image is not None:
        image = description.images[environment.image]
        pixels = image.pixels
        if pixels.dtype != np.float32:
            step = max(1, pixels.shape[0] // (_SAMPLED * _HEIGHT))
            pixels = linear(replace(image, pixels=pixels[::step, ::step], srgb=True))
        reduced = _reduced(pixels[..., :3])
    else:
        reduced = np.ones((1, 1, 3))
    radiance = np.clip(np.nan_to_num(reduced * color), 0.0, rgbe9995.MAX).astype(np.float32)
    if not radiance.any():
        return None
    turn = round(environment.rotation / 360.0 * radiance.shape[1])  # counter-clockwise seen from above: to the left
    return np.roll(radiance, -turn, axis=1)


def _reduced(radiance: npt.NDArray[Any]) -> F64:
    """Returns the means of radiance over blocks: (64, 128, 3). The texels of smaller images are repeated."""
    height, width = radiance.shape[:2]
    rows = np.arange(_HEIGHT) * height // _HEIGHT
    columns = np.arange(2 * _HEIGHT) * width // (2 * _HEIGHT)
    if height < _HEIGHT or width < 2 * _HEIGHT:
        return radiance[rows][:, columns].astype(np.float64)
    ends = [*rows[1:], height]
    blocks = (radiance[first:end].sum(axis=0) for first, end in zip(rows, ends, strict=True))  # one by one, for memory
    sums = np.stack([np.add.reduceat(block, columns, axis=0, dtype=np.float64) for block in blocks])
    counts = np.outer(np.diff([*rows, height]), np.diff([*columns, width]))
    return np.asarray(sums / counts[..., None])


def lamps_of(description: SceneDescription, bounds: F64) -> tuple[PreviewLamp, ...]:
    """Returns the scene's punctual lights and the sun of its sky. bounds: (2, 3), of what is seen."""
    middle, near = bounds.mean(axis=0), _NEAREST * max(float(np.linalg.norm(bounds[1] - bounds[0])), 1e-30)
    found = [_punctual(light, middle, near) for light in description.lights]
    if (sun := _sun(description.environment)) is not None:
        found.append(sun)
    return tuple(found)


def strongest(lamps: list[PreviewLamp]) -> tuple[PreviewLamp, ...]:
    """Returns the lamps that give the most light at the middle of the scene."""
    bright = [lamp for lamp in lamps if max(lamp.color) > 0.0 and np.isfinite([*lamp.at, *lamp.color]).all()]
    return tuple(sorted(bright, key=lambda lamp: -float(luminance(np.array(lamp.color))))[:_MOST_LAMPS])


def emitted_power(positions: F64, triangles: I64, to_world: F64, material: Material) -> float:
    """Returns the power of emitting triangles, by the luminance of their material without textures."""
    corners = (positions @ to_world[:3, :3].T)[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0
    sides = 2.0 if material.double_sided else 1.0
    return math.pi * sides * float(np.linalg.norm(normal, axis=1).sum()) * float(luminance(np.array(material.emission)))


def lamp_of_mesh(positions: F64, triangles: I64, to_world: F64, material: Material, bounds: F64) -> PreviewLamp | None:
    """Returns emitting triangles as a lamp at their middle; None if they have no area. bounds: (2, 3), of what is seen.

    Those in a plane shine to the front, as a Lambertian emitter does. Others, and those with two sides, shine in all directions.
    """
    corners = (positions @ to_world[:3, :3].T + to_world[:3, 3])[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0
    areas = np.linalg.norm(normal, axis=1)
    area = float(areas.sum())
    if not area > 0.0 or not math.isfinite(area):
        return None
    if np.linalg.det(to_world[:3, :3]) < 0.0:
        normal = -normal
    mean = normal.sum(axis=0) / area
    place = (corners.mean(axis=1) * areas[:, None]).sum(axis=0) / area
    away = max(float(np.linalg.norm(place - bounds.mean(axis=0))), math.sqrt(area) / 2.0)
    is_flat = float(np.linalg.norm(mean)) > _FACING
    sides = 1.0 if is_flat and not material.double_sided else 0.5 if is_flat else 0.25  # of the area, seen from a direction
    color = _scaled(material.emission, area * sides / (math.pi * away**2))
    if not is_flat or material.double_sided:
        return PreviewLamp(_vec(place), False, color)
    return PreviewLamp(_vec(place), False, color, _vec(mean / np.linalg.norm(mean)), (0.0, 1.0))


def lamp_of_sphere(sphere: Sphere, material: Material, bounds: F64) -> PreviewLamp:
    """Returns an emitting sphere as a lamp at its centre. bounds: (2, 3), of what is seen."""
    away = max(float(np.linalg.norm(np.asarray(sphere.center) - bounds.mean(axis=0))), sphere.radius)
    return PreviewLamp(sphere.center, False, _scaled(material.emission, (sphere.radius / away) ** 2))


def _punctual(light: Light, middle: F64, near: float) -> PreviewLamp:
    if light.kind == "directional":
        return PreviewLamp(_vec(-np.asarray(light.direction, np.float64)), True, _scaled(light.intensity, 1.0 / math.pi))
    away = max(float(np.linalg.norm(np.asarray(light.position) - middle)), near)
    color = _scaled(light.intensity, 1.0 / (math.pi * away**2))
    if light.kind != "spot":
        return PreviewLamp(light.position, False, color)
    outer, inner = (math.cos(math.radians(min(each, 180.0))) for each in (light.outer_cone, light.inner_cone))
    axis = np.asarray(light.direction, np.float64)
    axis = axis / max(float(np.linalg.norm(axis)), 1e-30)
    return PreviewLamp(light.position, False, color, _vec(axis), (outer, max(inner, outer + 1e-3)))


def _sun(environment: Environment | None) -> PreviewLamp | None:
    if environment is None or environment.sky is None or (sun := sun_of_sky(environment.sky)) is None:
        return None
    turn = math.radians(environment.rotation)
    x, y, z = sun.direction.tolist()
    at = (x * math.cos(turn) + z * math.sin(turn), y, z * math.cos(turn) - x * math.sin(turn))
    color = np.asarray(sun.radiance) * math.sin(sun.half_angle) ** 2 * environment.strength * np.asarray(environment.color)
    return PreviewLamp(at, True, _vec(color))


def _scaled(color: Vec3, factor: float) -> Vec3:
    r, g, b = (channel * factor for channel in color)
    return r, g, b


def _vec(values: F64) -> Vec3:
    x, y, z = values.tolist()
    return x, y, z
