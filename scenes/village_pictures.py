"""Textures of scenes/christmas.py: bricks with their decals, ice, wool, window panes, and a dusk sky."""

from __future__ import annotations

import numpy as np

__all__ = ["pictures"]

Pixels = np.ndarray


def pictures(random: np.random.Generator) -> dict[str, Pixels]:
    """Returns textures by file name, (h, w, 3 or 4) uint8."""
    return {
        "bricks.png": _bricks(random),
        "grime.png": _grime(random),
        "frost.png": _frost(random),
        "soot.png": _soot(random),
        "ice.png": _ice(random),
        "drift.png": _drift(random),
        "panes.png": _panes(),
        "curtains.png": _curtains(),
        "wool.png": _wool(),
        "sky.png": _sky(random),
    }


def _encoded(linear: Pixels) -> Pixels:
    linear = np.clip(linear, 0, 1)
    return np.rint(
        255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    ).astype(np.uint8)


def _noise(random: np.random.Generator, h: int, w: int, cells: int) -> Pixels:
    """Returns smooth, tileable noise in 0..1 of four octaves."""
    total = np.zeros((h, w))
    for octave in range(4):
        n = cells << octave
        grid = random.random((n, n))
        y, x = np.arange(h)[:, None] * n / h, np.arange(w)[None] * n / w
        j, i = np.floor(y).astype(int), np.floor(x).astype(int)
        t, s = (f * f * (3 - 2 * f) for f in (y - j, x - i))
        above = grid[j % n, i % n] * (1 - s) + grid[j % n, (i + 1) % n] * s
        below = grid[(j + 1) % n, i % n] * (1 - s) + grid[(j + 1) % n, (i + 1) % n] * s
        total += (above * (1 - t) + below * t) / 2 ** (octave + 1)
    return total / 0.9375


def _bricks(random: np.random.Generator) -> Pixels:
    """Returns one metre of bricks: eight courses of four."""
    size, courses, across = 128, 8, 4
    y, x = np.mgrid[0:size, 0:size] + 0.5
    course = (y * courses / size).astype(int)
    shifted = x * across / size + 0.5 * (course % 2)
    column = shifted.astype(int) % across
    in_y, in_x = y * courses / size % 1, shifted % 1
    mortar = (in_y < 0.11) | (in_x < 0.055)
    shade = random.uniform(0.6, 1.25, (courses, across))[course, column]
    hue = random.uniform(0, 1, (courses, across))[course, column]
    brick = np.array([0.36, 0.085, 0.05]) * (1 - hue[..., None]) + np.array([0.27, 0.10, 0.07]) * hue[..., None]
    grain = 0.85 + 0.3 * np.rint(6 * _noise(random, size, size, 16)) / 6
    linear = np.where(mortar[..., None], np.array([0.30, 0.28, 0.25]), brick * shade[..., None]) * grain[..., None]
    return _encoded(linear)


def _grime(random: np.random.Generator) -> Pixels:
    """Returns dirt on walls: white if clean, brown streaks below the eaves and along the ground."""
    h, w = 64, 64
    streaks = _noise(random, 1, w, 8)
    down = np.linspace(0, 1, h)[:, None]
    dirt = np.clip(1.6 * (0.55 - down) * streaks + 0.9 * (down - 0.72) + 0.25 * (_noise(random, h, w, 4) - 0.4), 0, 0.75)
    linear = 1 - dirt[..., None] * np.array([0.75, 0.85, 0.95])
    return _encoded(np.rint(linear * 24) / 24)


def _frost(random: np.random.Generator) -> Pixels:
    """Returns snow blown against the foot of a wall, with specks further up; alpha is its coverage."""
    h, w = 96, 128
    up = np.linspace(1, 0, h)[:, None]
    noise = _noise(random, h, w, 4)
    drift = np.clip(5 * (0.30 + 0.32 * (noise - 0.5) - up), 0, 1)
    specks = np.clip(9 * (_noise(random, h, w, 16) - 0.66), 0, 1) * 0.8 * np.clip(8 * (1 - up), 0, 1)  # none at the top
    alpha = np.rint(np.maximum(drift, specks) * 15) * 17
    return np.dstack([np.full((h, w, 3), (238, 242, 250)), alpha]).astype(np.uint8)


def _soot(random: np.random.Generator) -> Pixels:
    """Returns a decal: black at the top, where snow and soot cover the bricks, and white where the bricks are visible."""
    h, w = 64, 32
    up = np.linspace(1, 0, h)[:, None]
    shown = np.clip(4 * (0.8 + 0.5 * (_noise(random, h, w, 4) - 0.5) - up), 0, 1)
    return np.repeat((np.rint(shown * 15) * 17)[..., None], 3, axis=2).astype(np.uint8)


