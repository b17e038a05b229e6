"""Where a path's random numbers come from: a function of (seed, pixel, sample number, block) and of nothing else.

A block is four numbers that belong together. Two samplers give them:

sobol: the first four dimensions of the Sobol' sequence, Owen-scrambled and shuffled by hashes of seed, pixel and block
(Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020). The samples 0 ... 2**k - 1 of a pixel fill every block
evenly, and so does any other aligned run of 2**k; pixels and blocks are independent of each other.
independent: pcg4d of Jarzynski & Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from renderer.jit import device, subroutine
from renderer.settings import SAMPLERS

__all__ = [
    "INDEPENDENT",
    "SOBOL",
    "Stream",
    "direction_numbers",
    "draw1",
    "draw4",
    "hash4",
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
_MIX_1 = np.uint32(0x7FEB352D)
_MIX_2 = np.uint32(0x846CA68B)
_GOLDEN = np.uint32(0x9E3779B9)
_DISCARD = np.uint32(8)
_STEP = np.float32(2.0**-24)
_ONE = np.uint32(1)
_SCRAMBLE = tuple(np.uint32(c) for c in (0x3D20ADEA, 0x05526C56, 0x53A22864))
_NIBBLE = np.uint32(15)
_NIBBLES = 7  # of the sample number: 28 bits, more than MAX_SPP times MAX_LIGHT_SAMPLES
_DIMENSIONS = 4


@device
def _lcg(x):
    return np.uint32(np.uint32(x * _MULTIPLIER) + _INCREMENT)


@device
def _mad(x, y, z):
    return np.uint32(x + np.uint32(y * z))


@device
def _unit(x):
    """The upper 24 bits as a float32 in [0, 1)."""
    return np.float32(np.uint32(x >> _DISCARD)) * _STEP


@device
def _mix(x):
    """One to one on 32 bits, every bit of x in every bit of the result (lowbias32 of Wellons, 2018)."""
    x = np.uint32(np.uint32(x ^ np.uint32(x >> _SHIFT)) * _MIX_1)
    x = np.uint32(np.uint32(x ^ np.uint32(x >> _FIFTEEN)) * _MIX_2)
    return np.uint32(x ^ np.uint32(x >> _SHIFT))


@device
def pixel_key(x, y):
    """The pixel as a counter: the same whatever the frame's size or the tile.

    Mixed one to one: y stands in the upper bits, and pcg4d's products carry a counter's bits upwards only, so that along a
    column the numbers' low bits would not be even.
    """
    return _mix(np.uint32(np.uint32(y) << _SHIFT) | np.uint32(x))


@device
def hash4(seed, pixel, sample, block):
    """Four independent uint32 of four counters: pcg4d."""
    x = _lcg(np.uint32(pixel))
    y = _lcg(np.uint32(sample))
    z = _lcg(np.uint32(block))
    w = _lcg(np.uint32(seed))
    x = _mad(x, y, w)
    y = _mad(y, z, x)
    z = _mad(z, x, y)
    w = _mad(w, y, z)
    x = np.uint32(x ^ np.uint32(x >> _SHIFT))
    y = np.uint32(y ^ np.uint32(y >> _SHIFT))
    z = np.uint32(z ^ np.uint32(z >> _SHIFT))
    w = np.uint32(w ^ np.uint32(w >> _SHIFT))
    x = _mad(x, y, w)
    y = _mad(y, z, x)
    z = _mad(z, x, y)
    w = _mad(w, y, z)
    return x, y, z, w


def direction_numbers() -> np.ndarray:
    """The Sobol' generator matrices' columns, (4, 32) uint32, most significant bit first (Joe & Kuo 2008, new-joe-kuo-6).

    Column k is what bit k of the index adds.
    """
    # Degree, inner coefficients and first odd numbers of a primitive polynomial over GF(2), for dimensions 2, 3, 4.
    columns = [[1 << (31 - k) for k in range(32)]]
    for degree, inner, first in ((1, 0, (1,)), (2, 1, (1, 3)), (3, 1, (1, 3, 1))):
        v = [m << (31 - k) for k, m in enumerate(first)]
        for k in range(degree, 32):
            value = v[k - degree] ^ (v[k - degree] >> degree)
            for j in range(1, degree):
                if inner >> (degree - 1 - j) & 1:
                    value ^= v[k - j]
            v.append(value)
        columns.append(v)
    return np.array(columns, np.uint32)


def _tables() -> np.ndarray:
    """What each value of each nibble of a bit-reversed index adds, bit-reversed: (nibbles * 16, 4) uint32."""
    columns = direction_numbers()
    backwards = np.array([[int(f"{int(c):032b}"[::-1], 2) for c in row] for row in columns], np.uint32)
    table = np.zeros((_NIBBLES, 16, _DIMENSIONS), np.uint32)
    for nibble in range(_NIBBLES):  # the first is the index's lowest four bits, which stand uppermost, lowest bit first
        for value in range(16):
            for bit in range(4):
                if value >> (3 - bit) & 1:
                    table[nibble, value] ^= backwards[:, 4 * nibble + bit]
    return table.reshape(-1, _DIMENSIONS)


_TABLE = _tables()


@intrinsic
def _reversed(typingctx, x):
    """The bits of a uint32 from last to first."""

    def codegen(context, builder, sig, args):
        return builder.bitreverse(args[0])

    return types.uint32(types.uint32), codegen


@device
def _scramble(x, seed):
    """Owen's nested uniform scrambling of a number whose bits stand in reverse: each is flipped or not by those below it.

    A hash whose bits depend on lower bits only (Laine & Karras 2011), with the constants of Vegdahl, "Building a Better LK
    Hash", 2021.
    """
    x = np.uint32(x ^ np.uint32(x * _SCRAMBLE[0]))
    x = np.uint32(x + seed)
    x = np.uint32(x * np.uint32(np.uint32(seed >> _SHIFT) | _ONE))
    x = np.uint32(x ^ np.uint32(x * _SCRAMBLE[1]))
    return np.uint32(x ^ np.uint32(x * _SCRAMBLE[2]))


_LANES = ir.VectorType(ir.IntType(32), _DIMENSIONS)


@intrinsic
def _points(typingctx, table, index, key):
    """Point `index` (bits in reverse) of the sequence, its four dimensions scrambled by what `_mix` makes of four numbers
    that lie far from the key and from each other: uint32 each.

    `_mix` and `_scramble` on four lanes at once, spelled out since LLVM does not find it: a third of the time.
    """

    def codegen(context, builder, sig, args):
        def constant(value):
            return ir.Constant(_LANES, [int(value)] * _DIMENSIONS)

        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        x = ir.Constant(_LANES, [0] * _DIMENSIONS)
        for nibble in range(_NIBBLES):
            value = builder.and_(builder.lshr(args[1], ir.IntType(32)(28 - 4 * nibble)), ir.IntType(32)(15))
            entry = builder.shl(builder.or_(value, ir.IntType(32)(16 * nibble)), ir.IntType(32)(2))
            row = builder.load(builder.bitcast(builder.gep(data, [entry]), _LANES.as_pointer()))
            row.align = 4
            x = builder.xor(x, row)
        first = builder.insert_element(ir.Constant(_LANES, ir.Undefined), args[2], ir.IntType(32)(0))
        seed = builder.shuffle_vector(first, ir.Constant(_LANES, ir.Undefined), constant(0))
        seed = builder.add(seed, ir.Constant(_LANES, [(i + 1) * int(_GOLDEN) % 2**32 for i in range(_DIMENSIONS)]))
        seed = builder.mul(builder.xor(seed, builder.lshr(seed, constant(_SHIFT))), constant(_MIX_1))
        seed = builder.mul(builder.xor(seed, builder.lshr(seed, constant(_FIFTEEN))), constant(_MIX_2))
        seed = builder.xor(seed, builder.lshr(seed, constant(_SHIFT)))
        x = builder.xor(x, builder.mul(x, constant(_SCRAMBLE[0])))
        x = builder.add(x, seed)
        x = builder.mul(x, builder.or_(builder.lshr(seed, constant(16)), constant(1)))
        x = builder.xor(x, builder.mul(x, constant(_SCRAMBLE[1])))
        x = builder.xor(x, builder.mul(x, constant(_SCRAMBLE[2])))
        reverse = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_LANES, [_LANES]), "llvm.bitreverse.v4i32")
        x = builder.call(reverse, [x])
        return context.make_tuple(
            builder, sig.return_type, [builder.extract_element(x, ir.IntType(32)(i)) for i in range(_DIMENSIONS)]
        )

    return types.UniTuple(types.uint32, _DIMENSIONS)(table, types.uint32, types.uint32), codegen


@device
def sobol4(seed, pixel, sample, block):
    """Four uint32, scrambled Sobol' points: dimensions 0 and 1 are a (0, 2)-sequence over the sample numbers."""
    key = _mix(np.uint32(np.uint32(_mix(seed) + np.uint32(block * _GOLDEN)) ^ pixel))
    index = _scramble(_reversed(np.uint32(sample)), key)
    return _points(_TABLE, index, key)


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


@subroutine
def draw1(stream, block):
    """The first number of a block, for what is seldom needed."""
    return draw4(stream, block)[0]


@device
def substream(stream, k, count):
    """The k-th of `count` streams in a sample's place: those of all samples are as even as those of one."""
    return Stream(stream.sampler, stream.seed, stream.pixel, np.uint32(stream.sample * np.uint32(count) + np.uint32(k)))
