"""The first four dimensions of the Sobol' sequence, scrambled and shifted, for one index or for eight.

Random scrambling puts each point at random within its elementary cell, which suits smooth integrands. Lighting is not smooth:
shadows have edges, and many details are as fine as the spacing of the points. For such integrands the relative position of
neighbouring points matters. Therefore one linear scrambling with good relative positions is fixed (docs/speed-notes.md, "Points
that fit together"), and the randomisation is a digital shift, which preserves the relative positions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from renderer.bvh.simd import LANES
from renderer.jit import HAS_AVX512, TARGET
from renderer.wide.operators import INTS, is_wide, u32x8

__all__ = ["GOLDEN", "MIX_1", "MIX_2", "SCRAMBLE", "TABLE", "direction_numbers", "points"]

MIX_1 = np.uint32(0x7FEB352D)
MIX_2 = np.uint32(0x846CA68B)
GOLDEN = np.uint32(0x9E3779B9)
SCRAMBLE = tuple(np.uint32(c) for c in (0x3D20ADEA, 0x05526C56, 0x53A22864))
_BITS = 28  # of the sample number: more than MAX_SPP times MAX_LIGHT_SAMPLES
_NIBBLES, _TRIPLES = 7, 10
_DIMENSIONS = 4
_LINEAR = 1064  # best of some seven thousand scramblings at resolving edges and grain
_I32 = ir.IntType(32)
_QUARTET = ir.VectorType(_I32, _DIMENSIONS)


def direction_numbers() -> np.ndarray:
    """Returns the columns of the Sobol' generator matrices, (4, 32) uint32, most significant bit first.

    Source: Joe & Kuo 2008, new-joe-kuo-6. Column k is added, by exclusive or, if bit k of the index is set.
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


def _mixed(x: int) -> int:
    """Returns the hash `_mix` of sampler.py for a Python integer."""
    x = (x ^ x >> 16) * int(MIX_1) % 2**32
    x = (x ^ x >> 15) * int(MIX_2) % 2**32
    return x ^ x >> 16


def _scrambled(columns: np.ndarray) -> np.ndarray:
    """Returns linearly scrambled generator matrices, (4, 32) uint32, of a sequence with the same stratification.

    Each binary digit of a number has a fixed set of earlier digits added to it (Matousek's linear scrambling, 1998).
    """
    made = np.zeros_like(columns)
    for dimension in range(_DIMENSIONS):
        for digit in range(32):
            own = 1 << (31 - digit)
            before = _mixed(_mixed(_LINEAR) + (32 * dimension + digit) * int(GOLDEN) & 0xFFFFFFFF) & -2 * own
            for k in range(32):
                if (int(columns[dimension, k]) & (own | before)).bit_count() & 1:
                    made[dimension, k] |= np.uint32(own)
    return made


_COLUMNS = _scrambled(direction_numbers())
_COLUMNS[:, _BITS:] = 0


def _digit_table(bits: int, digits: int) -> np.ndarray:
    """Returns what each value of each digit of a sample index contributes to the point's four dimensions.

    Shape (digits, 2**bits, 4), uint32. A digit is a group of `bits` bits of the index, read in reverse order: digit 0 has the
    lowest bits of the index, with the lowest one uppermost.
    """
    table = np.zeros((digits, 2**bits, _DIMENSIONS), np.uint32)
    for digit in range(digits):
        for value in range(2**bits):
            for bit in range(bits):
                if value >> (bits - 1 - bit) & 1:
                    table[digit, value] ^= _COLUMNS[:, bits * digit + bit]
    return table


TABLE = _digit_table(4, _NIBBLES).reshape(-1, _DIMENSIONS)
_TRIPLE_TABLE = _digit_table(3, _TRIPLES)


def _vector(kind: Any, values: Any) -> Any:
    return ir.Constant(kind, [int(value) for value in values])


def _shifted(builder: Any, x: Any, seed: Any) -> Any:
    """Emits code for the digital shift of a point: x xor `_mix(seed)` (sampler.py), for vectors of any length."""

    def constant(value: Any) -> Any:
        return _vector(x.type, [value] * x.type.count)

    seed = builder.mul(builder.xor(seed, builder.lshr(seed, constant(16))), constant(MIX_1))
    seed = builder.mul(builder.xor(seed, builder.lshr(seed, constant(15))), constant(MIX_2))
    return builder.xor(x, builder.xor(seed, builder.lshr(seed, constant(16))))


def _look_up_digits(builder: Any, data: Any, index: Any) -> Any:
    """Emits code for the four dimensions of the Sobol' point at one index, as a vector, by the table of 4-bit digits."""
    x = _vector(_QUARTET, [0] * _DIMENSIONS)
    for nibble in range(_NIBBLES):
        value = builder.and_(builder.lshr(index, _I32(28 - 4 * nibble)), _I32(15))
        entry = builder.shl(builder.or_(value, _I32(16 * nibble)), _I32(2))
        row = builder.load(builder.bitcast(builder.gep(data, [entry]), _QUARTET.as_pointer()))
        row.align = 4
        x = builder.xor(x, row)
    return x


