"""Scenes in which light is hard to find, described once for all renderers. Imports NumPy only, like shapes.py.

`path guiding` scenes are rooms that light enters through a narrow opening; in `caustics` scenes it passes through smooth glass or
water. The geometry is this project's own.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from tests.benchmarks.hard.shapes import (
    Point,
    Shape,
    ball,
    box,
    joined,
    moved,
    rectangle,
    revolved,
    turned,
    wall_with_holes,
    waves,
)

__all__ = ["DEPTH", "SCENES", "SIZE", "HardScene", "Kind", "Part", "Sun", "Surface"]

DEPTH = 32  # most segments of a path
SIZE = 96  # width and height of a picture, pixels

Kind = Literal["path guiding", "caustics"]
Rgb = tuple[float, float, float]


@dataclass(frozen=True)
class Surface:
    """A material. color: reflectance of `matte`, radiance of `light`, which emits from its front and reflects nothing.

    ior: of `glass`, which is smooth and absorbs nothing.
    """

    kind: Literal["matte", "glass", "light"]
    color: Rgb = (1.0, 1.0, 1.0)
    ior: float = 1.0


@dataclass(frozen=True)
class Part:
    """A mesh and the name of its surface. A part whose surface is a light is a rectangle."""

    name: str
    surface: str
    shape: Shape


@dataclass(frozen=True)
class Sun:
    """Parallel light. direction: in which it travels. irradiance: of a surface that faces it."""

    direction: Point
    irradiance: Rgb


@dataclass(frozen=True)
class HardScene:
    """A scene with its camera, whose up direction is y.

    fov: degrees, of the width and of the height. sky: radiance from all directions.
    """

    name: str
    title: str
    kind: Kind
    eye: Point
    target: Point
    fov: float
    surfaces: dict[str, Surface]
    parts: tuple[Part, ...]
    sky: Rgb | None = None
    sun: Sun | None = None

    def digest(self) -> str:
        """Returns a hash of everything that a picture depends on. Rounded, so that it does not depend on the NumPy version."""
        hashed = hashlib.sha256(repr((self.eye, self.target, self.fov, self.surfaces, self.sky, self.sun, DEPTH, SIZE)).encode())
        for part in self.parts:
            hashed.update(f"{part.name} {part.surface}".encode())
            for array in (part.shape.positions, part.shape.triangles, part.shape.normals):
                if array is not None:
                    hashed.update((np.round(array, 6) + 0.0).astype("<f4").tobytes())
        return hashed.hexdigest()[:16]


def _matte(*color: float) -> Surface:
    r, g, b = color
    return Surface("matte", (r, g, b))


def _light(*radiance: float) -> Surface:
    r, g, b = radiance
    return Surface("light", (r, g, b))


def _down(x: float, y: float, z: float, half_x: float, half_z: float) -> Shape:
    """Returns a horizontal lamp that faces down."""
    return rectangle((x, y, z), (half_x, 0, 0), (0, 0, half_z))


_GLASS = Surface("glass", ior=1.5)
_SMALL_LAMP = _light(3600, 3400, 3000)
_WHITE, _RED, _BLUE = _matte(0.72, 0.7, 0.66), _matte(0.6, 0.2, 0.15), _matte(0.2, 0.3, 0.6)
_SKY = (7.2, 9.6, 16.0)


def _things(low: Point, size: float, ball_at: tuple[float, float], radius: float) -> tuple[Part, ...]:
    """Returns a red box that is turned and a blue ball, both on the floor, which give a room shadows.

    low: the corner of the box before it is turned; size: of its sides. ball_at: x and z.
    """
    x, y, z = low
    cube = turned(box(low, (x + size, y + 0.8 * size, z + size)), 25, (x + size / 2, y, z + size / 2))
    center = (ball_at[0], y + radius, ball_at[1])
    return Part("box", "red", cube), Part("ball", "blue", ball(center, radius, 4))


def door() -> HardScene:
    """Returns a dark room whose lamp is in the next one, behind a door that is a hand's width open."""
    thick, half, high = 0.05, 0.45, 2.05
    wall = wall_with_holes((-2, -0.1, -thick), (2, 2.6, thick), [(-half, half, -0.1, high)], axis=2)
    leaf = turned(box((-half, 0, -thick), (half, high, thick)), 14, (-half, 0, 0))
    parts = (
        Part("hall", "white", box((-2, 0, -3), (2, 2.6, 4), inwards=True)),
        Part("wall", "white", wall),
        Part("leaf", "wood", leaf),
        *_things((-1.5, 0, 1.2), 0.7, (0.4, 1.6), 0.35),
        Part("lamp", "lamp", _down(0.7, 2.58, -1.5, 0.4, 0.3)),
    )
    surfaces = {"white": _WHITE, "red": _RED, "blue": _BLUE, "wood": _matte(0.5, 0.35, 0.2), "lamp": _light(1600, 1440, 1200)}
    return HardScene("door", "door ajar", "path guiding", (1.3, 1.5, 3.8), (-0.3, 0.95, 0), 55, surfaces, parts)


