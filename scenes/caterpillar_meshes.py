"""Meshes of the folder caterpillar/: a skinned toy caterpillar, a spinning top, a rounded block."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

__all__ = ["HEAD_RADIUS", "JOINTS", "LENGTH", "SPINE", "Joint", "Part", "block", "body_parts", "skin_picture", "top_parts"]

# The bind pose is along +X from the tail at the origin, with its back up (+Y); the face looks along +X.
LENGTH = 3.3
SPINE = 14  # joints from tail to neck, of equal length
BUMPS = 10
RINGS, AROUND = 100, 24
HEAD_RADIUS = 0.37
HEAD = np.array([LENGTH + 0.2, 0.1, 0.0])
EYE_RADIUS = 0.155
ON_BODY = 0.9  # fraction of the texture's width for the body; the rest is for the head


@dataclass(frozen=True)
class Joint:
    """A bone: name, parent index, and position in the bind pose."""

    name: str
    parent: int | None
    place: np.ndarray


def _joints() -> list[Joint]:
    step = LENGTH / SPINE
    found = [Joint(f"spine {i}", i - 1 if i else None, np.array([i * step, 0.0, 0.0])) for i in range(SPINE)]
    found.append(Joint("head", SPINE - 1, HEAD))
    head = SPINE
    for side, z in (("left", -1.0), ("right", 1.0)):
        root = HEAD + HEAD_RADIUS * 0.97 * _unit(0.22, 0.9, 0.42 * z)
        found.append(Joint(f"{side} antenna", head, root))
        found.append(Joint(f"{side} antenna's tip", len(found) - 1, _feeler(root, z, 0.5)))
        eye = HEAD + HEAD_RADIUS * 0.9 * _unit(0.74, 0.36, 0.5 * z)
        found += [Joint(f"{side} eye", head, eye), Joint(f"{side} lid", head, eye)]
    return found


@dataclass
class Part:
    """Triangles of one material. joints, weights: four per vertex."""

    positions: np.ndarray
    triangles: np.ndarray
    normals: np.ndarray
    uvs: np.ndarray | None = None
    joints: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    weights: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))

    def of(self, joint: int) -> Part:
        """Returns the part bound to a single bone."""
        count = len(self.positions)
        self.joints = np.tile([joint, 0, 0, 0], (count, 1))
        self.weights = np.tile([1.0, 0, 0, 0], (count, 1))
        return self


def merged(parts: list[Part]) -> Part:
    """Returns one part with the triangles of all these parts."""
    offsets = np.cumsum([0, *(len(p.positions) for p in parts)])
    uvs = None if parts[0].uvs is None else np.concatenate([p.uvs for p in parts if p.uvs is not None])
    return Part(
        np.concatenate([p.positions for p in parts]),
        np.concatenate([p.triangles + at for p, at in zip(parts, offsets, strict=False)]),
        np.concatenate([p.normals for p in parts]),
        uvs,
        np.concatenate([p.joints for p in parts]),
        np.concatenate([p.weights for p in parts]),
    )


def _unit(*vector: float) -> np.ndarray:
    found = np.array(vector, float)
    return found / np.linalg.norm(found)


def _grid(points: np.ndarray) -> Part:
    """Returns a surface through points (rows, columns, 3).

    Normals: direction of increasing rows x direction of increasing columns.
    """
    rows, columns = points.shape[:2]
    i = np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)
    quads = np.stack([i, i + columns, i + columns + 1, i + 1], -1).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    flat = points.reshape(-1, 3)
    corners = flat[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    triangles = triangles[np.linalg.norm(faces, axis=1) > 1e-12]
    normals = np.zeros_like(flat)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], np.cross(*(flat[triangles[:, k]] - flat[triangles[:, 0]] for k in (1, 2))))
    # Coincident points at seams and poles share a normal.
    _, same = np.unique(np.round(flat, 6), axis=0, return_inverse=True)
    total = np.zeros((same.max() + 1, 3))
    np.add.at(total, same.ravel(), normals)
    normals = total[same.ravel()]
    return Part(flat, triangles, normals / np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-12))


def _ball(center: np.ndarray, radius: float, axis: np.ndarray | None = None, reach: float = np.pi, rings: int = 14) -> Part:
    """Returns a sphere, or only its cap within the angle `reach`, in radians, of an axis."""
    axis = np.array([0.0, 1.0, 0.0]) if axis is None else axis
    side = _unit(*np.cross(axis, [0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0]))
    other = np.cross(axis, side)
    polar = np.linspace(0, reach, rings)[:, None, None]
    turn = np.linspace(0, 2 * np.pi, 2 * rings + 1)[None, :, None]
    points = np.cos(polar) * axis + np.sin(polar) * (np.cos(turn) * side + np.sin(turn) * other)
    return _grid(center + radius * points)


def _tube(line: np.ndarray, radius: np.ndarray, around: int = 10) -> Part:
    """Returns a round tube along points (n, 3)."""
    ahead = np.gradient(line, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    side = np.cross(ahead, [0.3, 0.2, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(ahead, side)
    turn = np.linspace(0, 2 * np.pi, around + 1)[None, :, None]
    return _grid(line[:, None] + radius[:, None, None] * (np.cos(turn) * side[:, None] - np.sin(turn) * other[:, None]))


def _feeler(root: np.ndarray, z: float, t: float | np.ndarray) -> np.ndarray:
    """Returns points on an antenna, t in 0..1: up, then outwards and forward in an arc."""
    t = np.asarray(t)[..., None]
    return root + 0.52 * (t * np.array([0.0, 1.0, 0.12 * z]) + t * t * np.array([0.34, -0.16, 0.42 * z]))


def _radius(s: np.ndarray) -> np.ndarray:
    """Returns the body's radius at a fraction s of its length: a bump per segment, thin at the tail."""
    bump = np.abs(np.sin(np.pi * BUMPS * s)) ** 0.75
    tail = np.sqrt(np.clip(1 - (1 - s / 0.075).clip(0) ** 2, 0, 1))
    return (0.205 + 0.052 * bump) * tail * (1 - 0.1 * s)