def _ice(random: np.random.Generator) -> Pixels:
    """Returns dark ice with paler cracks."""
    size = 128
    fields = _noise(random, size, size, 3), _noise(random, size, size, 5)
    cracks = sum(np.exp(-(((f - 0.5) / 0.012) ** 2)) for f in fields)
    linear = np.array([0.012, 0.03, 0.05]) + 0.1 * np.clip(cracks, 0, 1)[..., None] * np.array([0.7, 0.9, 1.0])
    return _encoded(np.rint(linear * 160) / 160)


def _drift(random: np.random.Generator) -> Pixels:
    """Returns snow on the ice, denser towards the shore."""
    size = 128
    y, x = (np.mgrid[0:size, 0:size] + 0.5) / size * 2 - 1
    alpha = np.clip(5 * (np.hypot(x, y) ** 2 * 0.55 + 0.75 * _noise(random, size, size, 3) - 0.66), 0, 1)
    return np.dstack([np.full((size, size, 3), (236, 241, 250)), np.rint(alpha * 15) * 17]).astype(np.uint8)


def _panes() -> Pixels:
    """Returns six panes between bars, brightest at the centre of the room behind."""
    h, w = 60, 56
    y, x = np.mgrid[0:h, 0:w]
    glow = 0.45 + 0.55 * np.exp(-(((x - 28) / 20) ** 2) - ((y - 36) / 24) ** 2)
    linear = glow[..., None] * np.array([1.0, 0.62, 0.26])
    bars = (np.abs(x - 27.5) < 1.6) | (np.abs(y - 19.5) < 1.6) | (np.abs(y - 39.5) < 1.6)
    return _encoded(np.where(bars[..., None], 0.02, linear))


def _curtains() -> Pixels:
    """Returns white with two curtains at the sides."""
    h, w = 60, 56
    y, x = np.mgrid[0:h, 0:w]
    edge = 6 + 11 * np.exp(-y / 26.0)
    folds = 0.55 + 0.2 * np.cos(x * 1.3)
    drawn = (np.minimum(x, w - 1 - x) < edge)[..., None]
    return _encoded(np.where(drawn, folds[..., None] * np.array([0.95, 0.35, 0.25]), 1.0))


def _wool() -> Pixels:
    """Returns red and white stripes."""
    stripe = (np.arange(32) // 4 % 2)[:, None, None] * np.ones((1, 8, 1))
    return _encoded(np.where(stripe > 0, np.array([0.75, 0.72, 0.66]), np.array([0.45, 0.02, 0.025])))


def _sky(random: np.random.Generator) -> Pixels:
    """Returns an equirectangular dusk sky: afterglow behind the hills, deep blue above, an aurora between."""
    h, w = 256, 512
    up = np.linspace(np.pi / 2, -np.pi / 2, h)[:, None]
    around = (np.arange(w)[None] + 0.5) / w * 2 * np.pi - np.pi  # 0 at the centre, which is at -Z
    low = np.exp(-np.maximum(up, 0) / 0.16)[..., None]
    middle = np.exp(-(((up - 0.28) / 0.24) ** 2))[..., None]
    west = (0.55 + 0.45 * np.cos(around - 0.35))[..., None]
    linear = np.array([0.012, 0.03, 0.095]) + middle * np.array([0.016, 0.06, 0.13])
    linear = linear + low * west * np.array([0.42, 0.20, 0.17])
    curl = 0.10 * np.sin(2 * around + 0.7) + 0.05 * np.sin(5 * around) + 0.02 * np.sin(13 * around + 1.0)
    rays = 0.55 + 0.45 * _noise(random, 1, w, 16)
    height = up - 0.24 - curl
    curtain = np.where(height > 0, np.exp(-height / 0.13), np.exp(height / 0.022)) * rays * np.exp(-((around / 1.1) ** 2))
    tip = np.clip(height / 0.35, 0, 1)[..., None]
    linear = linear + 0.42 * curtain[..., None] * ((1 - tip) * np.array([0.10, 0.85, 0.42]) + tip * np.array([0.45, 0.15, 0.75]))
    ground = np.array([0.05, 0.06, 0.085])
    below = np.clip(-up / 0.05, 0, 1)[..., None]
    return _encoded(linear * (1 - below) + ground * below)
