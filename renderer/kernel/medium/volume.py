"""Heterogeneous media: delta tracking of free flights and ratio tracking of transmittance in density grids.

The density of a grid multiplies the coefficients of its medium. Collisions are proposed with a majorant extinction coefficient,
constant in each cell of a coarse grid that the ray crosses cell by cell (pbrt 4ed, 11.4.2), and are real with probability
sigma_t / majorant (Woodcock et al. 1965). Coefficients depend on the wavelength: a flight is tracked for one channel, chosen by
throughput as in flight.py, and weighted by the density of its collisions in all channels (Miller, Georgiev & Jarosz, "A Null-
Scattering Path Integral Formulation of Light Transport", 2019). Transmittance is estimated by ratio tracking (Novak, Selle &
Jarosz, "Residual Ratio Tracking for Estimating Attenuation in Participating Media", 2014). For one path: kernels of eight lanes
call these functions lane by lane.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.arrays.rows import MEDIUM_COLUMNS, MEDIUM_VOLUME, VOLUME_COLUMNS, VOLUME_EMISSION, VOLUME_GRID_COLUMNS
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.fetch import columns, row
from renderer.kernel.polynomial import log
from renderer.kernel.sampling.sampler import INDEPENDENT, uniform4
from renderer.kernel.spectrum.upsampling import light_at
from renderer.wide.values import lookup, to_float, u32

__all__ = ["flight_block", "fly_through_volume", "shadow_block", "volume_of", "volume_transmittance"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_BLACK, _WHITE = (_ZERO, _ZERO, _ZERO), (_ONE, _ONE, _ONE)
_YES, _NO = np.bool_(True), np.bool_(False)
_FLIGHT_BLOCKS, _SHADOW_BLOCKS = np.uint32(1 << 30), np.uint32(3 << 30)  # first blocks; others' are below
_STEPS_BITS = np.uint32(14)
_MOST_STEPS = np.int64(1 << 14)  # collisions of one flight; what is left then is of no importance
_MOST_ROWS = np.uint32((1 << 16) - 1)
_NEXT = np.uint32(1)
_DIM = np.float32(0.05)  # transmittance below which roulette decides
_SURVIVAL = np.float32(0.25)


class _Way(NamedTuple):
    """A ray in the space of a volume's cells: there, cell (i, j, k) extends from i, j, k to i + 1, j + 1, k + 1."""

    origin: tuple[float, float, float]
    direction: tuple[float, float, float]
    inverse: tuple[float, float, float]
    end: float  # distance along the ray
    first: int  # cell of the table `majorant`
    counts: tuple[int, int, int]


class _Place(NamedTuple):
    """A point on a ray: its distance, and its cell. A collision there was proposed with `majorant`; 0: the way has ended."""

    t: float
    i: int
    j: int
    k: int
    majorant: float


@device
def volume_of(scene, medium):
    """Returns the number of a medium's volume plus 1, a float; 0 for a homogeneous medium. medium: row of `medium`."""
    return columns(scene.medium, medium, MEDIUM_COLUMNS, MEDIUM_VOLUME, 1)[0]


@device
def flight_block(number):
    """Returns the first block of random numbers of a flight. number: count of earlier vertices and passed surfaces, integer."""
    return u32(_FLIGHT_BLOCKS | u32(u32(u32(number) & _MOST_ROWS) << _STEPS_BITS))


@device
def shadow_block(number):
    """Returns the first block of random numbers of the shadow ray at a vertex. number: count of earlier vertices, integer."""
    return u32(_SHADOW_BLOCKS | u32(u32(u32(number) & _MOST_ROWS) << _STEPS_BITS))


@device
def _transformed(m, k, p, w):
    return m[k] * p[0] + m[k + 1] * p[1] + m[k + 2] * p[2] + m[k + 3] * w


@device
def _clipped(origin, inverse, size, near, far):
    """Returns the segment near ... far of a ray, clipped to 0 ... size along one axis. A parallel ray's inverse is infinite."""
    if inverse == _INF:
        return (near, far) if _ZERO <= origin <= size else (far, near)
    a, b = -origin * inverse, (size - origin) * inverse
    return max(near, min(a, b)), min(far, max(a, b))


@device
def _inverse(x):
    return _ONE / x if abs(x) > np.float32(1e-30) else _INF


@device
def _cell(x, count):
    return min(max(np.int64(x), np.int64(0)), count - np.int64(1))