def window() -> HardScene:
    """Returns a room with one small window in a thick wall, under sky and sun."""
    thick = 0.3
    shell = joined(
        box((-2.8, -thick, -3.3), (2.8, 0, 3.3)),
        box((-2.8, 2.6, -3.3), (2.8, 2.6 + thick, 3.3)),
        box((-2.5, 0, -3.3), (2.8, 2.6, -3)),
        box((-2.5, 0, 3), (2.8, 2.6, 3.3)),
        box((2.5, 0, -3), (2.8, 2.6, 3)),
        wall_with_holes((-2.8, -thick, -3.3), (-2.5, 2.6 + thick, 3.3), [(1.2, 1.75, -0.3, 0.25)], axis=0),
    )
    parts = (Part("room", "white", shell), *_things((-1.8, 0, -2.2), 0.8, (0.3, -1.9), 0.45))
    surfaces = {"white": _WHITE, "red": _RED, "blue": _BLUE}
    sun = Sun((0.72, -0.55, -0.42), (120.0, 110.0, 90.0))
    eye, target = (1.2, 1.5, 2.8), (-1.0, 0.9, -1.0)
    return HardScene("window", "small window", "path guiding", eye, target, 60, surfaces, parts, _SKY, sun)


def hatch() -> HardScene:
    """Returns a cellar below a lit room, with a hatch in its ceiling."""
    ceiling = wall_with_holes((-1.6, 2.2, -2.1), (1.6, 2.35, 2.1), [(0.3, 0.85, -1.5, -0.95)], axis=1)
    parts = (
        Part("rooms", "white", box((-1.5, 0, -2), (1.5, 4.6, 2), inwards=True)),
        Part("ceiling", "wood", ceiling),
        *_things((-1.1, 0, -1.4), 0.6, (0.5, -0.6), 0.3),
        Part("lamp", "lamp", _down(-0.8, 4.57, 1.0, 0.3, 0.3)),
    )
    surfaces = {"white": _WHITE, "red": _RED, "blue": _BLUE, "wood": _matte(0.5, 0.4, 0.3), "lamp": _light(900, 850, 760)}
    eye, target = (-0.6, 1.5, 1.9), (0.1, 0.7, -1.0)
    return HardScene("hatch", "hatch in a ceiling", "path guiding", eye, target, 60, surfaces, parts)


