"""Packs punctual lights into table rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from renderer.errors import SceneError
from renderer.kernel.light.punctual import (
    DIRECTIONAL,
    POINT,
    SPOT,
    SPOT_LINEAR,
    SPOT_SMOOTH,
    SPOT_SMOOTH_ANGLE,
    SUN,
    SUN_UNSEEN,
)
from renderer.luminance import REC_709
from renderer.scene.description import F32, I32, EmissionMap, Light
from renderer.scene.emission_maps import NO_EMISSION, EmissionTables, emission_frames
from renderer.scene.light_tree import LightBounds
from renderer.sentences import Sentence

__all__ = ["Punctual", "is_emitting", "light_rows", "tabulate_punctual"]

_KINDS = {"point": POINT, "spot": SPOT, "directional": DIRECTIONAL}
_SUNS = {"never": DIRECTIONAL, "mirrored": SUN_UNSEEN, "always": SUN}
_SPOTS = {"squared": SPOT, "smooth": SPOT_SMOOTH, "linear": SPOT_LINEAR, "smooth angle": SPOT_SMOOTH_ANGLE}
_MAX_INTENSITY = 1e15
_MAX_RADIANCE = 1e30  # an extent that would need more is so small that it is ignored
_LEAST_STEP = 1e-3  # minimum difference of the cosines of the two cones in KHR_lights_punctual
_HARD = 1e-5  # the same for other falloffs
_LEAST_CONE = 1e-6  # steradians


class Punctual(NamedTuple):
    """The punctual-light tables of CompiledScene, and the powers and bounds by which lights are chosen.

    A row: position (directional: unit vector towards the light) 3, unit direction of emission 3, intensity (of lights with an
    extent: radiance) 3, extent 1 (the radius, negative for a disk; directional: 1 - cos of the half angle), and the spot's scale
    and offset 2.
    """

    kind: I32  # (K,)
    row: F32  # (K, 12)
    frame: F32  # (K, 4), or no rows: as returned by `emission_frames`
    power: np.ndarray  # (K,) float64, luminance; for a directional light, its power into the scene's bounding sphere
    bounds: LightBounds  # for the light tree


class _MapFlux(NamedTuple):
    """The flux of a light's emission map, and the half angle of the cone outside which the map is dark."""

    flux: np.ndarray  # (3,) for intensity 1
    reach: float  # radians from its axis, beyond which it is dark


def tabulate_punctual(
    lights: Sequence[Light], bounds: F32, maps: Sequence[EmissionMap] = (), tables: EmissionTables = NO_EMISSION
) -> Punctual:
    """Packs the lights with non-zero intensity into table rows. Raises SceneError for an invalid number.

    maps: all emission maps of the lights; tables: these maps, tabulated.
    """
    lights = [light for light in lights if is_emitting(light)]
    kind = np.array([_kind(light) for light in lights], np.int32)
    row = np.array([_row(light) for light in lights], np.float64).reshape(-1, 12)
    scene_radius = 0.5 * float(np.linalg.norm(bounds[1].astype(np.float64) - bounds[0]))
    number = {id(each): k for k, each in enumerate(maps)}
    sent = [None if light.emission is None else _flux_of(tables, number[id(light.emission)]) for light in lights]
    told = zip(lights, sent, strict=True)
    power = np.array([max(_power(each, scene_radius, s) for each in (light, *light.keys)) for light, s in told], np.float64)
    found = _bounds_over_shutter(lights, sent, _bounds(lights, sent))
    return Punctual(kind, row.astype(np.float32), emission_frames(lights, maps), power, found)


def _flux_of(tables: EmissionTables, number: int) -> _MapFlux:
    return _MapFlux(tables.flux[number], float(tables.reach[number]))


def _kind(light: Light) -> int:
    if light.kind == "directional" and all(_row(each)[9] > 0 for each in (light, *light.keys)):
        return _SUNS[light.seen]
    return _SPOTS[light.falloff] if light.kind == "spot" else _KINDS[light.kind]


def is_emitting(light: Light) -> bool:
    """Returns True if a light emits at any time while the shutter is open. Raises SceneError for an invalid number."""
    return max([max(each.intensity) for each in (light, *light.keys) if _check(each)]) > 0


