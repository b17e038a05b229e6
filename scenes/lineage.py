"""Writes the scenes of docs/lineage.md: those of the small path tracers that this one descends from.

    python scenes/lineage.py

The numbers of smallpt.yaml are K. Beason's (kevinbeason.com/smallpt); those of games101-7.yaml are the measured Cornell box
(Cornell University Program of Computer Graphics) with the light and the colours of the course's assignment; those of
rest-of-your-life.yaml are the book's (P. Shirley, T. D. Black, S. Hollasch, "Ray Tracing: The Rest of Your Life").
The course project's scene and the Christmas scene are this project's own, after what their authors describe.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from scene_text import text_of

HERE = Path(__file__).parent

Scene = dict[str, Any]
Shape = dict[str, Any]


def _sphere(name: str, material: str, center: tuple[float, ...], radius: float, **more: Any) -> Shape:
    return {
        "name": name,
        "type": "sphere",
        "material": material,
        "center": [round(c, 4) for c in center],
        "radius": radius,
        **more,
    }


def _faces(name: str, material: str, positions: list[list[float]], faces: list[list[int]], **more: Any) -> Shape:
    return {"name": name, "type": "faces", "material": material, "positions": positions, "faces": faces, **more}


def smallpt() -> Scene:
    """The box of nine spheres, its walls among them."""
    far = 1e5
    return {
        "name": "smallpt",
        "settings": {"width": 512, "height": 384, "spp": 256, "max_depth": 32, "filter": "tent"},
        "cameras": [
            {
                "name": "front",
                "eye": [50, 52, 295.6],
                "target": [50, 52 - 0.042612, 294.6],
                "fov": round(math.degrees(2 * math.atan(0.5135 / 2)), 5),
                "near": 140,
            }
        ],
        "materials": {
            "red": {"color": [0.75, 0.25, 0.25]},
            "blue": {"color": [0.25, 0.25, 0.75]},
            "gray": {"color": 0.75},
            "black": {"color": 0},
            "mirror": {"kind": "mirror", "color": 0.999},
            "glass": {"kind": "glass", "color": 0.999, "ior": 1.5},
            "lamp": {"color": 0, "emission": 12},
        },
        "shapes": [
            _sphere("left wall", "red", (far + 1, 40.8, 81.6), far),
            _sphere("right wall", "blue", (-far + 99, 40.8, 81.6), far),
            _sphere("back wall", "gray", (50, 40.8, far), far),
            _sphere("front wall", "black", (50, 40.8, -far + 170), far),
            _sphere("floor", "gray", (50, far, 81.6), far),
            _sphere("ceiling", "gray", (50, -far + 81.6, 81.6), far),
            _sphere("mirror ball", "mirror", (27, 16.5, 47), 16.5),
            _sphere("glass ball", "glass", (73, 16.5, 78), 16.5),
            _sphere("lamp", "lamp", (50, 681.6 - 0.27, 81.6), 600.0),
        ],
    }


def course_project() -> Scene:
    """Balls of Blinn-Phong, mirror and glass in a corner, lit by two small lights and a sun: for Whitted and path tracing."""
    far = 1e5
    shiny = [("matte", 0.75, 0.0, 1), ("satin", 0.6, 0.25, 12), ("polished", 0.5, 0.4, 80), ("lacquer", 0.35, 0.55, 600)]
    colors = [[0.85, 0.35, 0.25], [0.3, 0.65, 0.35], [0.3, 0.4, 0.85], [0.85, 0.7, 0.25]]
    materials: dict[str, Any] = {
        "red": {"color": [0.75, 0.25, 0.25]},
        "blue": {"color": [0.25, 0.25, 0.75]},
        "gray": {"color": 0.75},
        "mirror": {"kind": "mirror", "color": 0.95},
        "glass": {"kind": "glass", "ior": 1.5},
    }
    shapes = [
        _sphere("left wall", "red", (far + 1, 40.8, 81.6), far),
        _sphere("right wall", "blue", (-far + 99, 40.8, 81.6), far),
        _sphere("back wall", "gray", (50, 40.8, far), far),
        _sphere("floor", "gray", (50, far, 81.6), far),
    ]
    for i, ((name, kd, ks, shininess), color) in enumerate(zip(shiny, colors, strict=True)):
        materials[name] = {
            "kind": "blinn_phong",
            "color": [round(kd * c, 4) for c in color],
            "specular_color": ks,
            "shininess": shininess,
        }
        shapes.append(_sphere(name, name, (17 + 22 * i, 9, 112 - 5 * (i % 2)), 9.0))
    shapes += [
        _sphere("mirror ball", "mirror", (29, 16.5, 50), 16.5),
        _sphere("glass ball", "glass", (71, 16.5, 72), 16.5),
    ]
    return {
        "name": "Course project",
        "settings": {"width": 512, "height": 384, "spp": 70, "max_depth": 12, "light_samples": 4, "ambient": [0.03, 0.03, 0.03]},
        "cameras": [
            {
                "name": "front",
                "eye": [50, 52, 295.6],
                "target": [50, 52 - 0.07, 294.6],
                "fov": 28.8,
            }
        ],
        "lights": [
            {"name": "warm", "type": "point", "position": [22, 66, 100], "intensity": [2600, 2200, 1700], "radius": 3},
            {"name": "cool", "type": "point", "position": [80, 58, 128], "intensity": [900, 1100, 1500], "radius": 1.5},
            {"name": "sun", "type": "directional", "direction": [0.25, -1, -0.6], "intensity": 0.35, "angle": 0.5},
        ],
        "materials": materials,
        "shapes": shapes,
    }


def games101() -> Scene:
    """The measured Cornell box as the course's seventh assignment has it."""

    def block(name: str, top: list[list[float]]) -> Shape:
        height = top[0][1]
        foot = [[x, 0, z] for x, _, z in top]
        sides = [[i, i + 4, (i + 1) % 4 + 4, (i + 1) % 4] for i in range(4)]
        assert all(y == height for _, y, _ in top)
        return _faces(name, "white", top + foot, [[0, 1, 2, 3], *sides])

    light = (
        8.0 * np.array([0.747 + 0.058, 0.747 + 0.258, 0.747])
        + 15.6 * np.array([0.740 + 0.287, 0.740 + 0.160, 0.740])
        + 18.4 * np.array([0.737 + 0.642, 0.737 + 0.159, 0.737])
    )
    square = [[0, 1, 2, 3]]
    return {
        "name": "Cornell box (GAMES101, 7)",
        "settings": {"width": 784, "height": 784, "spp": 200, "max_depth": 64, "roulette": 0.8, "filter": "box"},
        "cameras": [{"name": "front", "eye": [278, 273, -800], "target": [278, 273, 0], "fov": 40}],
        "materials": {
            "white": {"color": [0.725, 0.71, 0.68]},
            "red": {"color": [0.63, 0.065, 0.05]},
            "green": {"color": [0.14, 0.45, 0.091]},
            "light": {"color": 0.65, "emission": [round(float(c), 4) for c in light]},
        },
        "shapes": [
            _faces("floor", "white", [[552.8, 0, 0], [0, 0, 0], [0, 0, 559.2], [549.6, 0, 559.2]], square),
            _faces("ceiling", "white", [[556, 548.8, 0], [556, 548.8, 559.2], [0, 548.8, 559.2], [0, 548.8, 0]], square),
            _faces("back wall", "white", [[549.6, 0, 559.2], [0, 0, 559.2], [0, 548.8, 559.2], [556, 548.8, 559.2]], square),
            _faces("right wall", "green", [[0, 0, 559.2], [0, 0, 0], [0, 548.8, 0], [0, 548.8, 559.2]], square),
            _faces("left wall", "red", [[552.8, 0, 0], [549.6, 0, 559.2], [556, 548.8, 559.2], [556, 548.8, 0]], square),
            _faces("lamp", "light", [[343, 548.7, 227], [343, 548.7, 332], [213, 548.7, 332], [213, 548.7, 227]], square),
            block("short block", [[130, 165, 65], [82, 165, 225], [240, 165, 272], [290, 165, 114]]),
            block("tall block", [[423, 330, 247], [265, 330, 296], [314, 330, 456], [472, 330, 406]]),
        ],
    }


