"""Writes the modelled example scenes spheres.yaml and still-life.yaml.

    python scenes/make.py

Shapes are spheres, quads and surfaces of revolution with outlines of a few points, rounded by Catmull-Rom splines; the colours
of metals are the linear Rec.709 reflectances at normal incidence from S. Lagarde, "Memo on Fresnel equations", 2013.
Everything else is this project's own.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scene_text import sphere, text_of

HERE = Path(__file__).parent

GOLD = [1.0, 0.766, 0.336]
COPPER = [0.955, 0.638, 0.538]
SILVER = [0.972, 0.960, 0.915]

Outline = list[tuple[float, float]]


def rounded(outline: Outline, steps: int = 6) -> list[list[float]]:
    """Returns a smooth profile through the points of an outline: centripetal Catmull-Rom, `steps` segments between two points.

    A point given twice is a corner.
    """
    points = np.array(outline, float)
    corners = [0, *[i for i in range(1, len(points)) if (points[i] == points[i - 1]).all()], len(points)]
    found: list[list[float]] = []
    for first, last in pairwise(corners):
        part = points[first:last]
        if len(part) < 2:
            continue
        ends = np.vstack([2 * part[0] - part[1], part, 2 * part[-1] - part[-2]])
        for p0, p1, p2, p3 in zip(ends, ends[1:], ends[2:], ends[3:], strict=False):
            t = np.r_[0, np.cumsum(np.linalg.norm(np.diff([p0, p1, p2, p3], axis=0), axis=1) ** 0.5)]
            for s in np.linspace(t[1], t[2], steps, endpoint=False):
                found.append(_catmull_rom([p0, p1, p2, p3], t, s))
        found.append(part[-1].tolist())
    return [[max(round(r, 4), 0.0), round(y, 4)] for r, y in found]


def _catmull_rom(points: list[np.ndarray], t: np.ndarray, at: float) -> list[float]:
    # Barry and Goldman 1988: three rounds of linear interpolation over increasing knot spans.
    def mixed(a: np.ndarray, b: np.ndarray, start: float, end: float) -> np.ndarray:
        return ((end - at) * a + (at - start) * b) / (end - start)

    first = [mixed(points[i], points[i + 1], t[i], t[i + 1]) for i in range(3)]
    second = [mixed(first[i], first[i + 1], t[i], t[i + 2]) for i in range(2)]
    found: list[float] = mixed(second[0], second[1], t[1], t[2]).tolist()
    return found


def lathe(name: str, material: str, outline: Outline, at: tuple[float, float, float], **more: Any) -> dict[str, Any]:
    """Returns a surface of revolution at a position."""
    transform = [*more.pop("turned", []), {"translate": list(at)}]
    return {"name": name, "type": "lathe", "material": material, "profile": rounded(outline), "transform": transform, **more}


def softbox(
    name: str, material: str, at: tuple[float, float, float], size: tuple[float, float], tilt: float, turn: float
) -> dict[str, Any]:
    """Returns a rectangular light. At tilt 90 (degrees) it points straight down."""
    transform = [
        {"scale": [*size, 1]},
        {"rotate": {"axis": "x", "degrees": tilt}},
        {"rotate": {"axis": "y", "degrees": turn}},
        {"translate": list(at)},
    ]
    return {"name": name, "type": "quad", "material": material, "transform": transform}


def metal(color: list[float], roughness: float) -> dict[str, Any]:
    """Returns a metal."""
    return {"kind": "metallic_roughness", "color": color, "metallic": 1, "roughness": roughness}


def glazed(color: str, roughness: float) -> dict[str, Any]:
    """Returns a material under a clear coat, for coloured ceramic, wax or skin."""
    return {"kind": "metallic_roughness", "color": color, "roughness": roughness}


def spheres() -> dict[str, Any]:
    """Returns a scene with one ball for each kind of material."""
    materials = {
        "floor": {"texture": "tiles"},
        "lamp": {"color": 0, "emission": [14, 12.5, 10]},
        "mirror": {"kind": "mirror", "color": 0.95},
        "glass": {"kind": "glass", "ior": 1.5},
        "gold": metal(GOLD, 0.12),
        "copper": metal(COPPER, 0.35),
        "chalk": {"color": "#d9d4c8"},
        "coral": glazed("#e0503a", 0.25),
        "teal": glazed("#15808a", 0.08),
        "plum": glazed("#5b2a6e", 0.5),
    }
    shapes: list[dict[str, Any]] = [
        {
            "name": "floor",
            "type": "quad",
            "material": "floor",
            "transform": [{"scale": 14}, {"rotate": {"axis": "x", "degrees": -90}}],
        },
        softbox("lamp", "lamp", (-3.5, 6.5, 3.5), (1.5, 1.5), 60, -45),
    ]
    for i, material in enumerate(["gold", "glass", "mirror"]):
        shapes.append(sphere(f"large {material}", material, (2.3 * (i - 1), 1.0, -0.2 - 0.35 * abs(i - 1)), 1.0))
    for i, material in enumerate(["chalk", "coral", "copper", "teal", "plum"]):
        shapes.append(sphere(f"small {material}", material, (1.25 * (i - 2), 0.42, 1.75 - 0.18 * (i - 2) ** 2), 0.42))
    return {
        "name": "Spheres",
        "settings": {"width": 960, "height": 540, "spp": 32, "max_depth": 12},
        "cameras": [{"name": "front", "eye": [0.6, 2.6, 8.2], "target": [0, 0.72, 0.3], "fov": 27}],
        "environment": {"color": [0.42, 0.52, 0.68], "strength": 0.9},
        "textures": {"tiles": {"checker": {"colors": ["#c9c4ba", "#4c5560"], "squares": 28}}},
        "materials": materials,
        "shapes": shapes,
    }


def still_life() -> dict[str, Any]:
    """Returns a still life: vessels and fruit on a checkered cloth, lit by a window on the left."""
    materials = {
        "wall": {"color": "#b9a58e"},
        "table": glazed("#6b4429", 0.35),
        "cloth": {"texture": "weave"},
        "window": {"color": 0, "emission": [9.4, 7.3, 5.1]},
        "bounce": {"color": 0, "emission": [0.5, 0.64, 0.9]},
        "celadon": glazed("#2f7f79", 0.12),
        "porcelain": glazed("#ece6da", 0.18),
        "glass": {"kind": "glass", "ior": 1.5},
        "copper": metal(COPPER, 0.3),
        "brass": metal(GOLD, 0.3),
        "silver": metal(SILVER, 0.08),
        "orange": glazed("#e8760f", 0.45),
        "lemon": glazed("#f0c419", 0.4),
        "apple": glazed("#a3161c", 0.2),
        "plum": glazed("#3a1a40", 0.35),
        "stalk": {"color": "#3b2a18"},
    }
    vase: Outline = [
        (0, 0),
        (0.36, 0),
        (0.36, 0),
        (0.40, 0.03),
        (0.62, 0.45),
        (0.66, 0.85),
        (0.46, 1.35),
        (0.24, 1.72),
        (0.22, 1.95),
        (0.33, 2.12),
    ]
    vase += [(0.33, 2.12), (0.30, 2.12), (0.19, 1.95), (0.21, 1.7), (0.42, 1.33), (0.6, 0.85), (0.5, 0.3), (0, 0.1)]
    bowl: Outline = [
        (0, 0),
        (0.3, 0),
        (0.3, 0),
        (0.3, 0.07),
        (0.55, 0.16),
        (0.8, 0.36),
        (0.92, 0.6),
        (0.92, 0.6),
        (0.89, 0.61),
        (0.76, 0.38),
        (0.5, 0.2),
        (0, 0.13),
    ]
    goblet: Outline = [
        (0, 0),
        (0.33, 0),
        (0.34, 0.02),
        (0.2, 0.05),
        (0.05, 0.12),
        (0.04, 0.4),
        (0.06, 0.58),
        (0.22, 0.68),
        (0.36, 0.9),
        (0.37, 1.15),
        (0.31, 1.42),
    ]
    goblet += [(0.31, 1.42), (0.295, 1.42), (0.35, 1.15), (0.34, 0.92), (0.2, 0.72), (0, 0.68)]
    jug: Outline = [(0, 0), (0.3, 0), (0.3, 0), (0.33, 0.05), (0.4, 0.3), (0.36, 0.58), (0.22, 0.8), (0.21, 0.95), (0.3, 1.08)]
    jug += [(0.3, 1.08), (0.28, 1.08), (0.19, 0.95), (0.2, 0.8), (0.33, 0.58), (0.36, 0.3), (0, 0.06)]
    lemon: Outline = [(0, -0.34), (0.045, -0.31), (0.16, -0.22), (0.225, 0), (0.16, 0.22), (0.05, 0.31), (0, 0.35)]
    apple: Outline = [
        (0, 0.05),
        (0.06, 0.02),
        (0.15, 0.0),
        (0.27, 0.14),
        (0.31, 0.33),
        (0.26, 0.5),
        (0.14, 0.56),
        (0.05, 0.51),
        (0, 0.46),
    ]
    stalk: Outline = [(0.02, 0), (0.014, 0.12), (0.022, 0.19), (0, 0.2)]

    def lying(angle: float) -> list[dict[str, Any]]:
        return [{"rotate": {"axis": "z", "degrees": 82}}, {"rotate": {"axis": "y", "degrees": angle}}]

    room: Outline = [(7.5, -2.2), (7.5, 6.5)]
    shapes = [
        {"name": "wall", "type": "lathe", "material": "wall", "profile": [list(p) for p in room], "segments": 128},
        {
            "name": "table",
            "type": "cube",
            "material": "table",
            "transform": [{"scale": [4.2, 0.12, 2.3]}, {"translate": [0, -0.13, -0.1]}],
        },
        {
            "name": "cloth",
            "type": "quad",
            "material": "cloth",
            "transform": [
                {"scale": [1.75, 1.75, 1]},
                {"rotate": {"axis": "x", "degrees": -90}},
                {"rotate": {"axis": "y", "degrees": 28}},
                {"translate": [0.15, 0, 0.25]},
            ],
        },
        softbox("window", "window", (-4.6, 3.4, 2.6), (2.1, 2.4), 22, 118),
        softbox("bounce", "bounce", (5.2, 2.6, 2.4), (2.3, 2.3), 15, -115),
        lathe("vase", "celadon", vase, (-1.0, 0, -0.75), segments=128),
        lathe("bowl", "copper", bowl, (0.62, 0, -0.2), segments=128),
        lathe("goblet", "glass", goblet, (-0.42, 0, 0.62), segments=128),
        lathe("jug", "porcelain", jug, (1.85, 0, -0.75), segments=96),
        sphere("orange a", "orange", (0.42, 0.52, -0.08), 0.3),
        sphere("orange b", "orange", (0.9, 0.5, -0.42), 0.29),
        lathe("apple", "apple", apple, (0.88, 0.33, 0.08), turned=[{"rotate": {"axis": "z", "degrees": -14}}]),
        lathe("stalk", "stalk", stalk, (0.995, 0.78, 0.08), turned=[{"rotate": {"axis": "z", "degrees": -20}}], segments=24),
        lathe("lemon a", "lemon", lemon, (1.42, 0.225, 0.62), turned=lying(35)),
        lathe("lemon b", "lemon", lemon, (0.5, 0.86, -0.38), turned=lying(-50)),
        sphere("silver ball", "silver", (0.42, 0.26, 1.02), 0.26),
        sphere("plum a", "plum", (-1.42, 0.19, 0.42), 0.19),
        sphere("plum b", "plum", (-1.08, 0.18, 0.72), 0.18),
        sphere("brass ball", "brass", (-1.75, 0.15, 0.82), 0.15),
    ]
    return {
        "name": "Still life",
        "settings": {"width": 960, "height": 600, "spp": 32, "max_depth": 16},
        "cameras": [
            {"name": "front", "eye": [0.35, 2.0, 6.4], "target": [0.12, 0.9, 0], "fov": 27.5},
            {"name": "close", "eye": [-0.9, 0.85, 3.4], "target": [-0.3, 0.62, 0.4], "fov": 30},
        ],
        "environment": {"color": [0.10, 0.12, 0.16]},
        "textures": {"weave": {"checker": {"colors": ["#e9dfcd", "#9c3b35"], "squares": 14}}},
        "materials": materials,
        "shapes": shapes,
    }


SCENES = (
    ("spheres.yaml", spheres, "One ball of every kind of surface, under a lamp and a soft sky."),
    ("still-life.yaml", still_life, "Vessels and fruit on a chequered cloth, by the light of a window."),
)


def main() -> None:
    """Writes the files beside this script."""
    for name, make, comment in SCENES:
        (HERE / name).write_text(text_of(make(), comment, Path(__file__).name))


if __name__ == "__main__":
    main()
