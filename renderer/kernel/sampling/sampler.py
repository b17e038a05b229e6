"""Samplers: the random numbers of a path as a function of (seed, pixel, sample number, block) only.

A block is a group of four numbers. Counters may be uint32, or eight of them (u32x8). There are two samplers:

sobol: the first four dimensions of the Sobol' sequence under a fixed linear scrambling (sobol.py), with a digital shift and an
Owen-scrambled order from hashes of seed, pixel and block (Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020). The
samples 0 ... 2**k - 1 of a pixel are stratified in each block, as is any other aligned run of 2**k samples; pixels and blocks are
independent of each other. Film positions within a pixel form a lattice.
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
# Digits to flip, found by search: for the first 1, 2, 4, ... 256 points with their flipped copies, of all ways to divide
# the square into as many equal rectangles, by powers of two, more than two thirds have one point in each.
_TURNED = (np.uint32(0x600C07), np.uint32(0xFD9F6F), np.uint32(0x4A694C))
_LATTICE = np.uint32(
    192955923
)  # lattice whose least distance is at least 0.65 times that of the best lattice, for all 2**k points up to 2**21


@device
def _lcg(x):
    return u32(u32(x * _MULTIPLIER) + _INCREMENT)


@device
def _mad(x, y, z):
    return u32(x + u32(y * z))


@device
def _unit(x):
    """Returns the upper 24 bits of a uint32 as a fraction: a float32 in [0, 1)."""
    return to_float(u32(x >> _DISCARD)) * _STEP


@device
def _mix(x):
    """Returns a bijective 32-bit hash in which each input bit affects each output bit (lowbias32 of Wellons, 2018)."""
    x = u32(u32(x ^ u32(x >> _SHIFT)) * MIX_1)
    x = u32(u32(x ^ u32(x >> _FIFTEEN)) * MIX_2)
    return u32(x ^ u32(x >> _SHIFT))


@device
def pixel_key(x, y):
    """Returns a pixel's counter, a bijective hash of (x, y) that is independent of the frame's size and of the tile.

    Without the hash the low bits of the numbers would be correlated along a column, since y occupies the upper bits and pcg4d's
    products propagate bits upwards only.
    """
    return _mix(u32(u32(y) << _SHIFT) | u32(x))


@device
def hash4(seed, pixel, sample, block):
    """Returns four independent random uint32, hashed from four counters by pcg4d.

    The block is hashed first. The results of pcg4d are polynomials of a low degree in each counter, so without this the numbers
    of consecutive blocks of a path are not jointly independent: delta tracking was 0.06 to 0.2 % too bright.
    """
    x = _lcg(u32(pixel))
    y = _lcg(u32(sample))
    z = _lcg(_mix(u32(block)))
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
    """Returns a uint32 with the order of its bits reversed."""

    def codegen(context, builder, sig, args):
        return called(builder, "bitreverse", args[0])

    return x(x), codegen


@device
def _scramble(x, seed):
    """Returns a bit-reversed uint32 after Owen's nested uniform scrambling, selected by `seed`.

    Each bit is flipped or not depending on the bits below it, by a hash (Laine & Karras 2011) with the constants of Vegdahl,
    "Building a Better LK Hash", 2021.
    """
    x = u32(x ^ u32(x * SCRAMBLE[0]))
    x = u32(x + seed)
    x = u32(x * u32(u32(seed >> _SHIFT) | _ONE))
    x = u32(x ^ u32(x * SCRAMBLE[1]))
    return u32(x ^ u32(x * SCRAMBLE[2]))


@device
def _paired_index(index):
    """Returns a sample's index in the Sobol' sequence of a second block, which is stratified jointly with a first block.

    index: the sample's index in the sequence of the first block. Both indices are bit-reversed uint32. The map is linear over
    GF(2): it adds to each binary digit of the index a fixed choice of the digits after it. With this choice, most divisions of
    the four dimensions into 16, 32 or 64 equal boxes have one point in each box.
    """
    near = u32(index ^ u32(index << _THREE))
    far = u32(u32(index << _FIVE) ^ u32(index << _SIX))
    return u32(u32(near ^ far) ^ u32(index << _SEVEN))


@device
def sobol4(seed, pixel, sample, block):
    """Returns the Sobol' point of a sample, scrambled and shifted: four uint32.

    block: number of the group of four random numbers that the sample draws. Each block visits the sequence in its own random
    order, except blocks 4, 8, 12 and so on: their order follows from that of the block two before them (`_paired_index`). The
    directions at a path's first and second vertex are therefore stratified in four dimensions together. Dimensions 0 and 1 are
    a (0, 2)-sequence over the sample numbers.
    """
    follows = u32(block & _THREE) == _NONE
    ahead = u32(block - where(follows, _TWO, _NONE))
    key = _mix(u32(u32(_mix(seed) + u32(ahead * GOLDEN)) ^ pixel))
    index = _scramble(_reversed(u32(sample)), key)
    index = where(follows, _paired_index(index), index)
    return points(TABLE, index, u32(key + where(follows, _FOUR_FURTHER, _NONE)))


@device
def uniform4(sampler, seed, pixel, sample, block):
    """Returns four numbers in [0, 1) from the sampler SOBOL or INDEPENDENT. The other arguments are uint32.

    A two-dimensional sample should use the first two numbers, which are the best stratified.
    """
    if sampler == SOBOL:
        x, y, z, w = sobol4(seed, pixel, sample, block)
    else:
        x, y, z, w = hash4(seed, pixel, sample, block)
    return _unit(x), _unit(y), _unit(z), _unit(w)


class Stream(NamedTuple):
    """The random number stream of one sample of one pixel: the sampler, and the uint32 counters from which it hashes numbers."""

    sampler: int
    seed: int
    pixel: int  # from `pixel_key`
    sample: int


@device
def draw4(stream, block):
    """Returns the four numbers in [0, 1) of a block of the stream; see `uniform4`."""
    return uniform4(stream.sampler, stream.seed, stream.pixel, stream.sample, block)


@device
def draw_film(stream):
    """Returns the four numbers of a camera ray: two for the position in the pixel, two for the lens.

    A pixel's positions form a rank-1 lattice shifted by two numbers per pixel: all 2**k points are nearly as far apart as
    possible, which scrambled points are not, and they resolve details below the size of a pixel, such as grain and edges, better
    (Liu et al., "Rank-1 Lattices for Efficient Path Integral Estimation", 2021). For smooth integrands, such as lighting,
    scrambled points are better.
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
    """Returns a second point for the first three numbers of a block, made by flipping fixed binary digits.

    2**k samples and their second points are together about as well stratified as 2**(k + 1) samples.
    """
    return _turned(u[0], _TURNED[0]), _turned(u[1], _TURNED[1]), _turned(u[2], _TURNED[2])


@device
def _turned(u, digits):
    return to_float(u32(u32(to_int(u * _UNITS)) ^ digits)) * _STEP


@subroutine
def draw1(stream, block):
    """Returns the first of the four numbers, in [0, 1), of a block of the stream; for decisions that are rarely needed."""
    return draw4(stream, block)[0]


@device
def substream(stream, k, count):
    """Returns the k-th of `count` streams that together replace one sample's stream, and are together stratified like it."""
    return Stream(stream.sampler, stream.seed, stream.pixel, np.uint32(stream.sample * np.uint32(count) + np.uint32(k)))