def _body() -> Part:
    s = np.concatenate([np.linspace(0, 0.03, 8)[:-1], np.linspace(0.03, 1.0, RINGS)])
    turn = np.linspace(0, 2 * np.pi, AROUND + 1)
    around = np.stack([np.zeros_like(turn), -np.cos(turn), np.sin(turn)], -1)  # begins at the belly
    points = _radius(s)[:, None, None] * around
    points[..., 0] += (s * LENGTH)[:, None]
    part = _grid(points)
    part.uvs = np.stack(np.broadcast_arrays(s[:, None] * ON_BODY, turn / (2 * np.pi)), -1).reshape(-1, 2)
    # A vertex is bound to the two bones whose midpoints enclose it.
    at = (part.positions[:, 0] / LENGTH * SPINE - 0.5).clip(0, SPINE - 1)
    first = np.floor(at).astype(int)
    share = at - first
    share = share * share * (3 - 2 * share)
    zeros = np.zeros_like(first)
    part.joints = np.stack([first, (first + 1).clip(max=SPINE - 1), zeros, zeros], -1)
    part.weights = np.stack([1 - share, share, zeros, zeros], -1)
    return part


def _feet() -> list[Part]:
    found = []
    for bump in range(1, BUMPS - 1):
        s = (bump + 0.5) / BUMPS
        for z in (-1, 1):
            place = np.array([s * LENGTH, -0.185 * (1 - 0.1 * s), 0.15 * z])
            found.append(_ball(place, 0.075, rings=8).of(min(int(s * SPINE), SPINE - 1)))
    return found


def body_parts() -> dict[str, Part]:
    """Returns the caterpillar in its bind pose, by material."""
    number = {joint.name: i for i, joint in enumerate(JOINTS)}
    head = _ball(HEAD, HEAD_RADIUS, rings=18).of(SPINE)
    head.uvs = np.tile([0.97, 0.5], (len(head.positions), 1))
    stalks, tips, whites, pupils, lids, cheeks = [], [], [], [], [], []
    t = np.linspace(0, 1, 12)
    for side, z in (("left", -1.0), ("right", 1.0)):
        root, eye = JOINTS[number[f"{side} antenna"]].place, JOINTS[number[f"{side} eye"]].place
        stalk = _tube(_feeler(root, z, t), 0.03 - 0.012 * t)
        share = np.repeat((2.5 * t - 0.9).clip(0, 1), 11)
        stalk.joints = np.tile([number[f"{side} antenna"], number[f"{side} antenna's tip"], 0, 0], (len(share), 1))
        stalk.weights = np.stack([1 - share, share, 0 * share, 0 * share], -1)
        stalk.uvs = np.tile([0.97, 0.5], (len(share), 1))
        stalks.append(stalk)
        tips.append(_ball(_feeler(root, z, 1.0), 0.07, rings=10).of(number[f"{side} antenna's tip"]))
        whites.append(_ball(eye, EYE_RADIUS).of(number[f"{side} eye"]))
        pupils.append(_ball(eye, EYE_RADIUS + 0.003, _unit(1, 0, 0), 0.62).of(number[f"{side} eye"]))
        lids.append(_ball(eye, EYE_RADIUS + 0.012, _unit(-0.42, 0.9, 0), 1.15, 12).of(number[f"{side} lid"]))
        cheeks.append(_ball(HEAD, HEAD_RADIUS + 0.004, _unit(0.72, -0.2, 0.66 * z), 0.2, 8).of(SPINE))
    u = np.linspace(-1, 1, 17)
    smile = np.stack([np.full_like(u, 0.9), -0.42 + 0.15 * u * u, 0.36 * u], -1)
    smile = HEAD + HEAD_RADIUS * smile / np.linalg.norm(smile, axis=1, keepdims=True)
    mouth = _tube(smile, 0.016 * np.sqrt(1 - 0.75 * u * u), 8).of(SPINE)
    return {
        "skin": merged([_body(), head, *stalks]),
        "feet": merged([*_feet(), *tips]),
        "white": merged(whites),
        "pupil": merged([*pupils, mouth]),
        "lid": merged(lids),
        "cheek": merged(cheeks),
    }


