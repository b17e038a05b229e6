"""Light from infinitely far as tables: the radiance, and the cdfs by which the kernel samples it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.scene.description import F32, SceneDescription
from renderer.scene.lights import cumulative, luminance

__all__ = ["EnvironmentTables", "are_accents", "choose_environment", "tabulate_environment"]

_MAX_RADIANCE = 1e9  # float32 products of a few such values stay finite


class EnvironmentTables(NamedTuple):
    """As in CompiledScene, without the probability of choosing it."""

    radiance: F32  # (H, W, 3)
    marginal: F32  # (H + 1,)
    conditional: F32  # (H, W + 1)
    rotation: float  # radians
    mean: float  # luminance, averaged over all directions
    contrast: float  # 0 for an even sky, towards 1 for a sun in a black one


def tabulate_environment(description: SceneDescription) -> EnvironmentTables:
    """The environment's radiance and its cdfs: rows by weight times solid angle, then columns by weight.

    (1, 1, 3) where it is constant, of zeros where there is none. A texel's weight is what its luminance exceeds the mean by:
    light below that BSDF sampling finds well by itself, and the two together have half the variance (measured on the
    studio). Source: Karlik et al., MIS Compensation, 2019; PBRT 4ed, 12.5.
    """
    source = description.environment
    if source is None:
        black = np.zeros((1, 1, 3), np.float32)
        return EnvironmentTables(black, cumulative(np.ones(1)), cumulative(np.ones((1, 1))), 0.0, 0.0, 0.0)
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
    return EnvironmentTables(radiance, cumulative(rows), cumulative(weight), np.radians(source.rotation), mean, contrast)


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


def _linear(encoded: np.ndarray) -> np.ndarray:
    level = (np.arange(256) / 255.0).astype(np.float32)
    table = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4).astype(np.float32)
    return table[encoded]
