"""Tables of the environment: its radiance, and the cdfs from which the kernel samples it."""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays.scene import CompiledScene
from renderer.luminance import luminance
from renderer.scene.cutpoints import cutpoints
from renderer.scene.description import F32, Environment, SceneDescription
from renderer.scene.lights import cumulative
from renderer.scene.readers.linear_images import linear
from renderer.scene.sky import Sun, image_of_sky, sun_of_sky
from renderer.trigonometry import sin_cos

__all__ = [
    "EnvironmentTables",
    "are_accents",
    "choose_environment",
    "environment_power",
    "environment_sampled_fully",
    "search_tables",
    "tabulate_environment",
    "with_environment_changed",
    "without_environment_sampling",
]

F64 = npt.NDArray[np.float64]

_MAX_RADIANCE = 1e9  # float32 products of a few such values stay finite


class EnvironmentTables(NamedTuple):
    """The environment tables of CompiledScene, and values computed with them: rotation, mean luminance, contrast and sun.

    The probability of sampling the environment rather than a light is chosen later.
    """

    radiance: F32  # (H, W, 3)
    marginal: F32  # (H + 1,)
    conditional: F32  # (H, W + 1)
    rotation: float  # radians
    mean: float  # luminance, averaged over all directions, the sun's included
    contrast: float  # 0 for a uniform sky, towards 1 for a sun in a black one
    sun: np.ndarray  # (8,): direction 3, 1 - cos of the half angle, radiance 3, share of the samples; zeros without a sun

    def frame(self, chance: float) -> F32:
        """Returns CompiledScene.environment_frame: rotation, mean luminance, `chance`, and the sun.

        chance: the probability of sampling the environment rather than a light.
        """
        sine, cosine = sin_cos(self.rotation)
        return np.array([cosine, sine, self.mean, chance, *self.sun], np.float32)


@functools.lru_cache(4)
def _solid_angles(height: int) -> F64:
    """Returns the solid angle of each row of an equirectangular image, divided by 2 pi: (height,)."""
    return -np.diff([sin_cos(k * math.pi / height)[1] for k in range(height + 1)])


def tabulate_environment(description: SceneDescription) -> EnvironmentTables:
    """Returns the environment's radiance and its cdfs: over rows by weight times solid angle, then over columns by weight.

    The radiance is (1, 1, 3) if constant, zeros if there is no environment. A texel's weight is the excess of its luminance over
    the mean: BSDF sampling handles the constant rest well, and the two together have half the variance (measured on the studio).
    Source: Karlik et al., MIS Compensation, 2019; PBRT 4ed, 12.5. Raises SceneError if a sky's parameters are invalid.
    """
    source = description.environment
    no_sun = np.zeros(8)
    if source is None:
        black = np.zeros((1, 1, 3), np.float32)
        return EnvironmentTables(black, cumulative(np.ones(1)), cumulative(np.ones((1, 1))), 0.0, 0.0, 0.0, no_sun)
    color = np.array(source.color, np.float64) * source.strength
    radiance = _radiance(description, source, color)
    bright = luminance(radiance.astype(np.float64))
    solid_angle = _solid_angles(len(bright))
    mean = float((bright.mean(axis=1) * solid_angle).sum() / 2)
    mean_square = float((np.square(bright).mean(axis=1) * solid_angle).sum() / 2)
    contrast = max(1 - mean * mean / mean_square, 0.0) if mean_square > 0 else 0.0
    weight = np.maximum(bright - mean, 0)
    rows = weight.mean(axis=1) * solid_angle
    rotation = float(np.radians(source.rotation))
    sun = sun_of_sky(source.sky) if source.sky is not None else None
    tables = EnvironmentTables(radiance, cumulative(rows), cumulative(weight), rotation, mean, contrast, no_sun)
    return tables if sun is None else _add_sun(tables, sun, color)


def _radiance(description: SceneDescription, source: Environment, color: np.ndarray) -> F32:
    if source.sky is not None:
        pixels = image_of_sky(source.sky)
    elif source.image is not None:
        pixels = description.images[source.image].pixels
        if pixels.dtype != np.float32:
            pixels = linear(replace(description.images[source.image], srgb=True))
    else:
        return np.minimum(color, _MAX_RADIANCE).astype(np.float32).reshape(1, 1, 3)
    with np.errstate(over="ignore"):
        return np.asarray(np.clip(pixels[..., :3] * color.astype(np.float32), 0, np.float32(_MAX_RADIANCE)))


def _add_sun(tables: EnvironmentTables, sun: Sun, color: np.ndarray) -> EnvironmentTables:
    """Returns the tables of a sky with its sun added."""
    x, y, z = sun.direction
    sine, cosine = sin_cos(tables.rotation)
    direction = (x * cosine + z * sine, y, z * cosine - x * sine)
    radiance = np.minimum(sun.radiance * color, _MAX_RADIANCE)
    one_minus_cos = 2 * sin_cos(sun.half_angle / 2)[0] ** 2
    from_sun = float(luminance(radiance)) * one_minus_cos / 2  # averaged over all directions
    mean = tables.mean + from_sun
    if mean <= 0:
        return tables
    share = float(np.clip(from_sun / (from_sun + tables.mean * tables.contrast), 0.1, 0.9)) if from_sun > 0 else 0.0
    contrast = (from_sun + tables.mean * tables.contrast) / mean
    return tables._replace(mean=mean, contrast=contrast, sun=np.array([*direction, one_minus_cos, *radiance, share]))