def _permuted(builder: Any, index: Any, dimension: int) -> Any:
    """Emits code for one dimension of the Sobol' points at eight indices.

    Looks up three bits at a time in a table in a register (AVX2's vpermd).
    """
    permute = cgutils.get_or_insert_function(builder.module, ir.FunctionType(INTS, [INTS, INTS]), "llvm.x86.avx2.permd")
    x = _vector(INTS, [0] * LANES)
    for triple in range(_TRIPLES):
        shift = 29 - 3 * triple
        amount = _vector(INTS, [abs(shift)] * LANES)
        place = builder.lshr(index, amount) if shift >= 0 else builder.shl(index, amount)
        x = builder.xor(x, builder.call(permute, [_vector(INTS, _TRIPLE_TABLE[triple, :, dimension]), place]))
    return x


def _matrices(dimension: int, turned: int) -> list[int]:
    """Returns the four 8x8 bit matrices that map each byte of the index to the byte of the point `turned` places below it.

    Format of vgf2p8affineqb: the row of the uppermost bit is lowest.
    """
    made = []
    for byte in range(4):
        rows = [0] * 8
        for bit in range(8):
            column = int(_COLUMNS[dimension, 31 - (8 * ((byte + turned) % 4) + bit)]) >> 8 * byte
            for k in range(8):
                rows[7 - k] |= (column >> k & 1) << bit
        made.append(int.from_bytes(bytes(rows), "little"))
    return made


def _multiplied(builder: Any, index: Any) -> list[Any]:
    """Emits code for the four dimensions of the Sobol' points at eight indices.

    Multiplies the indices by the generator matrices, byte by byte (AVX-512's GFNI).
    """
    bytes_, words = ir.VectorType(ir.IntType(8), 4 * LANES), ir.VectorType(ir.IntType(64), 4)
    kind = ir.FunctionType(bytes_, [bytes_, bytes_, ir.IntType(8)])
    multiply = cgutils.get_or_insert_function(builder.module, kind, "llvm.x86.vgf2p8affineqb.256")

    def shuffled(vector: Any, order: list[int]) -> Any:
        return builder.shuffle_vector(vector, vector, _vector(ir.VectorType(_I32, len(order)), order))

    apart = shuffled(builder.bitcast(index, bytes_), [4 * lane + byte for byte in range(4) for lane in range(LANES)])
    turns = [shuffled(builder.bitcast(apart, words), [(byte + turned) % 4 for byte in range(4)]) for turned in range(4)]
    dimensions = []
    for dimension in range(_DIMENSIONS):
        x = _vector(bytes_, [0] * bytes_.count)
        for turned, turn in enumerate(turns):
            matrices = builder.bitcast(_vector(words, _matrices(dimension, turned)), bytes_)
            x = builder.xor(x, builder.call(multiply, [builder.bitcast(turn, bytes_), matrices, ir.IntType(8)(0)]))
        together = shuffled(x, [LANES * byte + lane for lane in range(LANES) for byte in range(4)])
        dimensions.append(builder.bitcast(together, INTS))
    return dimensions


def _points_per_lane(builder: Any, data: Any, index: Any) -> list[Any]:
    """Emits code for the four dimensions of the Sobol' points at eight indices, one lane at a time.

    For processors without AVX2 and GFNI.
    """
    columns = [ir.Constant(INTS, ir.Undefined)] * _DIMENSIONS
    for lane in range(LANES):
        row = _look_up_digits(builder, data, builder.extract_element(index, _I32(lane)))
        for k in range(_DIMENSIONS):
            columns[k] = builder.insert_element(columns[k], builder.extract_element(row, _I32(k)), _I32(lane))
    return columns


@intrinsic
def points(typingctx, table, index, key):
    """Returns point `index` (bits reversed) of the sequence, each dimension shifted by the hash `_mix` of the key plus an offset.

    The result is four uint32, or four u32x8 for eight indices and keys. table: TABLE. `_mix` is computed for four dimensions at
    once in explicit vectors, which takes a third of the time, since LLVM does not vectorise it.
    """
    far = [(i + 1) * int(GOLDEN) % 2**32 for i in range(_DIMENSIONS)]

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        if is_wide(sig.args[1]):
            if HAS_AVX512:
                plain = _multiplied(builder, args[1])
            elif TARGET.startswith("x86"):
                plain = [_permuted(builder, args[1], k) for k in range(_DIMENSIONS)]
            else:
                plain = _points_per_lane(builder, data, args[1])
            seeds = [builder.add(args[2], _vector(INTS, [offset] * LANES)) for offset in far]
            return context.make_tuple(
                builder, sig.return_type, [_shifted(builder, x, seed) for x, seed in zip(plain, seeds, strict=True)]
            )
        first = builder.insert_element(ir.Constant(_QUARTET, ir.Undefined), args[2], _I32(0))
        seed = builder.shuffle_vector(first, ir.Constant(_QUARTET, ir.Undefined), _vector(_QUARTET, [0] * _DIMENSIONS))
        x = _shifted(builder, _look_up_digits(builder, data, args[1]), builder.add(seed, _vector(_QUARTET, far)))
        return context.make_tuple(builder, sig.return_type, [builder.extract_element(x, _I32(i)) for i in range(_DIMENSIONS)])

    number = u32x8 if is_wide(index) else types.uint32
    return types.UniTuple(number, _DIMENSIONS)(table, number, number), codegen