@device
def _begin(scene, volume, o, d, near, far):
    """Returns (_Way, _Place) of the ray o + t d through the volume, from near to far; the place's t is beyond the end if it
    misses."""
    m = row(scene.volume, volume, VOLUME_COLUMNS)
    grid = row(scene.volume_grid, volume, VOLUME_GRID_COLUMNS)
    nx, ny, nz = np.int64(grid[5]), np.int64(grid[6]), np.int64(grid[7])
    fx, fy, fz = to_float(nx), to_float(ny), to_float(nz)
    x, y, z = _transformed(m, 0, o, _ONE) * fx, _transformed(m, 4, o, _ONE) * fy, _transformed(m, 8, o, _ONE) * fz
    u, v, w = _transformed(m, 0, d, _ZERO) * fx, _transformed(m, 4, d, _ZERO) * fy, _transformed(m, 8, d, _ZERO) * fz
    inverse = _inverse(u), _inverse(v), _inverse(w)
    near, far = _clipped(x, inverse[0], fx, near, far)
    near, far = _clipped(y, inverse[1], fy, near, far)
    near, far = _clipped(z, inverse[2], fz, near, far)
    i, j, k = np.int64(0), np.int64(0), np.int64(0)
    if near < far:
        i, j, k = _cell(x + near * u, nx), _cell(y + near * v, ny), _cell(z + near * w, nz)
    way = _Way((x, y, z), (u, v, w), inverse, far, np.int64(grid[8]), (nx, ny, nz))
    return way, _Place(near, i, j, k, _ZERO)


@device
def _boundary(cell, origin, inverse):
    """Returns the distance at which the ray leaves a cell along one axis."""
    if inverse == _INF:
        return _INF
    return (to_float(cell + (np.int64(1) if inverse > _ZERO else np.int64(0))) - origin) * inverse


@device
def _next_collision(scene, way, place, sigma, depth):
    """Returns the _Place of the next proposed collision: where the majorant's optical depth from `place` on is `depth`.

    sigma: the largest extinction coefficient at density 1.
    """
    t, i, j, k = place.t, place.i, place.j, place.k
    nx, ny, nz = way.counts
    while t < way.end:
        here = way.first + (k * ny + j) * nx + i
        density, glow = row(scene.majorant, here, 2)
        majorant = density * sigma + glow
        x = _boundary(i, way.origin[0], way.inverse[0])
        y = _boundary(j, way.origin[1], way.inverse[1])
        z = _boundary(k, way.origin[2], way.inverse[2])
        leaves = min(x, min(y, z))
        ahead = max(min(leaves, way.end) - t, _ZERO)
        if majorant * ahead > depth:
            return _Place(t + depth / majorant, i, j, k, majorant)
        depth -= majorant * ahead
        t = max(t, leaves)
        if x <= y and x <= z:
            i += np.int64(1) if way.inverse[0] > _ZERO else np.int64(-1)
        elif y <= z:
            j += np.int64(1) if way.inverse[1] > _ZERO else np.int64(-1)
        else:
            k += np.int64(1) if way.inverse[2] > _ZERO else np.int64(-1)
        if i < 0 or i >= nx or j < 0 or j >= ny or k < 0 or k >= nz:
            break
    return _Place(way.end, i, j, k, _ZERO)


@device
def _axis(x, cells, count):
    """Returns (lower voxel, upper voxel, weight of the upper one) for trilinear interpolation along an axis.

    x: in units of cells, of which there are `cells`; count: of voxels, whose values are those at their centres.
    """
    at = min(max(x * (to_float(count) / to_float(cells)) - _HALF, _ZERO), to_float(count - np.int64(1)))
    lower = np.int64(at)
    return lower, min(lower + np.int64(1), count - np.int64(1)), at - to_float(lower)


@device
def _mix(a, b, share):
    return a + share * (b - a)


@device
def _value(scene, first, voxels, x, y, z):
    """Returns the trilinear interpolation of the grid that begins at number `first` of `voxel`. x, y, z: from _axis."""
    nx, ny = voxels
    rows = (
        first + (z[0] * ny + y[0]) * nx,
        first + (z[0] * ny + y[1]) * nx,
        first + (z[1] * ny + y[0]) * nx,
        first + (z[1] * ny + y[1]) * nx,
    )
    a = _mix(lookup(scene.voxel, rows[0] + x[0]), lookup(scene.voxel, rows[0] + x[1]), x[2])
    b = _mix(lookup(scene.voxel, rows[1] + x[0]), lookup(scene.voxel, rows[1] + x[1]), x[2])
    c = _mix(lookup(scene.voxel, rows[2] + x[0]), lookup(scene.voxel, rows[2] + x[1]), x[2])
    d = _mix(lookup(scene.voxel, rows[3] + x[0]), lookup(scene.voxel, rows[3] + x[1]), x[2])
    return _mix(_mix(a, b, y[2]), _mix(c, d, y[2]), z[2])


