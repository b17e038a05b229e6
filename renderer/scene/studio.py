"""The default lighting of scenes without lights, and the floor that a scene may be given.

The lighting is a photographer's studio, soft and neutral: a key light from the left front, a rim light from behind on the right,
and walls that are brighter above than below. These show shapes better than uniform white light.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.scene.bounds import bounds_of
from renderer.scene.description import F32, Environment, Image, Instance, Material, Mesh, SceneDescription
from renderer.sentences import Sentence

__all__ = [
    "FLOOR",
    "NO_LIGHTS_WARNING",
    "STUDIO",
    "STUDIO_NOTES",
    "WEAK_LIGHTS_WARNING",
    "add_floor",
    "light_studio",
    "studio_image",
]

# Warnings about it. Neither applies to a picture whose settings set its lighting.
NO_LIGHTS_WARNING = Sentence(
    "scene-without-light", "The scene has no light: lit by a soft studio light. Give an environment to change that."
)
WEAK_LIGHTS_WARNING = Sentence("scene-lights-weak", "The scene's own lights are weak: a soft studio light is added.")
STUDIO_NOTES = (NO_LIGHTS_WARNING, WEAK_LIGHTS_WARNING)

F64 = npt.NDArray[np.float64]

_HEIGHT = 64

# Towards the light, its radiance, and the cosine lobe's exponent. +Z is the front, where automatic cameras are.
_LAMPS = (
    ((-0.65, 0.75, 0.6), 4.2, 12.0),
    ((0.8, 0.4, -0.75), 3.0, 24.0),
)
_GROUND, _HORIZON, _ZENITH = 0.2, 0.5, 0.65

FLOOR = "studio floor"
STUDIO = "studio"  # name of the environment's image
_REACH = 30.0  # half of the floor's side, relative to the diagonal of the scene's bounds
_GAP = 1e-4  # distance from the floor to the lowest point, likewise relative: at equal height, rounding would decide visibility


def studio_image() -> F32:
    """Returns the studio's equirectangular radiance, (64, 128, 3) float32, grey. Its mean over all directions is near 0.6."""
    theta = (np.arange(_HEIGHT) + 0.5) * np.pi / _HEIGHT
    phi = (np.arange(2 * _HEIGHT) + 0.5) * np.pi / _HEIGHT - np.pi  # 0 in the middle column, which looks along -Z
    y = np.broadcast_to(np.cos(theta)[:, None], (_HEIGHT, 2 * _HEIGHT))
    x, z = np.sin(theta)[:, None] * np.sin(phi), -np.sin(theta)[:, None] * np.cos(phi)
    walls = np.where(y > 0, _HORIZON + (_ZENITH - _HORIZON) * y, _GROUND + (_HORIZON - _GROUND) * np.exp(4 * np.minimum(y, 0)))
    for direction, radiance, exponent in _LAMPS:
        towards = np.array(direction) / np.linalg.norm(direction)
        walls = walls + radiance * np.maximum(x * towards[0] + y * towards[1] + z * towards[2], 0) ** exponent
    return np.repeat(walls[..., None], 3, axis=2).astype(np.float32)


def light_studio(description: SceneDescription) -> None:
    """Sets the studio lighting as the scene's environment."""
    description.images.append(Image(STUDIO, studio_image(), srgb=False))
    description.environment = Environment(image=len(description.images) - 1)


def add_floor(description: SceneDescription, box: F64) -> None:
    """Adds a horizontal square below the scene, on which its shadows fall. Sets `subject` to the bounds of the scene without it.

    box: bounds (2, 3) below which the floor is placed. In studio lighting the floor's far end is as bright as the horizon, which
    hides its edge.
    """
    up = np.asarray(description.up, np.float64)
    axis, sign = int(np.abs(up).argmax()), float(np.sign(up[np.abs(up).argmax()]))
    size = max(float(np.linalg.norm(box[1] - box[0])), 1e-6)
    place = np.eye(4)
    place[:3, 3] = box.mean(axis=0)
    place[axis, 3] = (box[0] if sign > 0 else box[1])[axis] - sign * _GAP * size
    a, b = ((1, 2), (2, 0), (0, 1))[axis]  # their cross product is the axis
    corners = np.zeros((4, 3), np.float32)
    corners[:, a] = np.array([-1, sign, 1, -sign]) * _REACH * size
    corners[:, b] = np.array([-1, -sign, 1, sign]) * _REACH * size
    description.subject = bounds_of(description)
    description.materials.append(Material(FLOOR, base_color=(_floor_albedo(),) * 3))
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    description.meshes.append(Mesh(FLOOR, corners, triangles, material=len(description.materials) - 1))
    description.instances.append(Instance(len(description.meshes) - 1, place, name=FLOOR))


def _floor_albedo() -> float:
    """Returns the floor's albedo for which its unshadowed parts have the radiance of the studio lighting at the horizon."""
    cosine = np.cos((np.arange(_HEIGHT // 2) + 0.5) * np.pi / _HEIGHT)
    weight = cosine * np.sqrt(1 - cosine**2)
    arriving = float((studio_image()[: _HEIGHT // 2, :, 0].mean(axis=1) * weight).sum() / weight.sum())  # irradiance / pi
    return _HORIZON / arriving