def long_room() -> HardScene:
    """Returns a long room with three small windows to the sky in one of its long walls."""
    windows = [(x - 0.2, x + 0.2, 1.5, 1.95) for x in (-2.4, 0.1, 2.5)]
    shell = joined(
        box((-4.3, -0.3, -1.8), (4.3, 0, 1.8)),
        box((-4.3, 2.6, -1.8), (4.3, 2.9, 1.8)),
        box((-4.3, 0, -1.8), (-4, 2.6, 1.8)),
        box((4, 0, -1.8), (4.3, 2.6, 1.8)),
        box((-4, 0, 1.5), (4, 2.6, 1.8)),
        wall_with_holes((-4, 0, -1.8), (4, 2.6, -1.5), windows, axis=2),
    )
    parts = (Part("room", "white", shell), *_things((-1.6, 0, -0.9), 0.7, (1.1, 0.2), 0.4))
    surfaces = {"white": _WHITE, "red": _RED, "blue": _BLUE}
    eye, target = (3.6, 1.5, 1.1), (-0.6, 0.8, -0.4)
    return HardScene("long-room", "long room, three windows", "path guiding", eye, target, 55, surfaces, parts, _SKY)


def corridor() -> HardScene:
    """Returns a room that light from a lit chamber reaches through a corridor with two slits, which are not in line."""
    far = wall_with_holes((-2.1, -0.1, -2.4), (2.1, 2.6, -2.3), [(-0.8, -0.5, -0.1, 2.1)], axis=2)
    near = wall_with_holes((-2.1, -0.1, -1.2), (2.1, 2.6, -1.1), [(0.5, 0.8, -0.1, 2.1)], axis=2)
    parts = (
        Part("rooms", "white", box((-2, 0, -4), (2, 2.5, 2.6), inwards=True)),
        Part("far wall", "white", far),
        Part("near wall", "wood", near),
        *_things((-1.3, 0, -0.5), 0.6, (0.2, 0.6), 0.35),
        Part("lamp", "lamp", _down(-0.2, 2.47, -3.3, 0.5, 0.3)),
    )
    surfaces = {"white": _WHITE, "red": _RED, "blue": _BLUE, "wood": _matte(0.6, 0.5, 0.4), "lamp": _light(4000, 3600, 3000)}
    eye, target = (-0.9, 1.5, 2.4), (0.3, 0.8, -0.8)
    return HardScene("corridor", "behind a corridor, two slits", "path guiding", eye, target, 60, surfaces, parts)


def attic() -> HardScene:
    """Returns an attic under a roof with one skylight to sky and sun."""
    pitch = float(np.degrees(np.arctan2(1.6, 2.0)))
    length = float(np.hypot(1.6, 2.0))
    low, high = (-0.3, 0.0, -2.7), (length + 0.3, 0.2, 2.7)
    west = moved(turned(box(low, high), pitch, (0, 0, 0), "z"), (-2, 0.8, 0))
    holed = wall_with_holes(low, high, [(1.0, 1.5, -0.9, -0.4)], axis=1)
    east = moved(turned(holed, -pitch, (0, 0, 0), "z"), (0, 2.4, 0))
    shell = joined(
        west,
        east,
        box((-2.2, -0.2, -2.7), (2.2, 0, 2.7)),
        box((-2.2, 0, -2.7), (-2, 0.85, 2.7)),
        box((2, 0, -2.7), (2.2, 0.85, 2.7)),
        box((-2.2, 0, -2.7), (2.2, 2.8, -2.5)),
        box((-2.2, 0, 2.5), (2.2, 2.8, 2.7)),
    )
    parts = (Part("attic", "white", shell), *_things((-1.2, 0, -1.6), 0.6, (0.5, -0.9), 0.35))
    surfaces = {"white": _WHITE, "red": _RED, "blue": _BLUE}
    sun = Sun((-0.62, -0.72, -0.31), (60.0, 55.0, 46.0))
    eye, target = (0.3, 1.3, 2.3), (-0.2, 0.8, -1.2)
    return HardScene("attic", "attic under a skylight", "path guiding", eye, target, 60, surfaces, parts, (5.0, 6.5, 10.0), sun)


