"""The Christmas scene of scenes/lineage.py: what stands in the snow, and what falls."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scene_text import Scene, Shape, faces, sphere

__all__ = ["christmas"]


def christmas() -> Scene:
    """A snowy evening: trees, a house, a snowman, and hundreds of small balls in the air."""
    random = np.random.default_rng(1224)
    materials: dict[str, Any] = {
        "snow": {"color": [0.86, 0.88, 0.92]},
        "bark": {"color": "#4a3120"},
        "needles": {"color": "#1f4d2b"},
        "plaster": {"color": "#c9a27a"},
        "roof": {"color": "#7a2f2a"},
        "door": {"color": "#4d2c1a"},
        "coal": {"color": 0.03},
        "carrot": {"color": "#d96f1e"},
        "window": {"color": 0, "emission": [9, 5.5, 2.2]},
        "moon": {"color": 0, "emission": [5.2, 5.8, 7.0]},
        "gold": {"kind": "conductor", "metal": "gold", "roughness": 0.15},
        "silver": {"kind": "conductor", "metal": "silver", "roughness": 0.05},
        "copper": {"kind": "conductor", "metal": "copper", "roughness": 0.25},
        "mirror": {"kind": "mirror", "color": 0.95},
        "glass": {"kind": "glass", "ior": 1.5},
        "flake": {"color": 0.9},
        "lamp red": {"color": 0, "emission": [30, 3, 2]},
        "lamp green": {"color": 0, "emission": [3, 22, 5]},
        "lamp blue": {"color": 0, "emission": [3, 7, 34]},
        "lamp yellow": {"color": 0, "emission": [30, 20, 4]},
        "lamp white": {"color": 0, "emission": [24, 22, 20]},
    }
    shapes: list[Shape] = [_terrain(random)]
    bulbs = ["lamp red", "lamp green", "lamp blue", "lamp yellow", "lamp white"]
    balls = ["gold", "silver", "copper", "mirror"]
    for name, x, z, size in (("large tree", -2.1, 0.0, 1.35), ("small tree", 3.3, -2.6, 0.9), ("far tree", -4.6, -4.2, 1.1)):
        shapes += _tree(name, x, z, size, bulbs, balls, random)
    shapes += _house(1.9, -4.8)
    shapes += _snowman(1.35, 0.9)
    for i in range(420):
        x, y, z = random.uniform((-6, 0.3, -6), (6, 5.2, 4.2))
        kind = random.choice(
            ["flake", "flake", "flake", "flake", "glass", "mirror", "lamp white"], p=[0.2] * 4 + [0.08, 0.09, 0.03]
        )
        shapes.append(sphere(f"flake {i}", str(kind), (x, y, z), round(float(random.uniform(0.012, 0.032)), 4)))
    shapes.append(sphere("moon behind the camera", "moon", (-7.5, 9, 14), 3.0))
    return {
        "name": "Christmas",
        "settings": {"width": 960, "height": 600, "spp": 256, "max_depth": 10},
        "cameras": [{"name": "front", "eye": [0.2, 1.75, 8.2], "target": [0, 1.35, 0], "fov": 38}],
        "environment": {"color": [0.015, 0.022, 0.05]},
        "materials": materials,
        "shapes": shapes,
    }


def _height(x: float, z: float) -> float:
    return 0.12 * math.sin(0.9 * x + 0.4) * math.cos(0.7 * z) + 0.05 * math.sin(2.1 * x - 1.3 * z)


def _terrain(random: np.random.Generator) -> Shape:
    count = 36
    grid = np.linspace(-12, 12, count + 1)
    positions = [
        [round(float(x), 3), round(_height(x, z) + float(random.normal(0, 0.004)), 4), round(float(z), 3)]
        for z in grid
        for x in grid
    ]
    quads = []
    for j in range(count):
        for i in range(count):
            a = j * (count + 1) + i
            quads.append([a, a + count + 1, a + count + 2, a + 1])
    return faces("snow", "snow", positions, quads, smooth=True)


def _cone(name: str, material: str, x: float, y: float, z: float, radius: float, height: float, points: int = 24) -> Shape:
    # A star for a rim, so that the branches end in tips.
    rim = []
    for i in range(points):
        angle = 2 * math.pi * i / points
        r = radius * (1.0 if i % 2 == 0 else 0.8)
        rim.append(
            [
                round(x + r * math.cos(angle), 4),
                round(y + (0.0 if i % 2 == 0 else 0.06 * height), 4),
                round(z + r * math.sin(angle), 4),
            ]
        )
    tip, foot = [x, round(y + height, 4), z], [x, round(y + 0.15 * height, 4), z]
    sides = [[points, (i + 1) % points, i] for i in range(points)] + [[points + 1, i, (i + 1) % points] for i in range(points)]
    return faces(name, material, [*rim, tip, foot], sides)


def _tree(
    name: str, x: float, z: float, size: float, bulbs: list[str], balls: list[str], random: np.random.Generator
) -> list[Shape]:
    ground = _height(x, z)
    trunk = {
        "name": f"{name}: trunk",
        "type": "lathe",
        "material": "bark",
        "segments": 16,
        "profile": [[0.13 * size, -0.2], [0.09 * size, 0.8 * size]],
        "transform": [{"translate": [x, round(ground, 4), z]}],
    }
    shapes: list[Shape] = [trunk]
    tiers = 5
    for i in range(tiers):
        radius = size * (0.95 - 0.16 * i)
        shapes.append(_cone(f"{name}: tier {i}", "needles", x, ground + size * (0.35 + 0.42 * i), z, radius, size * 0.8))
    for i in range(46):
        level = random.uniform(0, tiers - 0.4)
        radius = size * (0.95 - 0.16 * level) * random.uniform(0.78, 0.98)
        angle = random.uniform(0, 2 * math.pi)
        place = (x + radius * math.cos(angle), ground + size * (0.34 + 0.42 * level), z + radius * math.sin(angle))
        if i % 3:
            shapes.append(sphere(f"{name}: bulb {i}", bulbs[i % len(bulbs)], place, round(0.022 * size, 4)))
        else:
            shapes.append(sphere(f"{name}: ball {i}", balls[i % len(balls)], place, round(0.06 * size, 4)))
    shapes.append(
        sphere(f"{name}: star", "lamp yellow", (x, ground + size * (0.35 + 0.42 * (tiers - 1) + 0.86), z), round(0.07 * size, 4))
    )
    return shapes


def _house(x: float, z: float) -> list[Shape]:
    y = _height(x, z) - 0.1

    def box(name: str, material: str, center: tuple[float, ...], half: tuple[float, ...]) -> Shape:
        transform = [{"scale": list(half)}, {"translate": [round(c, 4) for c in center]}]
        return {"name": name, "type": "cube", "material": material, "transform": transform}

    w, h, d = 1.3, 0.8, 1.0
    gable = [
        [x - w * 1.15, y + 2 * h, z + d * 1.15],
        [x + w * 1.15, y + 2 * h, z + d * 1.15],
        [x, y + 2 * h + 1.1, z + d * 1.15],
        [x - w * 1.15, y + 2 * h, z - d * 1.15],
        [x + w * 1.15, y + 2 * h, z - d * 1.15],
        [x, y + 2 * h + 1.1, z - d * 1.15],
    ]
    roof = [[round(c, 4) for c in p] for p in gable]
    snow = [[px, round(py + 0.07, 4), pz] for px, py, pz in roof]
    return [
        box("house", "plaster", (x, y + h, z), (w, h, d)),
        faces("roof", "roof", roof, [[0, 1, 2], [4, 3, 5], [1, 4, 5, 2], [3, 0, 2, 5], [0, 3, 4, 1]]),
        faces("snow on the roof", "snow", snow, [[1, 4, 5, 2], [3, 0, 2, 5]]),
        box("door", "door", (x - 0.5, y + 0.55, z + d), (0.22, 0.45, 0.02)),
        box("left window", "window", (x + 0.2, y + 0.95, z + d), (0.2, 0.22, 0.015)),
        box("right window", "window", (x + 0.85, y + 0.95, z + d), (0.2, 0.22, 0.015)),
    ]


def _snowman(x: float, z: float) -> list[Shape]:
    y = _height(x, z)
    shapes = [
        sphere("snowman: foot", "snow", (x, y + 0.38, z), 0.45),
        sphere("snowman: middle", "snow", (x, y + 0.98, z), 0.32),
        sphere("snowman: head", "snow", (x, y + 1.42, z), 0.21),
    ]
    for side in (-1, 1):
        shapes.append(sphere(f"snowman: eye {side}", "coal", (x + side * 0.075, y + 1.48, z + 0.188), 0.026))
    for i in range(3):
        shapes.append(sphere(f"snowman: button {i}", "coal", (x, y + 0.84 + 0.13 * i, z + (0.30, 0.323, 0.302)[i]), 0.026))
    nose = {
        "name": "snowman: nose",
        "type": "lathe",
        "material": "carrot",
        "segments": 16,
        "profile": [[0, 0], [0.035, 0], [0.0, 0.24]],
        "transform": [{"rotate": {"axis": "x", "degrees": 95}}, {"translate": [x, round(y + 1.42, 4), z + 0.19]}],
    }
    brim = {
        "name": "snowman: hat",
        "type": "lathe",
        "material": "coal",
        "segments": 32,
        "profile": [[0, 0], [0.25, 0], [0.25, 0.025], [0.155, 0.03], [0.15, 0.28], [0, 0.28]],
        "transform": [{"rotate": {"axis": "z", "degrees": -7}}, {"translate": [x + 0.01, round(y + 1.57, 4), z]}],
    }
    return [*shapes, nose, brim]