def light_rows(lights: Sequence[Light]) -> F32:
    """Returns the table rows (K, 12) of one light at several times; kernels interpolate linearly between them.

    If the light has an extent at some of the times only, all rows are that of the middle.
    """
    rows = np.array([_row(light) for light in lights], np.float64).reshape(-1, 12)
    if rows[:, 9].any() and not rows[:, 9].all():  # a row of radiance and one of intensity cannot be interpolated
        rows[:] = rows[len(rows) // 2]
    return rows.astype(np.float32)


def _check(light: Light) -> bool:
    if light.kind not in _KINDS:
        raise SceneError(
            Sentence(
                "light-kind-unknown",
                "The light {name} has the kind {kind}; known are {kinds}",
                name=repr(light.name),
                kind=repr(light.kind),
                kinds=[*_KINDS],
            )
        )
    numbers = (*light.intensity, *light.position, *light.direction, light.radius, light.angle)
    if not np.isfinite(numbers).all():
        raise SceneError(
            Sentence(
                "light-value-not-finite",
                "The light {name} has a number that is not finite; correct it",
                name=repr(light.name),
            )
        )
    if not all(0 <= c <= _MAX_INTENSITY for c in light.intensity):
        raise SceneError(
            Sentence(
                "light-intensity-out-of-range",
                "The light {name} has the intensity {intensity}; it must be from 0 to 1e15",
                name=repr(light.name),
                intensity=light.intensity,
            )
        )
    if light.emission is not None and light.kind == "directional":
        raise SceneError(
            Sentence(
                "light-distant-with-picture",
                "The light {name} is directional and has a picture or profile; only point and spot lights may have one",
                name=repr(light.name),
            )
        )
    if (light.kind != "point" or light.emission is not None) and not any(light.direction):
        raise SceneError(
            Sentence(
                "light-direction-missing",
                "The light {name} has no direction; give one",
                name=repr(light.name),
            )
        )
    if not 0 <= light.radius <= 1e15:
        raise SceneError(
            Sentence(
                "light-radius-out-of-range",
                "The light {name} has the radius {radius}; it must be from 0 to 1e15",
                name=repr(light.name),
                radius=f"{light.radius:g}",
            )
        )
    if not 0 <= light.angle <= 180:
        raise SceneError(
            Sentence(
                "light-angle-out-of-range",
                "The light {name} spans {angle} degrees; it must be from 0 to 180",
                name=repr(light.name),
                angle=f"{light.angle:g}",
            )
        )
    if light.seen not in _SUNS:
        raise SceneError(
            Sentence(
                "light-visibility-unknown",
                "The light {name} has the visibility {value}; known are {choices}",
                name=repr(light.name),
                value=repr(light.seen),
                choices=[*_SUNS],
            )
        )
    if light.falloff not in _SPOTS:
        raise SceneError(
            Sentence(
                "light-falloff-unknown",
                "The light {name} has the falloff {falloff}; known are {choices}",
                name=repr(light.name),
                falloff=repr(light.falloff),
                choices=[*_SPOTS],
            )
        )
    if light.kind == "spot" and not 0 <= light.inner_cone <= light.outer_cone <= 180:
        raise SceneError(
            Sentence(
                "spot-cones-out-of-range",
                "The spot {name} has cones of {inner_cone} and {outer_cone} degrees; the inner must be "
                "from 0 to the outer, and the outer at most 180",
                name=repr(light.name),
                inner_cone=f"{light.inner_cone:g}",
                outer_cone=f"{light.outer_cone:g}",
            )
        )
    return True


def _row(light: Light) -> tuple[float, ...]:
    direction = np.array(light.direction, np.float64)
    direction = direction / (np.linalg.norm(direction) or 1.0)
    place, extent = np.array(light.position, np.float64), light.radius
    intensity = np.array(light.intensity, np.float64)
    projected = np.pi * extent * extent  # a sphere of radiance L has intensity pi r^2 L,
    if light.kind == "directional":
        place = -direction
        half = np.radians(light.angle / 2)
        extent = 2 * np.sin(half / 2) ** 2  # 1 - cos
        projected = np.pi * np.sin(half) ** 2  # and a cone of radiance L gives irradiance pi sin^2(half) L
    if intensity.max() < _MAX_RADIANCE * projected:
        value = intensity / projected
    else:
        value, extent = intensity, 0.0
    inner, outer = np.radians([light.inner_cone, light.outer_cone])
    if light.facing and light.kind != "directional":
        extent = -extent
    if light.falloff in ("linear", "smooth angle"):
        scale = -1 / max(_HARD, outer - inner)
    else:
        inner, outer = np.cos([inner, outer])
        scale = 1 / max(_LEAST_STEP if light.falloff == "squared" else _HARD, inner - outer)
    return (*place, *direction, *value, extent, scale, -outer * scale)


def _bounds(lights: Sequence[Light], sent: Sequence[_MapFlux | None]) -> LightBounds:
    """Returns the bounds of the lights' positions, emission directions and intensities.

    Points emit in all directions, spots up to their outer cone, distant lights within half their angle. Emission maps may narrow
    the directions. sent: flux and cone of each light's map, or None.
    """
    direction = np.array([light.direction for light in lights], np.float64).reshape(-1, 3)
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-300)
    place = np.array([light.position for light in lights], np.float64).reshape(-1, 3)
    distant = np.array([light.kind == "directional" for light in lights], bool)
    return LightBounds(
        center=np.where(distant[:, None], direction, place),
        radius=np.array([-1.0 if light.kind == "directional" else light.radius for light in lights]),
        axis=np.where(direction.any(axis=1, keepdims=True), direction, (0.0, 0.0, 1.0)),
        spread=np.array([_cone_half_angle(*each) for each in zip(lights, sent, strict=True)]),
        reach=np.zeros(len(lights)),
        intensity=np.array([_mean_intensity(*each) for each in zip(lights, sent, strict=True)]),
        both=np.zeros(len(lights)),
    )


