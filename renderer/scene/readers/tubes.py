"""Converts curves: fibres of hair to segments of round curves (renderer/bvh/curves.py), others to closed tubes of triangles.

Elliptic fibres are open tubes with tangents and diameters. Ribbons, which are flat, become strips.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Mesh

__all__ = [
    "BASES",
    "MAX_FINE_CURVES",
    "MAX_STEPS",
    "MAX_VERTICES",
    "STEPS",
    "CurveWeights",
    "Tubes",
    "curve_segments",
    "curve_weights",
    "elliptic",
    "fibres",
    "fineness_of",
    "line_tangents",
    "ribbons",
    "sides_of",
    "tubes",
    "tubes_mesh",
    "varying_values",
]

F64 = npt.NDArray[np.float64]
STEPS = 6  # lines per cubic segment
_LEAST_NORMAL = 1e-12  # length of a normal below which it is no direction, as of damaged files

BASES = {
    "bezier": np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], np.float64),
    "bspline": np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], np.float64) / 6,
    "catmullRom": np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]], np.float64) / 2,
}


MAX_FINE_CURVES = 500  # up to this many curves get more sides, or more lines
MAX_CURVES = 20_000  # likewise; of more, each is hardly wider than a pixel
MAX_VERTICES = 1 << 25
MAX_STEPS = 1 << 19  # points along curves, those of equal length counted once: their frames are computed one after another


class Tubes(NamedTuple):
    """Tubes around curves, as triangles, or the curves themselves: triangles (a, b, b) are their segments."""

    positions: F64
    normals: F64
    colors: F64 | None
    triangles: npt.NDArray[np.int64]
    tangents: F64 | None  # (V, 4), of fibres
    diameters: F64 | None  # (V,), of fibres
    uvs: tuple[F64, ...] = ()  # (V, 2), up to two sets


class CurveWeights(NamedTuple):
    """The weights that interpolate values along a curve: few for each of its S points, so that a curve may have many points.

    length: number of values. which, weight: (S, k), of the values that a point depends on.
    """

    length: int
    which: npt.NDArray[np.int64]
    weight: F64

    @property
    def samples(self) -> int:
        """The number of points."""
        return len(self.which)

    def interpolate(self, values: F64) -> F64:
        """Returns (n, S, w) the values along n curves. values: (n, length, w)."""
        order = np.argsort(self.which, axis=1, kind="stable")
        which, weight = np.take_along_axis(self.which, order, axis=1), np.take_along_axis(self.weight, order, axis=1)
        found = np.zeros((len(values), self.samples, values.shape[2]))
        for k in range(which.shape[1]):
            found += weight[:, k, None] * values[:, which[:, k]]
        return found


def sides_of(curves: int, fibres: bool) -> int:
    """Returns the number of sides of each of `curves` tubes; fibres get more, as their light depends on the normal."""
    if curves <= MAX_FINE_CURVES:
        return 12
    return 6 if fibres and curves <= MAX_CURVES else 4


def fineness_of(curves: int) -> tuple[float, int]:
    """Returns how far each of `curves` fibres may be from its curve, in radii, and its largest number of lines per segment."""
    if curves <= MAX_FINE_CURVES:
        return 0.1, STEPS
    return (0.5 if curves <= MAX_CURVES else 1.0), 3


def tubes_mesh(name: str, pieces: list[Tubes]) -> Mesh:
    """Returns one mesh of all pieces, with colours if all have them."""
    offsets = np.cumsum([0, *(len(p.positions) for p in pieces)])
    triangles = np.concatenate([p.triangles + o for p, o in zip(pieces, offsets, strict=False)]).astype(np.int32)
    positions, normals = (np.concatenate([p[k] for p in pieces]).astype(np.float32) for k in (0, 1))
    mesh = Mesh(name, positions, triangles, normals)
    colors = [p.colors for p in pieces if p.colors is not None]
    if len(colors) == len(pieces):
        mesh.colors = np.ones((len(positions), 4), np.float32)
        all_colors: F64 = np.concatenate(colors)
        mesh.colors[:, :3] = all_colors.clip(0, 1)
    uv_sets = [np.concatenate(uvs).astype(np.float32) for uvs in zip(*(p.uvs for p in pieces), strict=False)]
    mesh.uvs, mesh.uvs1 = (uv_sets[k] if k < len(uv_sets) else None for k in (0, 1))
    round_ones = [(p.tangents, p.diameters) for p in pieces if p.tangents is not None and p.diameters is not None]
    if round_ones:
        tangents: F64 = np.concatenate([along for along, _ in round_ones])
        diameters: F64 = np.concatenate([across for _, across in round_ones])
        mesh.tangents, mesh.diameters = tangents.astype(np.float32), diameters.astype(np.float32)
    return mesh


def curve_segments(count: int, basis: str, wrap: str) -> int:
    """Returns the number of cubic segments of a curve with `count` control points; 0 if it is too short.

    basis: a key of BASES; wrap: nonperiodic, periodic or pinned, as in USD.
    """
    step = 3 if basis == "bezier" else 1
    if wrap == "periodic":
        segments = count // step
    else:
        segments = count - 1 if wrap == "pinned" and basis != "bezier" else (count - 4) // step + 1
    return 0 if count < (2 if wrap == "pinned" else 3) else max(segments, 0)


def varying_values(count: int, basis: str, wrap: str) -> int:
    """Returns the number of varying values of a curve with `count` control points: one at each end of a segment."""
    if basis == "linear":
        return count
    segments = curve_segments(count, basis, wrap)
    return segments if wrap == "periodic" and segments else segments + 1


def curve_weights(count: int, basis: str, wrap: str) -> tuple[CurveWeights, CurveWeights]:
    """Returns the weights of the points along a curve: those of its control points, and those of values at its segments' ends.

    count: control points; basis: linear or a key of BASES; wrap: nonperiodic, periodic or pinned, as in USD.
    """
    if basis == "linear":
        at = np.arange(count + (wrap == "periodic" and count > 2))[:, None]
        lines = CurveWeights(count, at % max(count, 1), np.ones(at.shape))
        return lines, lines
    step = 3 if basis == "bezier" else 1
    pinned = wrap == "pinned" and basis != "bezier"
    segments = curve_segments(count, basis, wrap)
    if not segments:
        none = np.zeros((0, 1), np.int64), np.zeros((0, 1))
        return CurveWeights(count, *none), CurveWeights(1, *none)
    sample = np.arange(segments * STEPS + 1)
    segment = np.minimum(sample // STEPS, segments - 1)
    step_of_segment = sample - segment * STEPS
    own = np.array([np.array([1, u, u * u, u**3]) @ BASES[basis] for u in np.arange(STEPS + 1) / STEPS])[step_of_segment]
    u = step_of_segment / STEPS
    index = segment[:, None] * step + np.arange(4)
    if wrap == "periodic":
        index %= count
        if count == 3:
            own[:, 0] += own[:, 3]  # the same point
            own[:, 3] = 0
    elif pinned:
        # Pinned curves get phantom end points, such as 2 p0 - p1, so that they begin and end at their own points.
        index -= 1
        for rows, phantom, point, next_point in ((segment == 0, 0, 1, 2), (segment == segments - 1, 3, 2, 1)):
            own[rows, point] += 2 * own[rows, phantom]
            own[rows, next_point] -= own[rows, phantom]
            own[rows, phantom] = 0
        index = index.clip(0, count - 1)
    varying = varying_values(count, basis, wrap)
    ends, shares = np.stack([segment, (segment + 1) % varying], axis=1), np.stack([1 - u, u], axis=1)
    return CurveWeights(count, index, own), CurveWeights(varying, ends, shares)


def line_tangents(lines: F64) -> F64:
    """Returns the unit tangents of (N, S, 3) polylines at their points, along the chord between the neighbours; 0 if it is 0."""
    tangents = np.empty_like(lines)
    tangents[:, 1:-1] = lines[:, 2:] - lines[:, :-2]
    tangents[:, 0], tangents[:, -1] = lines[:, 1] - lines[:, 0], lines[:, -1] - lines[:, -2]
    tangents /= np.maximum(np.linalg.norm(tangents, axis=2, keepdims=True), 1e-30)
    return tangents


def fibres(lines: F64, radii: F64, colors: F64 | None, uvs: Sequence[F64] = ()) -> Tubes:
    """Returns (N, S, 3) polylines as segments of round curves, with tangents and diameters.

    radii: (N, S); colors: (N, S, 3) or None; uvs: (N, S, 2) each.
    """
    count, samples = lines.shape[:2]
    tangents = line_tangents(lines).reshape(-1, 3)
    first = (np.arange(count)[:, None] * samples + np.arange(samples - 1)).reshape(-1)
    return Tubes(
        lines.reshape(-1, 3),
        np.cross(tangents, np.eye(3)[np.argmin(np.abs(tangents), axis=1)]),  # any normal: those of hits follow from the ray
        None if colors is None else colors.reshape(-1, colors.shape[2]),
        np.stack([first, first + 1, first + 1], axis=1),
        np.column_stack([tangents, np.ones(len(tangents))]),
        2 * radii.reshape(-1),
        tuple(each.reshape(-1, 2) for each in uvs),
    )


def tubes(lines: F64, radii: F64, colors: F64 | None, sides: int, fibres: bool = False, uvs: Sequence[F64] = ()) -> Tubes:
    """Returns tubes around (N, S, 3) polylines, with flat ends.

    radii: (N, S); colors: (N, S, 3) or None; uvs: (N, S, 2) each; sides: number of sides of each tube. fibres: makes the tubes
    fibres of hair: without ends, with tangents, and as wide on average as the round fibre, whose circumference they have.
    """
    if fibres:
        radii = radii * (np.pi / sides / np.sin(np.pi / sides))
    count, samples = lines.shape[:2]
    tangents = line_tangents(lines)
    across = np.empty_like(lines)
    least = np.eye(3)[np.argmin(np.abs(tangents[:, 0]), axis=1)]
    side = np.cross(tangents[:, 0], least)
    for s in range(samples):  # parallel transport of the frame
        side = side - tangents[:, s] * np.einsum("ni,ni->n", side, tangents[:, s])[:, None]
        side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-30)
        across[:, s] = side
    third = np.cross(tangents, across)
    angle = np.arange(sides) * (2 * np.pi / sides)
    out = across[:, :, None] * np.cos(angle)[:, None] + third[:, :, None] * np.sin(angle)[:, None]  # (N, S, sides, 3)
    rings = lines[:, :, None] + radii[:, :, None, None] * out
    along, k = np.meshgrid(np.arange(samples - 1), np.arange(sides), indexing="ij")
    a, b = along * sides + k, along * sides + (k + 1) % sides
    body = np.stack([np.stack([a, b, b + sides], -1), np.stack([a, b + sides, a + sides], -1)]).reshape(-1, 3)
    if fibres:
        triangles = (body[None] + (np.arange(count) * samples * sides)[:, None, None]).reshape(-1, 3)
        shown = None if colors is None else np.repeat(colors.reshape(-1, colors.shape[2]), sides, axis=0)
        handed = np.concatenate([tangents, np.ones((count, samples, 1))], axis=2).reshape(-1, 4)
        return Tubes(
            rings.reshape(-1, 3),
            np.broadcast_to(out, rings.shape).reshape(-1, 3),
            shown,
            triangles,
            np.repeat(handed, sides, axis=0),
            np.repeat(2 * radii.reshape(-1), sides),
            tuple(np.repeat(each.reshape(-1, 2), sides, axis=0) for each in uvs),
        )
    ends = np.stack([rings[:, 0], rings[:, -1]], axis=1)
    facing = np.broadcast_to(np.stack([-tangents[:, 0], tangents[:, -1]], axis=1)[:, :, None], ends.shape)
    positions = np.concatenate([rings, ends], axis=1).reshape(-1, 3)
    normals = np.concatenate([out, facing], axis=1).reshape(-1, 3)

    def with_ends(values: F64) -> F64:
        whole = np.concatenate([values, values[:, :1], values[:, -1:]], axis=1)
        return np.asarray(np.repeat(whole.reshape(-1, values.shape[2]), sides, axis=0))

    fan = np.stack([np.zeros(sides - 2, int), np.arange(1, sides - 1), np.arange(2, sides)], axis=1)
    one = np.concatenate([body, samples * sides + fan[:, ::-1], (samples + 1) * sides + fan])
    triangles = (one[None] + (np.arange(count) * (samples + 2) * sides)[:, None, None]).reshape(-1, 3)
    shown = None if colors is None else with_ends(colors)
    return Tubes(positions, normals, shown, triangles, None, None, tuple(with_ends(each) for each in uvs))


def elliptic(mesh: Mesh, sides: int, aspect: float) -> Mesh:
    """Returns tubes that are fibres with a cross-section that is an ellipse, as wide on average as the smooth one.

    mesh: of fibres whose vertices are rings of `sides`; the major axis is that from the middle of a ring to its first vertex, as
    long as before. aspect: minor over major radius, below 1. The second UV set takes the normals, along the major and the minor
    axis, from which kernels have the axes (renderer/kernel/bsdf/huang.py).
    """
    assert mesh.normals is not None and mesh.tangents is not None and mesh.diameters is not None
    turns = np.arange(sides + 1) * (2 * np.pi / sides)
    smooth = np.linspace(0, 2 * np.pi, 1025)
    lengths = [np.hypot(np.diff(np.cos(t)), aspect * np.diff(np.sin(t))).sum() for t in (smooth, turns)]
    widened = lengths[0] / lengths[1] / (np.pi / sides / np.sin(np.pi / sides))
    rings = mesh.positions.reshape(-1, sides, 3).astype(np.float64)
    middle = rings.mean(axis=1, keepdims=True)
    out = mesh.normals.reshape(-1, sides, 3).astype(np.float64)
    major = out[:, :1]
    minor = np.cross(mesh.tangents.reshape(-1, sides, 4)[:, :1, :3], major)
    across, along = (out * major).sum(axis=2, keepdims=True), (out * minor).sum(axis=2, keepdims=True)
    radii = np.linalg.norm(rings - middle, axis=2, keepdims=True) * widened
    positions = middle + radii * (across * major + aspect * along * minor)
    length = np.maximum(np.sqrt((aspect * across) ** 2 + along**2), _LEAST_NORMAL)
    across, along = aspect * across / length, along / length
    return replace(
        mesh,
        positions=positions.reshape(-1, 3).astype(mesh.positions.dtype),
        normals=(across * major + along * minor).reshape(-1, 3).astype(np.float32),
        uvs1=np.concatenate([across, along], axis=2).reshape(-1, 2).astype(np.float32),
        diameters=(mesh.diameters * widened).astype(np.float32),
    )


def ribbons(lines: F64, radii: F64, facing: F64, colors: F64 | None, uvs: Sequence[F64] = ()) -> Tubes:
    """Returns flat strips along (N, S, 3) polylines, as open `Tubes`.

    radii: (N, S), half the width. facing: (N, S, 3), the direction that the strip faces, made perpendicular to the curve; where
    it is along the curve, that of the point before is kept. colors: (N, S, 3) or None; uvs: (N, S, 2) each.
    """
    count, samples = lines.shape[:2]
    side = np.cross(facing, line_tangents(lines))
    length = np.linalg.norm(side, axis=2, keepdims=True)
    side /= np.maximum(length, 1e-30)
    for s in range(1, samples):
        side[:, s] = np.where(length[:, s] > 1e-9, side[:, s], side[:, s - 1])
    normals = np.cross(line_tangents(lines), side)
    edges = radii[:, :, None] * side
    positions = np.stack([lines - edges, lines + edges], axis=2).reshape(-1, 3)
    k = 2 * np.arange(samples - 1)
    one = np.stack([np.stack([k, k + 3, k + 1], -1), np.stack([k, k + 2, k + 3], -1)], axis=1).reshape(-1, 3)
    triangles = (one[None] + (np.arange(count) * 2 * samples)[:, None, None]).reshape(-1, 3)

    def twice(values: F64) -> F64:
        return np.asarray(np.repeat(values.reshape(-1, values.shape[2]), 2, axis=0))

    shown = None if colors is None else twice(colors)
    return Tubes(positions, twice(normals), shown, triangles, None, None, tuple(twice(each) for each in uvs))