def rest_of_your_life() -> Scene:
    """The book's last Cornell box: a glass ball, and a tall block that is a mirror."""

    def turned(name: str, material: str, size: tuple[float, ...], degrees: float, at: tuple[float, ...]) -> Shape:
        half = [s / 2 for s in size]
        transform = [
            {"scale": half},
            {"translate": half},
            {"rotate": {"axis": "y", "degrees": degrees}},
            {"translate": list(at)},
        ]
        return {"name": name, "type": "cube", "material": material, "transform": transform}

    square = [[0, 1, 2, 3]]
    return {
        "name": "The Rest of Your Life",
        "settings": {"width": 600, "height": 600, "spp": 1000, "max_depth": 50, "sampling": "mixture", "filter": "box"},
        "cameras": [{"name": "front", "eye": [278, 278, -800], "target": [278, 278, 0], "fov": 40}],
        "materials": {
            "red": {"color": [0.65, 0.05, 0.05]},
            "white": {"color": 0.73},
            "green": {"color": [0.12, 0.45, 0.15]},
            "lamp": {"color": 0, "emission": 15},
            "aluminum": {"kind": "mirror", "color": [0.8, 0.85, 0.88]},
            "glass": {"kind": "glass", "ior": 1.5},
        },
        "shapes": [
            _faces("left wall", "green", [[555, 0, 0], [555, 555, 0], [555, 555, 555], [555, 0, 555]], square),
            _faces("right wall", "red", [[0, 0, 0], [0, 0, 555], [0, 555, 555], [0, 555, 0]], square),
            _faces("lamp", "lamp", [[213, 554, 227], [343, 554, 227], [343, 554, 332], [213, 554, 332]], square),
            _faces("floor", "white", [[0, 0, 0], [555, 0, 0], [555, 0, 555], [0, 0, 555]], square),
            _faces("ceiling", "white", [[0, 555, 0], [0, 555, 555], [555, 555, 555], [555, 555, 0]], square),
            _faces("back wall", "white", [[0, 0, 555], [555, 0, 555], [555, 555, 555], [0, 555, 555]], square),
            turned("mirror block", "aluminum", (165, 330, 165), 15, (265, 0, 295)),
            _sphere("glass ball", "glass", (190, 90, 190), 90.0, guide=True),
        ],
    }


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
        shapes.append(_sphere(f"flake {i}", str(kind), (x, y, z), round(float(random.uniform(0.012, 0.032)), 4)))
    shapes.append(_sphere("moon behind the camera", "moon", (-7.5, 9, 14), 3.0))
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
    faces = []
    for j in range(count):
        for i in range(count):
            a = j * (count + 1) + i
            faces.append([a, a + count + 1, a + count + 2, a + 1])
    return _faces("snow", "snow", positions, faces, smooth=True)


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
    faces = [[points, (i + 1) % points, i] for i in range(points)] + [[points + 1, i, (i + 1) % points] for i in range(points)]
    return _faces(name, material, [*rim, tip, foot], faces)


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
            shapes.append(_sphere(f"{name}: bulb {i}", bulbs[i % len(bulbs)], place, round(0.022 * size, 4)))
        else:
            shapes.append(_sphere(f"{name}: ball {i}", balls[i % len(balls)], place, round(0.06 * size, 4)))
    shapes.append(
        _sphere(f"{name}: star", "lamp yellow", (x, ground + size * (0.35 + 0.42 * (tiers - 1) + 0.86), z), round(0.07 * size, 4))
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
        _faces("roof", "roof", roof, [[0, 1, 2], [4, 3, 5], [1, 4, 5, 2], [3, 0, 2, 5], [0, 3, 4, 1]]),
        _faces("snow on the roof", "snow", snow, [[1, 4, 5, 2], [3, 0, 2, 5]]),
        box("door", "door", (x - 0.5, y + 0.55, z + d), (0.22, 0.45, 0.02)),
        box("left window", "window", (x + 0.2, y + 0.95, z + d), (0.2, 0.22, 0.015)),
        box("right window", "window", (x + 0.85, y + 0.95, z + d), (0.2, 0.22, 0.015)),
    ]


