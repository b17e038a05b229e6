"""OBJ meshes of scenes/christmas.py: a fir, the parts of a house, a snowman and his hat, the ground.

Units are metres, +Y is up. Materials are those of `village.mtl`, which scenes/christmas.py writes.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from obj_text import Obj

__all__ = [
    "EAVES",
    "HALF_DEPTH",
    "HALF_WIDTH",
    "POND",
    "RIDGE",
    "chimney",
    "fir",
    "ground",
    "hat",
    "height",
    "house",
    "snowman",
    "star",
]

LIBRARY = "village.mtl"

HALF_WIDTH, HALF_DEPTH = 1.7, 1.35  # of a house's walls
EAVES, RIDGE = 1.75, 3.15
OVERHANG = 0.28
POND = (0.9, 2.6, 2.35, 1.35)  # centre x, z; half length, half width

Random = np.random.Generator


def _smooth(edge0: float, edge1: float, x: float) -> float:
    t = min(max((x - edge0) / (edge1 - edge0), 0.0), 1.0)
    return t * t * (3 - 2 * t)


def height(x: float, z: float) -> float:
    """Returns the height of the snow."""
    rolling = 0.11 * math.sin(0.9 * x + 0.4) * math.cos(0.7 * z) + 0.05 * math.sin(2.1 * x - 1.3 * z)
    behind = _smooth(-9, -30, z)
    hills = behind * (4.2 + 1.5 * math.sin(0.21 * x + 1.0) + 0.9 * math.sin(0.47 * x - 0.2 * z))
    sides = 1.6 * _smooth(7, 17, abs(x - 0.5)) * _smooth(8, 0, z)
    away = math.hypot((x - POND[0]) / POND[2], (z - POND[1]) / POND[3])
    shore = 0.09 * math.exp(-(((away - 1.25) / 0.22) ** 2))
    flat = 1 - _smooth(1.0, 1.9, away)
    return (0.1 + rolling + hills + sides) * (1 - flat) - 0.14 * flat * (1 - _smooth(0.9, 1.15, away)) + shore


def star() -> str:
    """Returns a five-pointed, cushion-shaped star."""
    obj = Obj(LIBRARY)
    obj.use("starlight")
    rim = [
        (r * math.sin(t), r * math.cos(t), 0.0) for r, t in ((0.16 if i % 2 == 0 else 0.065, math.pi * i / 5) for i in range(10))
    ]
    points = [*rim, (0, 0, 0.05), (0, 0, -0.05)]
    obj.add(points, [f for i in range(10) for f in ([10, (i + 1) % 10, i], [11, i, (i + 1) % 10])])
    return obj.text()


def ground() -> str:
    """Returns rolling snow with a hollow for a pond, and hills behind; finest in front of the camera."""
    obj = Obj(LIBRARY)
    obj.use("snow")
    pond_x, pond_z = np.linspace(-2.3, 4.1, 24), np.linspace(4.4, 0.8, 15)
    beyond = np.linspace(0, 1, 12)[1:] ** 1.6
    across = [round(float(x), 2) for x in (*(-2.3 - 24 * beyond[::-1]), *pond_x, *(4.1 + 24 * beyond))]
    deep = [round(float(z), 2) for z in (9, 6.5, 5.2, *pond_z, *(0.8 - 42 * np.linspace(0, 1, 23)[1:] ** 1.6))]
    obj.grid([[(x, height(x, z), z) for x in across] for z in reversed(deep)])
    return obj.text()


def fir(random: Random, whorls: int = 10) -> str:
    """Returns a tree about three metres high: whorls of drooping fronds with snow."""
    obj = Obj(LIBRARY, digits=2)
    obj.use("bark")
    obj.lathe([(0.11, -0.3), (0.08, 0.5), (0.02, 2.7)], 7)
    fronds = []
    for k in range(whorls):
        t = k / (whorls - 1)
        count = round(12 - 6 * t)
        for i in range(count):
            turn = 2 * math.pi * (i + 0.5 * (k % 2)) / count + float(random.normal(0, 0.09))
            length = (1.12 * (1 - t) ** 0.9 + 0.14) * float(random.uniform(0.86, 1.08))
            fronds.append((turn, length, 0.42 + 2.3 * t + float(random.normal(0, 0.025)), 0.34 - 0.25 * t))
    obj.use("needles")
    for frond in fronds:
        _frond(obj, *frond)
    obj.lathe([(0.1, 2.62), (0.05, 2.8), (0.0, 3.06)], 7)
    obj.use("snow")
    for turn, length, y, droop in fronds:
        _load(obj, turn, length, y, droop, float(random.uniform(0.6, 0.84)))
    obj.lathe([(0.09, 2.74), (0.055, 2.85), (0.0, 3.08)], 7)
    return obj.text()


def _along(turn: float, length: float, y: float, droop: float) -> Callable[[float, float, float], tuple[float, float, float]]:
    """Returns a function that maps frond coordinates (0..1 outwards, metres sideways and up) to a point in space."""
    cosine, sine = math.cos(turn), math.sin(turn)

    def point(s: float, side: float, up: float) -> tuple[float, float, float]:
        out = 0.03 + length * s
        rise = 0.10 * length * s - droop * length * s * s * 1.6 + up
        return out * cosine - side * sine, y + rise, -(out * sine + side * cosine)

    return point


def _frond(obj: Obj, turn: float, length: float, y: float, droop: float) -> None:
    point = _along(turn, length, y, droop)
    width = 0.13 + 0.16 * length
    teeth = [(0.0, 0.3), (0.2, 0.95), (0.3, 0.6), (0.5, 1.0), (0.6, 0.55), (0.8, 0.7), (0.87, 0.3)]
    spine = [point(s, 0.0, 0.03) for s in (0.0, 0.35, 0.65, 1.0)]
    left = [point(s + (0.06 if i % 2 else 0), -w * width, -0.55 * w * width) for i, (s, w) in enumerate(teeth)]
    right = [point(s + (0.06 if i % 2 else 0), w * width, -0.55 * w * width) for i, (s, w) in enumerate(teeth)]
    a, b = 4, 4 + len(teeth)
    faces = []
    for i in range(len(teeth) - 1):
        ridge = min(i // 2, 2)
        faces += [[ridge, a + i, a + i + 1], [ridge, b + i + 1, b + i]]
        if i % 2:
            faces += [[ridge, a + i + 1, ridge + 1], [ridge, ridge + 1, b + i + 1]]
    faces += [[2, a + 6, 3], [2, 3, b + 6]]
    obj.add([*spine, *left, *right], faces)


def _load(obj: Obj, turn: float, length: float, y: float, droop: float, reach: float) -> None:
    """Adds the snow that lies on a frond of a fir: a cushion that leaves the tips of the needles free."""
    point = _along(turn, length, y, droop)
    width = 0.7 * (0.13 + 0.16 * length)
    rows = []
    for s, w in ((0.0, 0.35), (0.4, 1.0), (0.8, 0.85), (1.0, 0.15)):
        at = s * reach
        up = 0.055 * (0.5 + 0.5 * length) * (1 if 0 < s < 1 else 0.5)
        side = w * width
        rows.append(
            [
                point(at, -side, 0.01 - 0.5 * side),
                point(at, -0.5 * side, up),
                point(at, 0.5 * side, up),
                point(at, side, 0.01 - 0.5 * side),
            ]
        )
    obj.grid([row[::-1] for row in rows])


def house() -> dict[str, str]:
    """Returns walls, with UVs in metres (v from the ground up), the parts set into them, and the roof with its snow."""
    walls = Obj(LIBRARY)
    walls.use("bricks")
    w, d = HALF_WIDTH, HALF_DEPTH
    for sign in (1, -1):
        outline = [(-w, -0.4), (w, -0.4), (w, EAVES), (0, RIDGE), (-w, EAVES)]
        walls.add([(sign * x, y, sign * d) for x, y in outline], [[0, 1, 2, 3, 4]], outline)
        side = [(-d, -0.4), (d, -0.4), (d, EAVES), (-d, EAVES)]
        walls.add([(sign * w, y, -sign * z) for z, y in side], [[0, 1, 2, 3]], side)
    joinery, windows = Obj(LIBRARY), Obj(LIBRARY)
    for x, y, half, tall in ((-0.98, 0.95, 0.34, 0.36), (0.98, 0.95, 0.34, 0.36), (0.0, 2.12, 0.22, 0.27)):
        pane = [(x + a * half, y + b * tall, d + 0.012) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        windows.add(pane, [[0, 1, 2, 3]], [(0, 0), (1, 0), (1, 1), (0, 1)])
        _frame(joinery, x, y, d, half, tall)
    joinery.use("door")
    joinery.box((0, 0.55, d), (0.33, 0.62, 0.04))
    joinery.use("frame")
    for side in (-1, 1):
        joinery.box((side * 0.37, 0.57, d), (0.045, 0.68, 0.07))
    joinery.box((0, 1.22, d), (0.42, 0.05, 0.08))
    joinery.use("snow")
    joinery.box((0, 1.29, d + 0.03), (0.42, 0.03, 0.09))
    joinery.box((0, 0.0, d + 0.3), (0.5, 0.12, 0.3))
    parts = {"walls": walls, "windows": windows, "joinery": joinery, "roof": _roof()}
    return {f"{name}.obj": part.text() for name, part in parts.items()}


def _frame(obj: Obj, x: float, y: float, z: float, half: float, tall: float) -> None:
    obj.use("frame")
    for side in (-1, 1):
        obj.box((x + side * (half + 0.03), y, z), (0.04, tall + 0.06, 0.05))
        obj.box((x, y + side * (tall + 0.03), z), (half + 0.06, 0.035, 0.06))
    obj.use("snow")
    obj.box((x, y - tall + 0.02, z + 0.05), (half + 0.04, 0.03, 0.05))


def _roof() -> Obj:
    obj = Obj(LIBRARY)
    run = math.hypot(HALF_WIDTH, RIDGE - EAVES)
    out, down = HALF_WIDTH / run, (RIDGE - EAVES) / run
    reach = run + OVERHANG
    deep = HALF_DEPTH + OVERHANG
    obj.use("tiles")
    for side in (1, -1):
        for up, turned in ((0.06, False), (-0.02, True)):
            corners = [
                (side * out * s, RIDGE - down * s + up, z) for s, z in ((0, deep), (reach, deep), (reach, -deep), (0, -deep))
            ]
            obj.add(corners, [[0, 1, 2, 3] if (side == 1) != turned else [3, 2, 1, 0]])
        for end in (1, -1):
            face = [
                (side * out * s, RIDGE - down * s + up, end * deep)
                for s, up in ((0, -0.02), (reach, -0.02), (reach, 0.06), (0, 0.06))
            ]
            obj.add(face, [[0, 1, 2, 3] if side * end == 1 else [3, 2, 1, 0]])
        eave = [
            (side * out * reach, RIDGE - down * reach + up, z)
            for up, z in ((-0.02, deep), (-0.02, -deep), (0.06, -deep), (0.06, deep))
        ]
        obj.add(eave, [[0, 1, 2, 3] if side == 1 else [3, 2, 1, 0]])
    obj.use("snow")
    rows = []
    slopes = [-1.03, -1.035, -1.0, -0.92, -0.75, -0.5, -0.25, -0.07, 0.07, 0.25, 0.5, 0.75, 0.92, 1.0, 1.035, 1.03]
    ends = [-1.02, -1.02, -0.97, -0.8, -0.4, 0.0, 0.4, 0.8, 0.97, 1.02, 1.02]
    for i, t in enumerate(ends):
        row = []
        for k, a in enumerate(slopes):
            edge = i in (0, len(ends) - 1) or k in (0, len(slopes) - 1)
            rim = 1 - max(_smooth(0.86, 1.03, abs(a)), _smooth(0.88, 1.02, abs(t))) ** 2 * 0.55
            bump = 0.025 * math.sin(5 * a + 3 * t) + 0.02 * math.sin(9 * t - 4 * a)
            thick = 0.03 if edge else 0.06 + (0.17 + bump) * rim
            s = a * reach
            row.append((out * s, RIDGE - down * math.hypot(s, 0.1) + thick, t * deep))
        rows.append(row)
    obj.grid(rows)
    return obj


def chimney() -> str:
    """Returns a brick chimney capped with snow; its UVs are in metres."""
    obj = Obj(LIBRARY)
    obj.use("sooty bricks")
    for turn in range(4):
        cosine, sine = round(math.cos(turn * math.pi / 2)), round(math.sin(turn * math.pi / 2))
        outline = [(-0.2, -0.6), (0.2, -0.6), (0.2, 0.62), (-0.2, 0.62)]
        obj.add([(u * cosine + 0.2 * sine, v, -u * sine + 0.2 * cosine) for u, v in outline], [[0, 1, 2, 3]], outline)
    obj.use("tiles")
    obj.box((0, 0.64, 0), (0.25, 0.04, 0.25))
    obj.use("snow")
    obj.lathe([(0.27, 0.68), (0.29, 0.72), (0.25, 0.8), (0.12, 0.85), (0, 0.86)], 16)
    return obj.text()


def snowman() -> str:
    """Returns a snowman of three merged balls, with scarf, arms, coal and a carrot, facing +Z."""
    obj = Obj(LIBRARY)
    obj.use("snow")
    profile = []
    for k in range(22):
        y = 1.66 * k / 21
        radii = [math.sqrt(max(r * r - (y - c) ** 2, 0.0)) for r, c in ((0.48, 0.38), (0.34, 0.97), (0.235, 1.425))]
        profile.append(((radii[0] ** 6 + radii[1] ** 6 + radii[2] ** 6) ** (1 / 6), y))
    obj.lathe(profile, 20)
    obj.use("wool")
    ring = []
    for k in range(7):
        t = 2 * math.pi * k / 6
        ring.append((0.215 + 0.06 * math.cos(t), 1.235 + 0.06 * math.sin(t)))
    obj.lathe(ring, 20, mapped=True)
    rows = []
    for k in range(5):
        y = 1.24 - 0.11 * k
        rows.append([(x + 0.02 * k, y, 0.25 + 0.055 * math.sin(0.8 * k) + 0.03 * k) for x in (0.03, 0.15)])
    obj.grid(rows, [[(u, k / 4) for u in (0, 1)] for k in range(5)])
    obj.use("coal")
    for x in (-0.085, 0.085):
        _ball(obj, (x, 1.49, 0.212), 0.03)
    for k in range(5):
        angle = (k - 2) * 0.33
        _ball(obj, (0.105 * math.sin(angle), 1.345 - 0.03 * math.cos(angle) + 0.02, 0.222), 0.016)
    for k in range(3):
        y = 0.82 + 0.13 * k
        _ball(obj, (0.0, y, math.sqrt(max(0.34**2 - (y - 0.97) ** 2, 0)) + 0.005), 0.03)
    obj.use("carrot")
    tip = [(0.012 * math.sin(i), 1.43, 0.22 + 0.27) for i in range(1)]
    rim = [(0.036 * math.sin(t), 1.42 + 0.036 * math.cos(t), 0.215) for t in (2 * math.pi * i / 10 for i in range(10))]
    obj.add([*tip, *rim], [[0, 1 + (i + 1) % 10, 1 + i] for i in range(10)])
    obj.use("bark")
    for side in (-1, 1):
        _twig(obj, (side * 0.28, 1.02, 0.05), (side * 0.82, 1.32, 0.16), 0.02)
        _twig(obj, (side * 0.62, 1.21, 0.12), (side * 0.72, 1.42, 0.10), 0.011)
        _twig(obj, (side * 0.66, 1.23, 0.12), (side * 0.86, 1.2, 0.22), 0.011)
    return obj.text()


def _ball(obj: Obj, center: tuple[float, float, float], radius: float) -> None:
    turns = [math.pi * k / 4 for k in range(5)]
    obj.lathe([(radius * math.sin(t), -radius * math.cos(t)) for t in turns], 6, center)


def _twig(obj: Obj, start: tuple[float, ...], end: tuple[float, ...], radius: float) -> None:
    a, b = np.array(start), np.array(end)
    axis = (b - a) / np.linalg.norm(b - a)
    u = np.cross(axis, (0.0, 0.0, 1.0))
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    rim = [math.cos(t) * u + math.sin(t) * v for t in (2 * math.pi * i / 5 for i in range(5))]
    points = [a + radius * r for r in rim] + [b + 0.4 * radius * r for r in rim]
    obj.add([tuple(p) for p in points], [[i, (i + 1) % 5, 5 + (i + 1) % 5, 5 + i] for i in range(5)])


def hat() -> str:
    """Returns a top hat with a band, on its brim."""
    obj = Obj(LIBRARY)
    obj.use("felt")
    obj.lathe([(0, 0), (0.27, 0), (0.285, 0.012), (0.27, 0.025), (0.168, 0.03), (0.155, 0.3), (0.168, 0.33), (0, 0.335)], 24)
    obj.use("ribbon")
    obj.lathe([(0.1685, 0.032), (0.166, 0.095)], 24)
    return obj.text()