def skin_picture() -> np.ndarray:
    """Returns (64, 512, 3) uint8: horizontally from tail to neck, then the head; vertically around the body from the belly."""
    u = (np.arange(512) + 0.5) / 512
    v = np.abs((np.arange(64) + 0.5) / 64 * 2 - 1)  # 0 on the back, 1 at the belly
    s = (u / ON_BODY)[None, :] * BUMPS
    across, down = np.broadcast_arrays(s, v[:, None])
    even = (np.floor(across) % 2 == 0)[..., None]
    color = np.where(even, [0.42, 0.70, 0.12], [0.66, 0.80, 0.14])
    belly = np.clip((down - 0.62) / 0.12, 0, 1)[..., None]
    color = color + (np.array([0.93, 0.83, 0.45]) - color) * belly
    far = np.hypot((across % 1 - 0.5) * LENGTH / BUMPS, (down - 0.42) * np.pi * 0.24)
    spot = np.clip((0.062 - far) / 0.008, 0, 1)[..., None]
    color = color + (np.array([0.98, 0.60, 0.08]) - color) * spot
    color[:, u > ON_BODY] = [0.56, 0.77, 0.13]
    return np.round(255 * color).astype(np.uint8)


OUTLINE = [(0, 0), (0.03, 0.02), (0.075, 0.09), (0.17, 0.16), (0.33, 0.235), (0.445, 0.32), (0.475, 0.385), (0.45, 0.44)]
OUTLINE += [(0.36, 0.485), (0.22, 0.515), (0.1, 0.545), (0.06, 0.6), (0.048, 0.72), (0.05, 0.82)]
OUTLINE += [(0.075, 0.86), (0.07, 0.91), (0, 0.935)]
TWIST = 0.9  # radians of the stripes' twist over the top's height


def top_parts() -> dict[str, Part]:
    """Returns a spinning top that stands on its tip at the origin, by material: striped body in two colours, stem and tip."""
    outline = np.array(OUTLINE)
    along = np.linspace(0, len(outline) - 1, 3 * len(outline))
    profile = np.stack([np.interp(along, np.arange(len(outline)), outline[:, k]) for k in range(2)], -1)
    kernel = np.array([1, 2, 3, 2, 1]) / 9
    for k in range(2):
        profile[2:-2, k] = np.convolve(profile[:, k], kernel, "valid")
    slope = np.gradient(profile, axis=0)
    found: dict[str, Part] = {}
    quarter = np.pi / 2
    for low, high, name in [(0.0, 0.13, "tip"), (0.13, 0.53, "red"), (0.13, 0.53, "cream"), (0.53, 2.0, "tip")]:
        rows = slice(*(np.searchsorted(profile[:, 1], [low, high]) + np.array([0, 1])))  # adjacent parts share a row
        sectors = (
            [(0.0, 4 * quarter, 49)]
            if name == "tip"
            else [((i + 0.5 * (name == "cream")) * quarter, quarter / 2, 7) for i in range(4)]
        )
        pieces = [found[name]] if name in found else []
        for begin, width, columns in sectors:
            turn = np.linspace(begin + width, begin, columns) + TWIST * profile[rows, 1:] / 0.4
            pieces.append(_revolved(profile[rows], slope[rows], turn))
        found[name] = merged(pieces)
    return found


def _revolved(rows: np.ndarray, slope: np.ndarray, turn: np.ndarray) -> Part:
    """Returns a sector of a surface of revolution, with the normals of the complete surface so that sectors join smoothly."""

    def turned(out: np.ndarray, up: np.ndarray) -> np.ndarray:
        return np.stack([out[:, None] * np.cos(turn), np.broadcast_to(up[:, None], turn.shape), -out[:, None] * np.sin(turn)], -1)

    part = _grid(turned(rows[:, 0], rows[:, 1]))
    normals = turned(slope[:, 1], -slope[:, 0]).reshape(-1, 3)
    part.normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return part


def block(bevel: float = 0.1, steps: int = 7) -> Part:
    """Returns a cube from -1 to 1 with rounded edges."""
    lean = np.concatenate([np.linspace(-1, 0, steps), np.linspace(0, 1, steps)])
    inner = np.repeat([-1 + bevel, 1 - bevel], steps)
    pieces = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            order = [0, 1] if sign > 0 else [1, 0]
            a, b = (np.meshgrid(lean, lean, indexing="ij")[k] for k in order)
            out = np.stack([np.full_like(a, sign), a, b], -1)
            out /= np.linalg.norm(out, axis=-1, keepdims=True)
            a, b = (np.meshgrid(inner, inner, indexing="ij")[k] for k in order)
            core = np.stack([np.full_like(a, sign * (1 - bevel)), a, b], -1)
            piece = _grid(np.roll(core + bevel * out, axis, -1))
            piece.normals = np.roll(out, axis, -1).reshape(-1, 3)
            pieces.append(piece)
    return merged(pieces)


JOINTS = _joints()