def _snowman(x: float, z: float) -> list[Shape]:
    y = _height(x, z)
    shapes = [
        _sphere("snowman: foot", "snow", (x, y + 0.38, z), 0.45),
        _sphere("snowman: middle", "snow", (x, y + 0.98, z), 0.32),
        _sphere("snowman: head", "snow", (x, y + 1.42, z), 0.21),
    ]
    for side in (-1, 1):
        shapes.append(_sphere(f"snowman: eye {side}", "coal", (x + side * 0.075, y + 1.48, z + 0.188), 0.026))
    for i in range(3):
        shapes.append(_sphere(f"snowman: button {i}", "coal", (x, y + 0.84 + 0.13 * i, z + (0.30, 0.323, 0.302)[i]), 0.026))
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


SCENES = (
    ("smallpt.yaml", smallpt, "The box of nine spheres of smallpt, 99 lines that taught many what a path is."),
    ("course-project.yaml", course_project, "Blinn-Phong, mirror and glass for Whitted ray tracing beside path tracing."),
    ("games101-7.yaml", games101, "The measured Cornell box as a course's assignment has it."),
    ("christmas.yaml", christmas, "Snow, trees and hundreds of small lights, under a moon behind the camera."),
    (
        "rest-of-your-life.yaml",
        rest_of_your_life,
        "A glass ball and a mirror block, with directions aimed at the light and the glass.",
    ),
)


def main() -> None:
    """Writes the files beside this script."""
    for name, make, comment in SCENES:
        (HERE / name).write_text(text_of(make(), comment, Path(__file__).name))


if __name__ == "__main__":
    main()
