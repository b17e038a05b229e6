"""Motion while the shutter is open, in the kernel's form: keys of instances, spheres and punctual lights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.bvh.layout import KEY_COLUMNS
from renderer.bvh.rigid_motion import motion_keys
from renderer.bvh.transforms import scale_range
from renderer.scene.description import F32, EmissionMap, Light, SceneDescription
from renderer.scene.emission_maps import emission_frames
from renderer.scene.geometry import Placement, keys_step
from renderer.scene.punctual import is_emitting, light_rows

__all__ = ["emission_frame_keys", "instance_keys", "punctual_keys", "scale_ranges", "sphere_keys"]

F64 = npt.NDArray[np.float64]

_STANDS_STILL = np.zeros((0, KEY_COLUMNS))


def instance_keys(description: SceneDescription, placement: Placement) -> list[F64]:
    """Returns the transform keys of each moving instance, arrays (K, KEY_COLUMNS); an empty list if no transform changes.

    The array of an instance that does not move while the shutter is open has no rows.
    """
    shown = [description.instances[n] for n in placement.number[placement.still :]]
    moving = [i for i, instance in enumerate(shown) if instance.keys]
    if not moving:
        return []
    found = [_STANDS_STILL] * len(shown)
    places = np.array([[np.asarray(key, np.float64)[:3] for key in shown[i].keys] for i in moving])
    for i, keys in zip(moving, motion_keys(places), strict=True):
        found[i] = keys
    return found


def scale_ranges(description: SceneDescription, placement: Placement) -> F64:
    """Returns the maximum and minimum scale, (I, 2), of each placed instance's transform while the shutter is open."""
    found = scale_range(placement.to_world)
    for i, number in enumerate(placement.number):
        if keys := description.instances[number].keys:
            own = scale_range(np.array([np.asarray(key, np.float64)[:3] for key in keys]))
            found[i] = own[:, 0].max(), own[:, 1].min()
    return found


def sphere_keys(description: SceneDescription, numbers: Sequence[int]) -> F32:
    """Returns the centres and radii, (K, Z, 4), of the spheres `numbers` at the K keys that linear interpolation uses.

    Returns an empty array if neither spheres nor vertices move while the shutter is open.
    """
    balls = [description.spheres[n] for n in numbers]
    loose = [mesh for mesh in description.meshes if mesh.keys]
    if not any(ball.keys for ball in balls) and not (balls and loose):
        return np.zeros((0, 0, 4), np.float32)
    step = keys_step(description)
    over: list[list[Any]] = [list((ball.keys or ((ball.center, ball.radius),) * description.keys)[::step]) for ball in balls]
    return np.array([[(*center, radius) for center, radius in ball] for ball in over], np.float32).transpose(1, 0, 2)


def punctual_keys(lights: Sequence[Light]) -> F32:
    """Returns the table rows (J, 12) of all emitting lights at all keys, light by light; empty if all lights are static."""
    return np.array([row for over in _lights_at_keys(lights) for row in light_rows(over)], np.float32).reshape(-1, 12)


def emission_frame_keys(lights: Sequence[Light], maps: Sequence[EmissionMap]) -> F32:
    """Returns the emission frames (J, 4) of these lights, in the order of `punctual_keys`; empty without maps."""
    return emission_frames([each for over in _lights_at_keys(lights) for each in over], maps)


def _lights_at_keys(lights: Sequence[Light]) -> list[Sequence[Light]]:
    """Returns each emitting light at all keys of the shutter, with the emission map of the middle of the shutter at each key."""
    lights = [light for light in lights if is_emitting(light)]
    keys = max((len(light.keys) for light in lights), default=0)
    return [[replace(each, emission=light.emission) for each in light.keys] or [light] * keys for light in lights]
