"""Writes the scenes of docs/lineage.md: those of the small path tracers that preceded this one.

    python scenes/lineage.py

The numbers of smallpt.yaml are K. Beason's (kevinbeason.com/smallpt); those of games101-7.yaml are the measured Cornell box
(Cornell University Program of Computer Graphics) with the light and the colours of the course's assignment; those of
rest-of-your-life.yaml are the book's (P. Shirley, T. D. Black, S. Hollasch, "Ray Tracing: The Rest of Your Life").
The course project's scene is this project's own, after its authors' description. The group's is written by christmas.py.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from scene_text import Scene, Shape, faces, sphere, text_of

HERE = Path(__file__).parent


def smallpt() -> Scene:
    """Returns smallpt's scene: nine spheres, some of which are so large that they form the walls of a box."""
    far = 1e5
    return {
        "name": "smallpt",
        "settings": {"width": 512, "height": 384, "spp": 64, "max_depth": 32, "filter": "tent"},
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
            sphere("left wall", "red", (far + 1, 40.8, 81.6), far),
            sphere("right wall", "blue", (-far + 99, 40.8, 81.6), far),
            sphere("back wall", "gray", (50, 40.8, far), far),
            sphere("front wall", "black", (50, 40.8, -far + 170), far),
            sphere("floor", "gray", (50, far, 81.6), far),
            sphere("ceiling", "gray", (50, -far + 81.6, 81.6), far),
            sphere("mirror ball", "mirror", (27, 16.5, 47), 16.5),
            sphere("glass ball", "glass", (73, 16.5, 78), 16.5),
            sphere("lamp", "lamp", (50, 681.6 - 0.27, 81.6), 600.0),
        ],
    }


def course_project() -> Scene:
    """Returns Blinn-Phong, mirror and glass balls in a corner, lit by two small lights and a sun."""
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
        sphere("left wall", "red", (far + 1, 40.8, 81.6), far),
        sphere("right wall", "blue", (-far + 99, 40.8, 81.6), far),
        sphere("back wall", "gray", (50, 40.8, far), far),
        sphere("floor", "gray", (50, far, 81.6), far),
    ]
    for i, ((name, kd, ks, shininess), color) in enumerate(zip(shiny, colors, strict=True)):
        materials[name] = {
            "kind": "blinn_phong",
            "color": [round(kd * c, 4) for c in color],
            "specular_color": ks,
            "shininess": shininess,
        }
        shapes.append(sphere(name, name, (17 + 22 * i, 9, 112 - 5 * (i % 2)), 9.0))
    shapes += [
        sphere("mirror ball", "mirror", (29, 16.5, 50), 16.5),
        sphere("glass ball", "glass", (71, 16.5, 72), 16.5),
    ]
    return {
        "name": "Course project",
        "settings": {
            "width": 512,
            "height": 384,
            "spp": 70,
            "max_depth": 12,
            "roulette_floor": 0.15,
            "light_samples": 4,
            "ambient": [0.03, 0.03, 0.03],
        },
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
    """Returns the measured Cornell box of the course's seventh assignment."""

    def block(name: str, top: list[list[float]]) -> Shape:
        height = top[0][1]
        foot = [[x, 0, z] for x, _, z in top]
        sides = [[i, i + 4, (i + 1) % 4 + 4, (i + 1) % 4] for i in range(4)]
        assert all(y == height for _, y, _ in top)
        return faces(name, "white", top + foot, [[0, 1, 2, 3], *sides])

    light = (
        8.0 * np.array([0.747 + 0.058, 0.747 + 0.258, 0.747])
        + 15.6 * np.array([0.740 + 0.287, 0.740 + 0.160, 0.740])
        + 18.4 * np.array([0.737 + 0.642, 0.737 + 0.159, 0.737])
    )
    square = [[0, 1, 2, 3]]
    return {
        "name": "Cornell box (GAMES101, 7)",
        "settings": {"width": 784, "height": 784, "spp": 32, "max_depth": 64, "roulette": 0.8, "filter": "box"},
        "cameras": [{"name": "front", "eye": [278, 273, -800], "target": [278, 273, 0], "fov": 40}],
        "materials": {
            "white": {"color": [0.725, 0.71, 0.68]},
            "red": {"color": [0.63, 0.065, 0.05]},
            "green": {"color": [0.14, 0.45, 0.091]},
            "light": {"color": 0.65, "emission": [round(float(c), 4) for c in light]},
        },
        "shapes": [
            faces("floor", "white", [[552.8, 0, 0], [0, 0, 0], [0, 0, 559.2], [549.6, 0, 559.2]], square),
            faces("ceiling", "white", [[556, 548.8, 0], [556, 548.8, 559.2], [0, 548.8, 559.2], [0, 548.8, 0]], square),
            faces("back wall", "white", [[549.6, 0, 559.2], [0, 0, 559.2], [0, 548.8, 559.2], [556, 548.8, 559.2]], square),
            faces("right wall", "green", [[0, 0, 559.2], [0, 0, 0], [0, 548.8, 0], [0, 548.8, 559.2]], square),
            faces("left wall", "red", [[552.8, 0, 0], [549.6, 0, 559.2], [556, 548.8, 559.2], [556, 548.8, 0]], square),
            faces("lamp", "light", [[343, 548.7, 227], [343, 548.7, 332], [213, 548.7, 332], [213, 548.7, 227]], square),
            block("short block", [[130, 165, 65], [82, 165, 225], [240, 165, 272], [290, 165, 114]]),
            block("tall block", [[423, 330, 247], [265, 330, 296], [314, 330, 456], [472, 330, 406]]),
        ],
    }


def rest_of_your_life() -> Scene:
    """Returns the book's last Cornell box: a glass ball, and a tall mirror block."""

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
        "settings": {"width": 600, "height": 600, "spp": 64, "max_depth": 50, "sampling": "mixture", "filter": "box"},
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
            faces("left wall", "green", [[555, 0, 0], [555, 555, 0], [555, 555, 555], [555, 0, 555]], square),
            faces("right wall", "red", [[0, 0, 0], [0, 0, 555], [0, 555, 555], [0, 555, 0]], square),
            faces("lamp", "lamp", [[213, 554, 227], [343, 554, 227], [343, 554, 332], [213, 554, 332]], square),
            faces("floor", "white", [[0, 0, 0], [555, 0, 0], [555, 0, 555], [0, 0, 555]], square),
            faces("ceiling", "white", [[0, 555, 0], [0, 555, 555], [555, 555, 555], [555, 555, 0]], square),
            faces("back wall", "white", [[0, 0, 555], [555, 0, 555], [555, 555, 555], [0, 555, 555]], square),
            turned("mirror block", "aluminum", (165, 330, 165), 15, (265, 0, 295)),
            sphere("glass ball", "glass", (190, 90, 190), 90.0, guide=True),
        ],
    }


SCENES = (
    ("smallpt.yaml", smallpt, "The box with nine spheres of smallpt, a path tracer in 99 lines."),
    ("course-project.yaml", course_project, "Blinn-Phong, mirror and glass for Whitted ray tracing beside path tracing."),
    ("games101-7.yaml", games101, "The measured Cornell box, as used in course assignments."),
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
