"""Renders the thumbnails of the light presets, and their radiance for previews: python -m scenes.light_pictures"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from renderer.image import encode
from renderer.presets import PRESETS
from renderer.scene.description import Environment, SceneDescription, Sky
from renderer.scene.presets import light_by_name, preset_image
from renderer.scene.sky import image_of_sky, sun_of_sky
from worker.reading.environments import small_picture

FOLDER = Path(__file__).parent.parent / "service" / "light_pictures"
WIDTH = 160
RADIANCE = FOLDER / "radiance.npz"
ROWS = 64  # of a table, as of a preview mesh's environment


def radiance(name: str) -> np.ndarray:
    """Returns a preset's environment, (h, w, 3): a sky with its sun, enlarged."""
    description = SceneDescription(name="light")
    light_by_name(name, description)
    light = description.environment or Environment()
    if light.sky is not None:
        return _with_sun(light.sky)
    if light.image is not None:
        return np.asarray(description.images[light.image].pixels)
    return np.ones((WIDTH // 2, WIDTH, 3), np.float32)


def _with_sun(sky: Sky) -> np.ndarray:
    pixels = np.array(image_of_sky(sky))
    sun = sun_of_sky(sky)
    if sun is not None:
        height, width = pixels.shape[:2]
        elevation = np.pi / 2 - (np.arange(height) + 0.5) * np.pi / height
        around = (np.arange(width) + 0.5) * 2 * np.pi / width - np.pi
        level = np.cos(elevation)[:, None]
        towards = np.stack(
            np.broadcast_arrays(level * np.sin(around), np.sin(elevation)[:, None], -level * np.cos(around)), axis=-1
        )
        disk = towards @ sun.direction > np.cos(np.radians(3))
        pixels[disk & (elevation > 0)[:, None]] += 20
    return pixels


def table(name: str) -> np.ndarray:
    """Returns the radiance, which is grey, of a preset that is not a sky: (64, 128) float16."""
    image = preset_image(name)[..., 0]
    step = len(image) // ROWS
    return image.reshape(ROWS, step, 2 * ROWS, step).mean((1, 3)).astype(np.float16)


def make() -> None:
    """Writes all thumbnails and the tables."""
    FOLDER.mkdir(exist_ok=True)
    np.savez_compressed(RADIANCE, **{name: table(name) for name, preset in PRESETS.items() if preset.sky is None})
    for name in PRESETS:
        encode.write(FOLDER / f"{name}.jpg", small_picture(radiance(name), WIDTH))


if __name__ == "__main__":
    make()
