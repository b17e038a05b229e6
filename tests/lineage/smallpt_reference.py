"""smallpt's scene in plain float64 NumPy: slow, direct, and without any code of the renderer.

Only the data are smallpt's (K. Beason, kevinbeason.com/smallpt): nine spheres, their colours, the camera. Paths use BSDF sampling
only, without light sampling. From the sixth segment, Russian roulette uses the largest reflectance. If Rayfarm's kernel and this
agree pixel by pixel within their noise, either both are right or both have the same error.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

__all__ = ["SPHERES", "render"]

F64 = npt.NDArray[np.float64]

DIFFUSE, MIRROR, GLASS = 0, 1, 2
# radius, centre, emission, reflectance, kind
SPHERES: list[tuple[float, tuple[float, float, float], float, tuple[float, float, float], int]] = [
    (1e5, (1e5 + 1, 40.8, 81.6), 0.0, (0.75, 0.25, 0.25), DIFFUSE),
    (1e5, (-1e5 + 99, 40.8, 81.6), 0.0, (0.25, 0.25, 0.75), DIFFUSE),
    (1e5, (50, 40.8, 1e5), 0.0, (0.75, 0.75, 0.75), DIFFUSE),
    (1e5, (50, 40.8, -1e5 + 170), 0.0, (0.0, 0.0, 0.0), DIFFUSE),
    (1e5, (50, 1e5, 81.6), 0.0, (0.75, 0.75, 0.75), DIFFUSE),
    (1e5, (50, -1e5 + 81.6, 81.6), 0.0, (0.75, 0.75, 0.75), DIFFUSE),
    (16.5, (27, 16.5, 47), 0.0, (0.999, 0.999, 0.999), MIRROR),
    (16.5, (73, 16.5, 78), 0.0, (0.999, 0.999, 0.999), GLASS),
    (600.0, (50, 681.6 - 0.27, 81.6), 12.0, (0.0, 0.0, 0.0), DIFFUSE),
]
EYE = np.array([50.0, 52.0, 295.6])
GAZE = np.array([0.0, -0.042612, -1.0]) / math.hypot(0.042612, 1.0)
TANGENT = 0.5135  # the picture's height at distance 1
NEAR = 140.0  # distance from the eye, behind the front wall, at which rays begin
IOR = 1.5
_ROULETTE_FROM = 5
_CLOSEST = 1e-4

_RADIUS = np.array([s[0] for s in SPHERES])
_CENTER = np.array([s[1] for s in SPHERES], np.float64)
_EMISSION = np.array([s[2] for s in SPHERES])
_COLOR = np.array([s[3] for s in SPHERES])
_KIND = np.array([s[4] for s in SPHERES])


def render(width: int, height: int, spp: int, seed: int = 0, max_depth: int = 200, chunk: int = 64) -> tuple[F64, F64]:
    """Returns (mean radiance, variance of the mean), both (height, width, 3), with rows from the top.

    Samples are uniform over the pixel.
    """
    random = np.random.default_rng(seed)
    total = np.zeros((height * width, 3))
    square = np.zeros((height * width, 3))
    y, x = (a.ravel() for a in np.mgrid[0:height, 0:width])
    for first in range(0, spp, chunk):
        for _ in range(min(chunk, spp - first)):
            value = _trace(*_camera(x, y, width, height, random), max_depth, random)
            total += value
            square += value**2
    mean = total / spp
    variance = (square / spp - mean**2) / (spp - 1)
    return mean.reshape(height, width, 3), variance.reshape(height, width, 3)


def _camera(x: F64, y: F64, width: int, height: int, random: np.random.Generator) -> tuple[F64, F64]:
    right = np.array([TANGENT * width / height, 0.0, 0.0])
    up = np.cross(right, GAZE)
    up *= TANGENT / np.linalg.norm(up)
    across = (x + random.random(len(x))) / width - 0.5
    down = 0.5 - (y + random.random(len(x))) / height
    d = GAZE + across[:, None] * right + down[:, None] * up
    return EYE + NEAR * d, d / np.linalg.norm(d, axis=1, keepdims=True)


def _intersect(o: F64, d: F64) -> tuple[F64, npt.NDArray[np.int64]]:
    best = np.full(len(o), np.inf)
    which = np.full(len(o), -1)
    for i in range(len(SPHERES)):
        to_center = _CENTER[i] - o
        b = np.einsum("ij,ij->i", to_center, d)
        inside = b * b - np.einsum("ij,ij->i", to_center, to_center) + _RADIUS[i] ** 2
        root = np.sqrt(np.maximum(inside, 0))
        t = np.where(b - root > _CLOSEST, b - root, b + root)
        closer = (inside >= 0) & (t > _CLOSEST) & (t < best)
        best = np.where(closer, t, best)
        which = np.where(closer, i, which)
    return best, which


def _trace(o: F64, d: F64, max_depth: int, random: np.random.Generator) -> F64:
    radiance = np.zeros((len(o), 3))
    throughput = np.ones((len(o), 3))
    alive = np.arange(len(o))
    for segment in range(max_depth):
        t, which = _intersect(o, d)
        hit = which >= 0
        alive, o, d, t, which = alive[hit], o[hit], d[hit], t[hit], which[hit]
        point = o + t[:, None] * d
        normal = (point - _CENTER[which]) / _RADIUS[which][:, None]
        radiance[alive] += throughput[alive] * _EMISSION[which][:, None]
        color = _COLOR[which]
        brightest = color.max(axis=1)
        chance = brightest if segment + 1 >= _ROULETTE_FROM else np.where(brightest > 0, 1.0, 0.0)
        on = random.random(len(alive)) < chance
        if not on.any():
            break
        alive, point, d, normal = alive[on], point[on], d[on], normal[on]
        throughput[alive] *= color[on] / chance[on][:, None]
        d = _scatter(d, normal, _KIND[which[on]], random)
        o = point
    return radiance


def _scatter(d: F64, normal: F64, kind: npt.NDArray[np.int64], random: np.random.Generator) -> F64:
    entering = np.einsum("ij,ij->i", d, normal) < 0
    facing = np.where(entering[:, None], normal, -normal)
    cosine = -np.einsum("ij,ij->i", d, facing)
    mirrored = d + 2 * cosine[:, None] * facing
    return np.where(
        (kind == DIFFUSE)[:, None],
        _cosine_hemisphere(facing, random),
        np.where((kind == MIRROR)[:, None], mirrored, _glass(d, facing, cosine, entering, mirrored, random)),
    )


def _cosine_hemisphere(axis: F64, random: np.random.Generator) -> F64:
    # A uniform point on the unit sphere around the tip of the axis; its direction from the foot has cosine density.
    z = 2 * random.random(len(axis)) - 1
    angle = 2 * np.pi * random.random(len(axis))
    r = np.sqrt(1 - z * z)
    d = axis + np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    return d / np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-12)


def _glass(d: F64, facing: F64, cosine: F64, entering: npt.NDArray[np.bool_], mirrored: F64, random: np.random.Generator) -> F64:
    ratio = np.where(entering, 1 / IOR, IOR)
    cos2 = 1 - ratio**2 * (1 - cosine**2)
    refracted_cosine = np.sqrt(np.maximum(cos2, 0))
    refracted = ratio[:, None] * d + (ratio * cosine - refracted_cosine)[:, None] * facing
    parallel = (cosine - ratio * refracted_cosine) / (cosine + ratio * refracted_cosine)
    perpendicular = (ratio * cosine - refracted_cosine) / (ratio * cosine + refracted_cosine)
    reflectance = np.where(cos2 <= 0, 1.0, 0.5 * (parallel**2 + perpendicular**2))
    reflects = random.random(len(d)) < reflectance
    # Radiance scales by the index squared on entry and back on exit; no light is inside, so the factors cancel.
    return np.where(reflects[:, None], mirrored, refracted / np.linalg.norm(refracted, axis=1, keepdims=True))
