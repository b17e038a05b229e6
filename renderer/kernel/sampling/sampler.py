"""Where a path's random numbers come from: a function of (seed, pixel, sample number, block) and of nothing else.

A block is four numbers that belong together. Counters may be uint32, or eight of them (u32x8). Two samplers give numbers:

sobol: the first four dimensions of the Sobol' sequence under a linear scrambling that is the same everywhere (sobol.py), their
digits shifted and their order Owen-scrambled by hashes of seed, pixel and block (Burley, "Practical Hash-based Owen
Scrambling", JCGT 9(4), 2020). The samples 0 ... 2**k - 1 of a pixel fill every block evenly, and so does any other aligned run
of 2**k; pixels and blocks are independent of each other. Places in a pixel are a lattice.
independent: pcg4d of Jarzynski & Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba.extending import intrinsic

from renderer.jit import device, subroutine
from renderer.kernel.sampling.sobol import GOLDEN, MIX_1, MIX_2, SCRAMBLE, TABLE, points
from renderer.settings import SAMPLERS
from renderer.wide.operators import called
from renderer.wide.values import to_float, to_int, u32, where

__all__ = [
    "INDEPENDENT",
    "SOBOL",
    "Stream",
    "draw1",
    "draw4",
    "draw_film",
    "hash4",
    "opposite",
    "pixel_key",
    "sobol4",
    "substream",
    "uniform4",
]

SOBOL, INDEPENDENT = (np.int32(SAMPLERS.index(name)) for name in ("sobol", "independent"))

_MULTIPLIER = np.uint32(1664525)
_INCREMENT = np.uint32(1013904223)
_SHIFT = np.uint32(16)
_FIFTEEN = np.uint32(15)
_DISCARD = np.uint32(8)
_STEP = np.float32(2.0**-24)
_ONE = np.uint32(1)
_NONE, _TWO, _THREE, _FIVE, _SIX, _SEVEN = (np.uint32(n) for n in (0, 2, 3, 5, 6, 7))
_FOUR_FURTHER = np.uint32((4 * int(GOLDEN)) % 2**32)
_SECOND = np.uint32((2 * int(GOLDEN)) % 2**32)
_CAMERA = np.uint32(0)  # the camera's block
_UNITS = np.float32(2.0**24)
# Digits to turn over, found by search: take the first 1, 2, 4, ... 256 points and what they become by it. Of all ways to divide
# the square into as many equal rectangles, by powers of two, more than two thirds have one point in each.
_TURNED = (np.uint32(0x600C07), np.uint32(0xFD9F6F), np.uint32(0x4A694C))
_LATTICE = np.uint32(192955923)  # for all 2**k up to 2**21 points are at least 0.65 times as far apart as any lattice's can be


@device
def _lcg(x):
    return u32(u32(x * _MULTIPLIER) + _INCREMENT)


@device
def _mad(x, y, z):
    return u32(x + u32(y * z))


@device
def _unit(x):
    """The upper 24 bits as a float32 in [0, 1)."""
    return to_float(u32(x >> _DISCARD)) * _STEP


@device
def _mix(x):
    """One to one on 32 bits, every bit of x in every bit of the result (lowbias32 of Wellons, 2018)."""
    x = u32(u32(x ^ u32(x >> _SHIFT)) * MIX_1)
    x = u32(u32(x ^ u32(x >> _FIFTEEN)) * MIX_2)
    return u32(x ^ u32(x >> _SHIFT))


@device
def pixel_key(x, y):
    """The pixel as a counter: the same whatever the frame's size or the tile.

    Mixed one to one: y stands in the upper bits, and pcg4d's products carry a counter's bits upwards only, so that along a
    column the numbers' low bits would not be even.
    """
    return _mix(u32(u32(y) << _SHIFT) | u32(x))


@device
def hash4(seed, pixel, sample, block):
    """Four independent uint32 of four counters: pcg4d."""
    x = _lcg(u32(pixel))
    y = _lcg(u32(sample))
    z = _lcg(u32(block))
    w = _lcg(u32(seed))
    x = _mad(x, y, w)
    y = _mad(y, z, x)
    z = _mad(z, x, y)
    w = _mad(w, y, z)
    x = u32(x ^ u32(x >> _SHIFT))
    y = u32(y ^ u32(y >> _SHIFT))
    z = u32(z ^ u32(z >> _SHIFT))
    w = u32(w ^ u32(w >> _SHIFT))
    x = _mad(x, y, w)
    y = _mad(y, z, x)
    z = _mad(z, x, y)
    w = _mad(w, y, z)
    return x, y, z, w


@intrinsic
def _reversed(typingctx, x):
    """The bits of a uint32 from last to first."""

    def codegen(context, builder, sig, args):
        return called(builder, "bitreverse", args[0])

    return x(x), codegen


@device
def _scramble(x, seed):
    """Owen's nested uniform scrambling of a number whose bits stand in reverse: each is flipped or not by those below it.

    A hash whose bits depend on lower bits only (Laine & Karras 2011), with the constants of Vegdahl, "Building a Better LK
    Hash", 2021.
    """
    x = u32(x ^ u32(x * SCRAMBLE[0]))
    x = u32(x + seed)
    x = u32(x * u32(u32(seed >> _SHIFT) | _ONE))
    x = u32(x ^ u32(x * SCRAMBLE[1]))
    return u32(x ^ u32(x * SCRAMBLE[2]))


@device
def _fitting(index):
    """The order, in reversed bits, of a block's points beside those of another in the order `index`.

    Of the ways to take each binary digit of the sample's number plus the same choice of those after it, one of those by which
    most divisions of the four dimensions into 16, 32, 64 equal boxes, by powers of two, have a point in each.
    """
    near = u32(index ^ u32(index << _THREE))
    far = u32(u32(index << _FIVE) ^ u32(index << _SIX))
    return u32(u32(near ^ far) ^ u32(index << _SEVEN))


@device
def sobol4(seed, pixel, sample, block):
    """Four uint32, scrambled and shifted Sobol' points: dimensions 0 and 1 are a (0, 2)-sequence over the sample numbers.

    Blocks 4, 8, 12, ... follow the order of those two before them (`_fitting`), so that where a path's first vertex sends it and
    where its second does fill four dimensions; all others go in orders of their own.
    """
    follows = u32(block & _THREE) == _NONE
    ahead = u32(block - where(follows, _TWO, _NONE))
    key = _mix(u32(u32(_mix(seed) + u32(ahead * GOLDEN)) ^ pixel))
    index = _scramble(_reversed(u32(sample)), key)
    index = where(follows, _fitting(index), index)
    return points(TABLE, index, u32(key + where(follows, _FOUR_FURTHER, _NONE)))


@device
def uniform4(sampler, seed, pixel, sample, block):
    """Four numbers in [0, 1) of the sampler SOBOL or INDEPENDENT; the other arguments uint32.

    What needs two numbers at once takes the first two, which are the most even.
    """
    if sampler == SOBOL:
        x, y, z, w = sobol4(seed, pixel, sample, block)
    else:
        x, y, z, w = hash4(seed, pixel, sample, block)
    return _unit(x), _unit(y), _unit(z), _unit(w)


class Stream(NamedTuple):
    """The numbers of one sample of one pixel. All uint32, but for the sampler."""

    sampler: int
    seed: int
    pixel: int  # from `pixel_key`
    sample: int


@device
def draw4(stream, block):
    """The four numbers of a block, as in `uniform4`."""
    return uniform4(stream.sampler, stream.seed, stream.pixel, stream.sample, block)


@device
def draw_film(stream):
    """The numbers of a camera ray: its place in the pixel, two, and in the lens, two.

    A pixel's places are a lattice, moved as a whole by two numbers of the pixel's own: all 2**k are about as far from each other
    as can be, which scrambled points are not, and find more of what is finer than a pixel, grain and edges (Liu et al., "Rank-1
    Lattices for Efficient Path Integral Estimation", 2021). For what is smooth, as light is, scrambled ones are better.
    """
    if stream.sampler == SOBOL:
        key = _mix(u32(_mix(stream.seed) ^ stream.pixel))
        index = _scramble(_reversed(u32(stream.sample)), key)
        _, _, z, w = points(TABLE, index, key)
        x = u32(index + _mix(u32(key + GOLDEN)))
        y = u32(u32(index * _LATTICE) + _mix(u32(key + _SECOND)))
    else:
        x, y, z, w = hash4(stream.seed, stream.pixel, stream.sample, _CAMERA)
    return _unit(x), _unit(y), _unit(z), _unit(w)


@device
def opposite(u):
    """Three more numbers beside the first three of a block, by turning certain digits over: those of 2**k samples and these are
    together about as even as those of 2**(k + 1).
    """
    return _turned(u[0], _TURNED[0]), _turned(u[1], _TURNED[1]), _turned(u[2], _TURNED[2])


@device
def _turned(u, digits):
    return to_float(u32(u32(to_int(u * _UNITS)) ^ digits)) * _STEP


@subroutine
def draw1(stream, block):
    """The first number of a block, for what is seldom needed."""
    return draw4(stream, block)[0]


@device
def substream(stream, k, count):
    """The k-th of `count` streams in a sample's place: those of all samples are as even as those of one."""
    return Stream(stream.sampler, stream.seed, stream.pixel, np.uint32(stream.sample * np.uint32(count) + np.uint32(k)))
