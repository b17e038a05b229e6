"""The default lighting of scenes without lights: a photographer's studio, soft and neutral.

A key light from the left front, a rim light from behind on the right, and walls brighter above than below, which reveal shapes
better than uniform white light.
"""

from __future__ import annotations

import numpy as np

from renderer.scene.description import F32, Environment, Image, SceneDescription
from renderer.sentences import Sentence

__all__ = ["STUDIO_ALONE", "STUDIO_NOTES", "STUDIO_TOO", "light_studio", "studio_image"]

# Warnings about it. Neither applies to a picture whose settings set its lighting.
STUDIO_ALONE = Sentence(
    "scene-without-light", "The scene has no light: lit by a soft studio light. Give an environment to change that."
)
STUDIO_TOO = Sentence("scene-lights-weak", "The scene's own lights are weak: lit by a soft studio light as well.")
STUDIO_NOTES = (STUDIO_ALONE, STUDIO_TOO)

_HEIGHT = 64

# Towards the light, its radiance, and the cosine lobe's exponent. +Z is the front, where automatic cameras stand.
_LAMPS = (
    ((-0.65, 0.75, 0.6), 4.2, 12.0),
    ((0.8, 0.4, -0.75), 3.0, 24.0),
)
_GROUND, _HORIZON, _ZENITH = 0.2, 0.5, 0.65


def studio_image() -> F32:
    """Returns equirectangular radiance, (64, 128, 3) float32, grey. Its mean over all directions is near 0.6."""
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
    """Sets the studio as the scene's environment."""
    description.images.append(Image("studio", studio_image(), srgb=False))
    description.environment = Environment(image=len(description.images) - 1)
