"""Writes a scene of balls of fur, with their strands: python scenes/fur.py FOLDER [STRANDS]

Strands start evenly on a ball, lean, and bend under their weight; STRANDS is their number on each ball, 10,000 by default.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]

POINTS = 8
LENGTH = 0.55
SCENE = """name: fur
settings: {width: 720, height: 300, spp: 144, max_depth: 32}
cameras:
  - {name: front, eye: [0, 1.1, 9.5], target: [0, -0.12, 0], fov: 24}
environment: {color: [0.22, 0.25, 0.3]}
lights:
  - {type: directional, direction: [-0.5, -0.75, -0.55], intensity: 3}
  - {type: directional, direction: [0.7, -0.35, 0.6], intensity: 2}
materials:
  floor: {color: [0.35, 0.34, 0.33]}
  skin: {color: [0.2, 0.12, 0.1]}
  blond: {kind: hair, eumelanin: 0.12, pheomelanin: 0.12, beta_m: 0.2, beta_n: 0.3}
  brown: {kind: hair, eumelanin: 1.0, pheomelanin: 0.25, beta_m: 0.25, beta_n: 0.3}
  dyed: {kind: hair, color: [0.1, 0.32, 0.75], beta_m: 0.2, beta_n: 0.3}
shapes:
  - {type: quad, material: floor, transform: [{rotate: {axis: x, degrees: -90}}, {scale: 40}, {translate: [0, -1.45, 0]}]}
"""
BALL = """  - type: group
    transform: [{{rotate: {{axis: y, degrees: {turn}}}}}, {{translate: [{x}, 0, 0]}}]
    shapes:
      - {{type: sphere, radius: 0.99, material: skin}}
      - {{type: curves, file: fur.txt, material: {fur}}}
"""


def strands(count: int) -> F64:
    """Returns points and radii of strands on a ball of radius 1, (count, POINTS, 4)."""
    random = np.random.default_rng(5)
    k = np.arange(count) + 0.5
    height, turn = 1 - 2 * k / count, k * np.pi * (3 - np.sqrt(5))
    across = np.sqrt(1 - height * height)
    root = np.column_stack([across * np.cos(turn), height, across * np.sin(turn)])
    found = np.empty((count, POINTS, 4))
    found[:, 0, :3], at = root * 0.9, root * 0.995
    towards = root + 0.25 * random.normal(size=(count, 3))
    for i in range(1, POINTS):
        found[:, i, :3] = at
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        at = at + towards * (LENGTH / 5)
        at *= np.maximum(1.01 / np.linalg.norm(at, axis=1, keepdims=True), 1)  # outside of the ball
        towards = towards + (0, -0.28, 0) + 0.12 * random.normal(size=(count, 3))
    found[:, :, 3] = np.linspace(0.006, 0.0015, POINTS)
    return found


def main(folder: Path, count: int) -> None:
    """Writes fur.yaml and fur.txt into the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["\n".join(f"{x:.5f} {y:.5f} {z:.5f} {r:.5f}" for x, y, z, r in strand) for strand in strands(count)]
    (folder / "fur.txt").write_text("\n\n".join(lines) + "\n")
    balls = (BALL.format(fur=fur, x=x, turn=turn) for fur, x, turn in (("blond", -3, 0), ("brown", 0, 120), ("dyed", 3, 240)))
    (folder / "fur.yaml").write_text(SCENE + "".join(balls))


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit("usage: python scenes/fur.py FOLDER [STRANDS]")
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) == 3 else 10_000)