@device
def _density_and_glow(scene, volume, way, t):
    """Returns (density, emission without its colour) of the volume at distance t."""
    grid = row(scene.volume_grid, volume, VOLUME_GRID_COLUMNS)
    nx, ny, nz = np.int64(grid[0]), np.int64(grid[1]), np.int64(grid[2])
    cx, cy, cz = way.counts
    x = _axis(way.origin[0] + t * way.direction[0], cx, nx)
    y = _axis(way.origin[1] + t * way.direction[1], cy, ny)
    z = _axis(way.origin[2] + t * way.direction[2], cz, nz)
    glow = _ZERO
    if grid[4] >= 0:
        glow = _value(scene, np.int64(grid[4]), (nx, ny), x, y, z)
    return _value(scene, np.int64(grid[3]), (nx, ny), x, y, z), glow


@device
def _depth(u):
    return -log(_ONE - u)


@subroutine
def fly_through_volume(
    scene, medium, sigma_t, sigma_s, o, d, near, far, throughput, seed, pixel, sample, block, u, v, wavelengths
):
    """Samples a free flight in a heterogeneous medium; returns (scatters, distance of the end, throughput there, emission).

    medium: row of `medium`, which has a volume. sigma_t, sigma_s: its coefficients at density 1. o, d: the ray. near, far: the
    flight begins and ends there, at a surface or at infinity. seed, pixel, sample: of the path's Stream. block: from
    `flight_block`. u, v: the first numbers for the distance and for the channel. wavelengths: of the path (kernel/spectrum); None
    in RGB. The emission is what the medium emits on the way, multiplied by the throughput. A medium that scatters nothing only
    attenuates.
    """
    never_inline()
    volume = np.int64(volume_of(scene, medium)) - np.int64(1)
    red, green, blue = throughput
    total = red + green + blue
    emitted = _BLACK
    if not total > _ZERO:
        return _NO, far, _BLACK, emitted
    color = light_at(scene, columns(scene.volume, volume, VOLUME_COLUMNS, VOLUME_EMISSION, 3), wavelengths)
    can_scatter = vec.maximum(sigma_s) > _ZERO
    at = v * total
    sigma = sigma_t[0] if at < red else sigma_t[1] if at < red + green else sigma_t[2]
    left = _WHITE
    way, place = _begin(scene, volume, o, d, near, far)
    depth = _depth(u)
    for _step in range(_MOST_STEPS):
        place = _next_collision(scene, way, place, vec.maximum(sigma_t), depth)
        if place.majorant <= _ZERO:
            carried = vec.mul(throughput, left)
            if can_scatter:
                density = (carried[0] + carried[1] + carried[2]) / total
                carried = vec.scale(carried, _ONE / density) if density > _ZERO else _BLACK
            return _NO, far, carried, emitted
        x, y, _, _ = uniform4(INDEPENDENT, seed, pixel, sample, block)
        block = u32(block + _NEXT)
        density, glow = _density_and_glow(scene, volume, way, place.t)
        carried = vec.mul(throughput, left)
        share = (carried[0] + carried[1] + carried[2]) / total if can_scatter else _ONE
        if not share > _ZERO:
            break
        emitted = vec.add(emitted, vec.scale(vec.mul(carried, color), glow / (place.majorant * share)))
        real = density / place.majorant
        if can_scatter and x < real * sigma:
            density = (carried[0] * sigma_t[0] + carried[1] * sigma_t[1] + carried[2] * sigma_t[2]) / total
            return _YES, place.t, vec.scale(vec.mul(carried, sigma_s), _ONE / density), emitted
        left = (
            left[0] * max(_ONE - real * sigma_t[0], _ZERO),
            left[1] * max(_ONE - real * sigma_t[1], _ZERO),
            left[2] * max(_ONE - real * sigma_t[2], _ZERO),
        )
        depth = _depth(y)
    return _NO, far, _BLACK, emitted


@subroutine
def volume_transmittance(scene, medium, sigma_t, o, d, near, far, seed, pixel, sample, block):
    """Estimates the transmittance of a heterogeneous medium along a ray; returns (rgb, the next unused block).

    The arguments are those of `fly_through_volume`.
    """
    never_inline()
    volume = np.int64(volume_of(scene, medium)) - np.int64(1)
    left = _WHITE
    way, place = _begin(scene, volume, o, d, near, far)
    for _step in range(_MOST_STEPS):
        x, y, _, _ = uniform4(INDEPENDENT, seed, pixel, sample, block)
        block = u32(block + _NEXT)
        most = vec.maximum(left)
        if most < _DIM:
            if y >= _SURVIVAL:
                return _BLACK, block
            left = vec.scale(left, _ONE / _SURVIVAL)
        place = _next_collision(scene, way, place, vec.maximum(sigma_t), _depth(x))
        if place.majorant <= _ZERO:
            return left, block
        density, _ = _density_and_glow(scene, volume, way, place.t)
        real = density / place.majorant
        left = (
            left[0] * max(_ONE - real * sigma_t[0], _ZERO),
            left[1] * max(_ONE - real * sigma_t[1], _ZERO),
            left[2] * max(_ONE - real * sigma_t[2], _ZERO),
        )
    return _BLACK, block