def with_environment_changed(
    scene: CompiledScene, color: tuple[float, float, float] | None, strength: float, rotation: float = 0.0
) -> CompiledScene:
    """Returns the scene with its environment multiplied by `strength` and rotated by `rotation` further degrees.

    color: replaces the environment, its image and sun included, by a constant colour, unless None. The scene's file is not
    modified: only small arrays are replaced.
    """
    if color is None and strength == 1 and rotation == 0:
        return scene
    factor = np.float32(strength)
    frame = scene.environment_frame.copy()
    if color is None:
        environment = scene.environment * factor
        frame[2] *= factor
        frame[8:11] *= factor
        sine, cosine = map(np.float64, sin_cos(math.radians(rotation)))
        frame[0], frame[1] = frame[0] * cosine - frame[1] * sine, frame[1] * cosine + frame[0] * sine
        frame[4], frame[6] = frame[4] * cosine + frame[6] * sine, frame[6] * cosine - frame[4] * sine
    else:
        environment = np.array(color, np.float32).reshape(1, 1, 3) * factor
        frame[2] = luminance(environment[0, 0])
        frame[4:] = 0
    if not environment.any() and not frame[8:11].any():
        frame[3] = 0.0
    elif frame[3] == 0.0:
        frame[3] = 0.5 if len(scene.light_primitive) else 1.0
    environment.flags.writeable = frame.flags.writeable = False
    scene = scene._replace(environment=environment, environment_frame=frame)
    return scene if color is None else scene._replace(**search_tables(cumulative(np.ones(1)), cumulative(np.ones((1, 1)))))


def environment_sampled_fully(scene: CompiledScene) -> CompiledScene:
    """Returns the scene with cdfs that cover the whole environment, for integrators without BSDF sampling.

    A texel's weight is the maximum luminance of it and its neighbours, since lookups are bilinear, not the excess over the mean.
    """
    bright = luminance(scene.environment.astype(np.float64))
    height, width = bright.shape
    if height * width == 1 or not bright.any():
        return scene
    padded = np.pad(np.pad(bright, ((1, 1), (0, 0)), "edge"), ((0, 0), (1, 1)), "wrap")
    weight = np.max([padded[y : y + height, x : x + width] for y in range(3) for x in range(3)], axis=0)
    return scene._replace(**search_tables(cumulative(weight.mean(axis=1) * _solid_angles(height)), cumulative(weight)))


def without_environment_sampling(scene: CompiledScene) -> CompiledScene:
    """Returns the scene without light sampling of its environment if that is constant and has no sun.

    BSDF sampling finds a constant environment without noise except from occlusion; a further uniform sample with its own shadow
    ray would add more noise than it removes. If some objects are invisible to shadow rays only, or to other
    kinds of rays, light sampling is kept.
    """
    frame = scene.environment_frame
    has_sun = frame[7] > 0
    if scene.environment.shape[:2] != (1, 1) or has_sun or frame[3] == 0.0 or scene.bvh.ray_roots[1:].any():
        return scene
    frame = frame.copy()
    frame[3] = 0.0
    frame.flags.writeable = False
    return scene._replace(environment_frame=frame)


def search_tables(marginal: F32, conditional: F32) -> dict[str, Any]:
    """Returns CompiledScene's search tables for sampling an environment with these cdfs: field name -> read-only array."""
    tables = {
        "environment_marginal": marginal,
        "environment_conditional": conditional,
        "environment_row_start": cutpoints(marginal),
        "environment_column_start": cutpoints(conditional),
    }
    for array in tables.values():
        array.flags.writeable = False
    return tables


def choose_environment(environment: EnvironmentTables, lights_power: float, bounds: F32) -> float:
    """Returns the probability of sampling the environment rather than a light: by power into the scene, clamped to 0.1 ... 0.8.

    The environment sends a power of pi * (pi R^2) * mean radiance through a disk as large as the scene's bounding sphere. It is
    multiplied by `environment.contrast`, the part that BSDF sampling finds badly; a uniform sky is better left to BSDF sampling.
    MIS weights both correctly. 0 without an environment, 1 without lights.
    """
    if environment.mean <= 0:
        return 0.0
    if lights_power <= 0:
        return 1.0
    arriving = environment_power(environment, bounds) * environment.contrast
    return float(np.clip(arriving / (arriving + lights_power), 0.1, 0.8))


def environment_power(environment: EnvironmentTables, bounds: F32) -> float:
    """Returns the power that the environment sends through a disk as large as the scene's bounding sphere."""
    return _sky_power(bounds) * environment.mean


def are_accents(lights_power: float, bounds: F32) -> bool:
    """Returns True if the scene's lights are too weak to light it: accents, such as a car's tail lights.

    That is if their power is less than a twentieth of what a sky of radiance 1 would send into the scene.
    """
    return lights_power < 0.05 * _sky_power(bounds)


def _sky_power(bounds: F32) -> float:
    radius = 0.5 * float(np.linalg.norm(bounds[1].astype(np.float64) - bounds[0]))
    return np.pi * np.pi * radius * radius