def glass_ball() -> HardScene:
    """Returns a glass ball under a small lamp, on a matt floor before a matt wall."""
    parts = (
        Part("floor", "floor", rectangle((0, 0, 0), (3, 0, 0), (0, 0, -3))),
        Part("wall", "wall", rectangle((0, 1.5, -1.6), (3, 0, 0), (0, 1.5, 0))),
        Part("ball", "glass", ball((-0.1, 0.62, 0), 0.5, 5)),
        Part("lamp", "lamp", _down(1.3, 3, 0.7, 0.05, 0.05)),
    )
    surfaces = {"floor": _matte(0.6, 0.58, 0.55), "wall": _matte(0.45, 0.5, 0.6), "glass": _GLASS, "lamp": _SMALL_LAMP}
    return HardScene("ball", "caustic of a glass ball", "caustics", (0, 2.1, 3.6), (0, 0.35, 0), 38, surfaces, parts)


def pool() -> HardScene:
    """Returns rippled water over a matt basin, under a small lamp."""
    basin = joined(
        rectangle((0, -1, 0), (1, 0, 0), (0, 0, -1)),
        rectangle((0, 0, -1), (1, 0, 0), (0, 1, 0)),
        rectangle((-1, 0, 0), (0, 0, -1), (0, 1, 0)),
        rectangle((1, 0, 0), (0, 0, 1), (0, 1, 0)),
        rectangle((0, -0.35, 1), (-1, 0, 0), (0, 0.65, 0)),
    )
    terms = [
        (7.0, 3.0, 0.3, 1.0),
        (-4.0, 8.5, 1.7, 0.8),
        (11.0, -6.0, 2.9, 0.45),
        (2.5, 13.0, 0.9, 0.35),
        (-13.0, -9.0, 4.1, 0.25),
    ]
    parts = (
        Part("basin", "basin", basin),
        Part("water", "water", waves(1.0, 160, 0.012, terms)),
        Part("lamp", "lamp", _down(0.4, 2.2, -0.2, 0.05, 0.05)),
    )
    surfaces = {"basin": _matte(0.5, 0.62, 0.68), "water": Surface("glass", ior=1.33), "lamp": _SMALL_LAMP}
    return HardScene("pool", "pool with rippled water", "caustics", (0, 1.7, 2.6), (0, -0.45, -0.1), 42, surfaces, parts)


def slab() -> HardScene:
    """Returns a corner of floor and two walls, lit by a small lamp through a slanted slab of glass."""
    pane = turned(turned(box((-1.5, 1.7, -1.5), (1.5, 1.78, 1.5)), 14, (0, 1.7, 0), "z"), 9, (0, 1.7, 0), "x")
    parts = (
        Part("floor", "floor", rectangle((0, 0, 0), (1.6, 0, 0), (0, 0, -1.6))),
        Part("back wall", "back", rectangle((0, 0.7, -1.6), (1.6, 0, 0), (0, 0.7, 0))),
        Part("side wall", "side", rectangle((-1.6, 0.7, 0), (0, 0, -1.6), (0, 0.7, 0))),
        *_things((-0.7, 0, -0.9), 0.5, (0.6, -0.5), 0.3),
        Part("slab", "glass", pane),
        Part("lamp", "lamp", _down(0.3, 2.9, 0.2, 0.05, 0.05)),
    )
    surfaces = {"floor": _WHITE, "back": _matte(0.45, 0.5, 0.6), "side": _matte(0.6, 0.5, 0.4), "red": _RED, "blue": _BLUE}
    surfaces |= {"glass": _GLASS, "lamp": _SMALL_LAMP}
    eye, target = (1.5, 1.25, 2.6), (-0.3, 0.35, -0.5)
    return HardScene("slab", "lamp behind a slab", "caustics", eye, target, 42, surfaces, parts)