def _cone_half_angle(light: Light, sent: _MapFlux | None) -> float:
    """Returns the half angle of a light's emission cone in radians. sent: flux and cone of its emission map, or None."""
    own = {"point": 180.0, "spot": light.outer_cone, "directional": light.angle / 2}[light.kind]
    return math.radians(own) if sent is None else min(math.radians(own), sent.reach)


def _mean_intensity(light: Light, sent: _MapFlux | None) -> float:
    """Returns a light's mean intensity as luminance.

    With an emission map, the map's flux is spread evenly over the emission cone.
    """
    if sent is None:
        return _luminance(light)
    cone = 4 * math.pi * math.sin(_cone_half_angle(light, sent) / 2) ** 2
    return float(np.dot(light.intensity * sent.flux, REC_709)) / max(cone, _LEAST_CONE)


def _bounds_over_shutter(lights: Sequence[Light], sent: Sequence[_MapFlux | None], bounds: LightBounds) -> LightBounds:
    """Returns the bounds enlarged to all positions and intensities while the shutter is open."""
    for i, light in enumerate(lights):
        if not light.keys:
            continue
        own = _bounds(light.keys, [sent[i]] * len(light.keys))
        distant = light.kind == "directional"
        middle = bounds.center[i] if distant else (own.center.min(axis=0) + own.center.max(axis=0)) / 2
        apart = np.linalg.norm(own.center - middle, axis=1)
        cosine = np.clip((own.axis * bounds.axis[i]).sum(axis=1), -1.0, 1.0)
        bounds.center[i] = middle
        bounds.radius[i] = -1.0 if distant else (apart + own.radius).max()
        bounds.spread[i] = min((own.spread + np.arccos(cosine)).max(), np.pi)
        bounds.intensity[i] = own.intensity.max()
    return bounds


def _luminance(light: Light) -> float:
    return float(np.dot(light.intensity, REC_709))


def _power(light: Light, scene_radius: float, sent: _MapFlux | None) -> float:
    if sent is not None:
        return float(np.dot(light.intensity * sent.flux, REC_709))
    intensity = _luminance(light)
    if light.kind == "directional":
        return np.pi * scene_radius**2 * intensity
    if light.kind == "point":
        return 4 * np.pi * intensity
    inner, outer = np.cos(np.radians([light.inner_cone, light.outer_cone]))
    return 2 * np.pi * (1 - 0.5 * (inner + outer)) * intensity
