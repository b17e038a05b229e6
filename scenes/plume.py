"""Writes a scene of smoke above a flame, with its grids: python scenes/plume.py FOLDER

The density is a rising column with rolls of fractal noise about its axis; the flame is the lowest part of its core.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]

SHAPE = 48, 96, 48  # voxels along x, y, z
LOW, HIGH = (-1.0, 0.0, -1.0), (1.0, 4.0, 1.0)
SCENE = """name: plume
settings: {width: 480, height: 720, spp: 256, max_depth: 48}
cameras:
  - {name: front, eye: [0.3, 1.9, 8.6], target: [0, 1.75, 0], fov: 30}
environment: {color: [0.02, 0.025, 0.035]}
lights:
  - {type: spot, position: [-4, 4.5, 3], target: [0, 2.2, 0], intensity: 125, inner_cone: 14, outer_cone: 20, radius: 0.1}
volumes:
  plume:
    density: smoke.npy
    emission: flame.npy
    emission_color: [26, 8, 1.6]
    bounds: [[-1, 0, -1], [1, 4, 1]]
materials:
  floor: {color: [0.4, 0.38, 0.35]}
  bowl: {color: [0.15, 0.14, 0.14], roughness: 0.5}
  smoke: {kind: interface, sigma_a: [1.2, 1.4, 1.6], sigma_s: [9, 9, 9], g: 0.3, volume: plume}
shapes:
  - {type: quad, material: floor, transform: [{rotate: {axis: x, degrees: -90}}, {scale: 30}]}
  - {type: disk, material: bowl, transform: [{rotate: {axis: x, degrees: -90}}, {scale: 0.4}, {translate: [0, 0.0005, 0]}]}
  - {type: cube, material: smoke, transform: [{scale: [1, 2, 1]}, {translate: [0, 2.001, 0]}]}
"""


def _noise(random: np.random.Generator, points: F64, scale: float) -> F64:
    """Returns smooth noise, -1 ... 1, at points (..., 3): random values on a lattice of that spacing, interpolated."""
    lattice = random.random((16, 16, 16)) * 2 - 1
    at = points / scale
    low = np.floor(at).astype(int)
    share = at - low
    share = share * share * (3 - 2 * share)
    total = np.zeros(points.shape[:-1])
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(corner, share, 1 - share).prod(axis=-1)
        total += weight * lattice[tuple(np.moveaxis((low + corner) % 16, -1, 0))]
    return total


def grids() -> tuple[npt.NDArray[np.float16], npt.NDArray[np.float16]]:
    """Returns the densities of the smoke and of the flame, indexed x, y, z."""
    random = np.random.default_rng(7)
    axes = [(np.arange(n) + 0.5) / n * (b - a) + a for n, a, b in zip(SHAPE, LOW, HIGH, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    height = points[..., 1]
    for scale, strength in ((1.1, 0.34), (0.5, 0.2), (0.24, 0.09)):  # turbulence grows upwards
        roll = [_noise(random, points - (0.0, 3.0, 0.0), scale) for _ in range(3)]
        points = points + np.stack(roll, axis=-1) * (strength * np.minimum(height, 2.5) / 1.6)[..., None]
    away = np.hypot(points[..., 0], points[..., 2])
    width = 0.16 + 0.17 * height
    core = np.clip(1.25 - away / width, 0, 1)
    ends = np.clip(height / 0.5, 0, 1) * np.clip((HIGH[1] - height) / 1.2, 0, 1)
    smoke = core**1.5 * ends * np.clip(1.2 - 0.2 * height, 0.2, 1)
    flame = np.clip(1.1 - away / (0.26 - 0.16 * height), 0, 1) ** 2 * np.clip(1.3 - height, 0, 1) * np.clip(height / 0.1, 0, 1)
    flame[height > 1.3] = 0
    return smoke.astype(np.float16), flame.astype(np.float16)


def main(folder: Path) -> None:
    """Writes plume.yaml, smoke.npy and flame.npy into the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    smoke, flame = grids()
    np.save(folder / "smoke.npy", smoke)
    np.save(folder / "flame.npy", flame)
    (folder / "plume.yaml").write_text(SCENE)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python scenes/plume.py FOLDER")
    main(Path(sys.argv[1]))