def niche() -> HardScene:
    """Returns a closed room lit by a small lamp in a niche of a wall, behind a pane."""
    parts = (
        Part("room", "white", box((-1.6, 0, -2.0), (1.6, 2.5, 2.2), inwards=True)),
        Part("wall", "wall", wall_with_holes((-1.7, -0.1, -1.9), (1.7, 2.6, -1.5), [(-0.3, 0.3, 1.3, 1.8)], axis=2)),
        *_things((-1.0, 0, -0.9), 0.6, (0.6, -0.4), 0.35),
        Part("pane", "glass", box((-0.32, 1.28, -1.56), (0.32, 1.82, -1.53))),
        Part("lamp", "lamp", rectangle((0.1, 1.6, -1.88), (0.04, 0, 0), (0, 0.04, 0))),
    )
    surfaces = {"white": _WHITE, "wall": _matte(0.6, 0.55, 0.5), "red": _RED, "blue": _BLUE, "glass": _GLASS, "lamp": _SMALL_LAMP}
    eye, target = (0.8, 1.4, 2.1), (-0.1, 0.8, -1.0)
    return HardScene("niche", "lamp behind a pane in a niche", "caustics", eye, target, 60, surfaces, parts)


def _vase(center: Point) -> Shape:
    """Returns a vase of glass: two offset curves of one centre line, a chain of cubic Bezier curves, with a round rim."""
    controls = np.array(
        [
            [[0.0, 0.03], [0.12, 0.03], [0.2, 0.03], [0.27, 0.12]],
            [[0.27, 0.12], [0.36, 0.24], [0.38, 0.42], [0.27, 0.62]],
            [[0.27, 0.62], [0.18, 0.78], [0.17, 0.9], [0.26, 1.05]],
        ]
    )
    half, steps = 0.022, 20
    points, tangents = [], []
    for a, b, c, d in controls:
        t = np.linspace(0, 1, steps + 1)[:, None]
        points.append(
            ((1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d)[: -1 if d[1] < 1 else None]
        )
        tangents.append(((1 - t) ** 2 * (b - a) + 2 * (1 - t) * t * (c - b) + t**2 * (d - c))[: -1 if d[1] < 1 else None])
    line, along = np.concatenate(points), np.concatenate(tangents)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    outwards = np.stack([along[:, 1], -along[:, 0]], 1)  # to the right: down at the axis
    angles = np.linspace(0, np.pi, 9)[1:-1, None]
    rim = np.cos(angles) * outwards[-1] + np.sin(angles) * along[-1]
    normals = np.concatenate([outwards, rim, -outwards[::-1]])
    profile = np.concatenate([line, np.repeat(line[-1:], len(rim), 0), line[::-1]]) + half * normals
    return revolved(center, profile, normals, 128)


def vase() -> HardScene:
    """Returns a glass vase and a glass ball under a small lamp, between a floor and three walls."""
    parts = (
        Part("floor", "floor", rectangle((0, 0, 0), (1.6, 0, 0), (0, 0, -1.6))),
        Part("back wall", "back", rectangle((0, 1.1, -1.6), (1.6, 0, 0), (0, 1.1, 0))),
        Part("left wall", "side", rectangle((-1.6, 1.1, 0), (0, 0, -1.6), (0, 1.1, 0))),
        Part("right wall", "side", rectangle((1.6, 1.1, 0), (0, 0, 1.6), (0, 1.1, 0))),
        Part("vase", "glass", _vase((-0.45, 0.001, -0.2))),
        Part("ball", "glass", ball((0.55, 0.302, 0.25), 0.3, 5)),
        Part("lamp", "lamp", _down(0.9, 2.7, 0.9, 0.05, 0.05)),
    )
    surfaces = {"floor": _matte(0.62, 0.6, 0.56), "back": _matte(0.45, 0.5, 0.6), "side": _matte(0.6, 0.5, 0.42)}
    surfaces |= {"glass": _GLASS, "lamp": _SMALL_LAMP}
    return HardScene("vase", "glass vase and ball", "caustics", (0.3, 1.6, 3.3), (-0.05, 0.5, -0.2), 42, surfaces, parts)


# Functions, which build their scene once.
SCENES: dict[str, Callable[[], HardScene]] = {
    name: cache(make)
    for name, make in {
        "door": door,
        "window": window,
        "hatch": hatch,
        "long-room": long_room,
        "corridor": corridor,
        "attic": attic,
        "ball": glass_ball,
        "pool": pool,
        "slab": slab,
        "niche": niche,
        "vase": vase,
    }.items()
}
