"""What shines: the list of emitting primitives, chosen by power, and the tables by which an environment is sampled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.scene.description import F32, I32, SceneDescription

__all__ = [
    "EnvironmentTables",
    "LightList",
    "are_accents",
    "choose_environment",
    "list_lights",
    "luminance",
    "tabulate_environment",
]

_SPREAD = 0.01  # of the choices fall on all lights evenly
_MAX_RADIANCE = 1e9  # float32 products of a few such values stay finite


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Rec.709 luminance of (..., 3)."""
    return rgb @ np.array([0.2126, 0.7152, 0.0722])


class LightList(NamedTuple):
    """As in CompiledScene, and the sum of all powers in units of luminance."""

    primitive: I32  # (L,)
    cdf: F32  # (L + 1,)
    area: F32  # (L,)
    triangle_light: I32  # (T,)
    sphere_light: I32  # (S,)
    power: float


class EnvironmentTables(NamedTuple):
    """As in CompiledScene, without the probability of choosing it."""

    radiance: F32  # (H, W, 3)
    marginal: F32  # (H + 1,)
    conditional: F32  # (H, W + 1)
    rotation: float  # radians
    mean: float  # luminance, averaged over all directions
    contrast: float  # 0 for an even sky, towards 1 for a sun in a black one


def list_lights(
    emitted: np.ndarray,
    position: F32,
    triangle: I32,
    triangle_material: I32,
    sphere: F32,
    sphere_material: I32,
    punctual_power: np.ndarray,
) -> LightList:
    """The primitives whose material emits, then the punctual lights: emitted is (M,) mean luminance of all sides of each
    material, punctual_power (K,).

    The chance of choosing a light is its power (a primitive's: pi * area * radiance) over the sum of all, but for one choice in
    a hundred: else float32 would never choose a candle under a stadium's lamps.
    """
    triangles = np.flatnonzero(emitted[triangle_material] > 0) if len(triangle) else np.zeros(0, np.int64)
    a, b, c = (position[triangle[triangles, k]].astype(np.float64) for k in range(3))
    triangle_area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    spheres = np.flatnonzero(emitted[sphere_material] > 0) if len(sphere) else np.zeros(0, np.int64)
    sphere_area = 4 * np.pi * sphere[spheres, 3].astype(np.float64) ** 2

    count = len(punctual_power)
    rest = len(triangle) + len(sphere) + np.arange(count)
    primitive = np.concatenate([triangles, len(triangle) + spheres, rest]).astype(np.int32)
    area = np.concatenate([triangle_area, sphere_area, np.zeros(count)])
    radiance = np.concatenate([emitted[triangle_material[triangles]], emitted[sphere_material[spheres]]])
    power = np.concatenate([np.pi * area[: len(radiance)] * radiance, punctual_power])
    triangle_light = np.full(len(triangle), -1, np.int32)
    triangle_light[triangles] = np.arange(len(triangles))
    sphere_light = np.full(len(sphere), -1, np.int32)
    sphere_light[spheres] = len(triangles) + np.arange(len(spheres))
    chance = (1 - _SPREAD) * power / max(power.sum(), 1e-300) + _SPREAD / max(len(power), 1)
    return LightList(primitive, _cdf(chance), area.astype(np.float32), triangle_light, sphere_light, float(power.sum()))


def tabulate_environment(description: SceneDescription) -> EnvironmentTables:
    """The environment's radiance and its cdfs: rows by weight times solid angle, then columns by weight.

    (1, 1, 3) where it is constant, of zeros where there is none. A texel's weight is what its luminance exceeds the mean by:
    light below that BSDF sampling finds well by itself, and the two together have half the variance (measured on the
    studio). Source: Karlik et al., MIS Compensation, 2019; PBRT 4ed, 12.5.
    """
    source = description.environment
    if source is None:
        return EnvironmentTables(np.zeros((1, 1, 3), np.float32), _cdf(np.ones(1)), _cdf(np.ones((1, 1))), 0.0, 0.0, 0.0)
    color = np.array(source.color, np.float64) * source.strength
    if source.image is None:
        radiance = np.minimum(color, _MAX_RADIANCE).astype(np.float32).reshape(1, 1, 3)
    else:
        pixels = description.images[source.image].pixels
        if pixels.dtype == np.uint8:
            pixels = _linear(pixels[..., :3])
        with np.errstate(over="ignore"):
            radiance = np.clip(pixels[..., :3] * color.astype(np.float32), 0, np.float32(_MAX_RADIANCE))
    bright = luminance(radiance.astype(np.float64))
    height = len(bright)
    solid_angle = -np.diff(np.cos(np.arange(height + 1) * np.pi / height))  # of a row, over 2 pi
    mean = float((bright.mean(axis=1) * solid_angle).sum() / 2)
    mean_square = float((np.square(bright).mean(axis=1) * solid_angle).sum() / 2)
    contrast = max(1 - mean * mean / mean_square, 0.0) if mean_square > 0 else 0.0
    weight = np.maximum(bright - mean, 0)
    rows = weight.mean(axis=1) * solid_angle
    return EnvironmentTables(radiance, _cdf(rows), _cdf(weight), np.radians(source.rotation), mean, contrast)


def choose_environment(environment: EnvironmentTables, lights_power: float, bounds: F32) -> float:
    """The probability of sampling the environment rather than a light: by power into the scene, yet neither is starved.

    A disk as large as the scene's bounding sphere receives pi * (pi R^2) * mean radiance from the environment. Of that only
    the share counts which BSDF sampling finds badly: an even sky is better left to it, and MIS weighs both correctly.
    """
    if environment.mean <= 0:
        return 0.0
    if lights_power <= 0:
        return 1.0
    arriving = _sky_power(bounds) * environment.mean * environment.contrast
    return float(np.clip(arriving / (arriving + lights_power), 0.1, 0.8))


def are_accents(lights_power: float, bounds: F32) -> bool:
    """Whether lights give the scene less than a twentieth of what a sky of radiance 1 would."""
    return lights_power < 0.05 * _sky_power(bounds)


def _sky_power(bounds: F32) -> float:
    radius = 0.5 * float(np.linalg.norm(bounds[1].astype(np.float64) - bounds[0]))
    return np.pi * np.pi * radius * radius


def _cdf(weights: np.ndarray) -> F32:
    """The cdf over the last axis, with a 0 in front and exactly 1 at the end; uniform where all weights are 0."""
    count = weights.shape[-1]
    total = weights.sum(axis=-1, keepdims=True)
    weights = np.where(total > 0, weights, 1.0)
    sums = np.cumsum(weights, axis=-1)
    cdf = np.zeros((*weights.shape[:-1], count + 1), np.float32)
    if count:
        cdf[..., 1:] = sums / sums[..., -1:]
        cdf[..., -1] = 1.0
    return cdf


def _linear(encoded: np.ndarray) -> np.ndarray:
    level = (np.arange(256) / 255.0).astype(np.float32)
    table = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4).astype(np.float32)
    return table[encoded]
