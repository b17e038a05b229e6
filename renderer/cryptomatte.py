"""Cryptomatte: counts how many samples of each pixel hit each object and material first, and converts the counts to EXR layers.

The layer of assets is computed from the counts of objects: an asset is an object with its parts and copies, matched by name.

The counts are integers by pixel and id, stored sparsely. They are kept for all ids, so that they can be added in any order; the
number of ids per pixel is limited only when the layers are written. Each sample counts 1, since the pixel filter is sampled, not
weighted (renderer/kernel/sampling/filter.py). The coverage of an id is the number of samples that hit it divided by the number of
all finite samples. A sample that passes through a surface by its alpha counts for the surface that it hits behind.

Layers, hashes and header: Psyop, "Cryptomatte Specification", version 1.2.0 (2018).
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = [
    "KINDS",
    "MOST_RANKS",
    "NOT_FINITE",
    "Hits",
    "asset_of",
    "channel_names",
    "count_samples",
    "hash_of",
    "header",
    "layers",
    "merged",
    "moved",
    "no_hits",
]

F32 = npt.NDArray[np.float32]
U32 = npt.NDArray[np.uint32]

KINDS = ("object", "material")  # of ids that are counted
MOST_RANKS = 16
NOT_FINITE = 0xFFFFFFFF  # in place of the ids of a sample that is not in the film
_LAYER_NAMES = {"object": "CryptoObject", "material": "CryptoMaterial", "asset": "CryptoAsset"}
_COPY = re.compile(r" \[\d+\]$")
_KIND_BIT, _PLACE_BIT = np.uint64(31), np.uint64(32)
_ID_MASK = np.uint64((1 << 31) - 1)


class Hits(NamedTuple):
    """The number of samples of each pixel that hit each id first; only pairs of a pixel and an id that occur.

    key: (n,) uint64, ascending, each once: the pixel's index << 32 | kind (index in KINDS) << 31 | 1 + the number of the object
    or material. count: (n,) int64, at least 1.
    """

    key: npt.NDArray[np.uint64]
    count: npt.NDArray[np.int64]  # type: ignore[assignment]  # hides tuple.count, which is not used


def no_hits() -> Hits:
    """Returns empty counts."""
    return Hits(np.zeros(0, np.uint64), np.zeros(0, np.int64))


def count_samples(ids: U32) -> Hits:
    """Returns the counts of samples. ids: (pixels, samples, 2), 1 + numbers of object and material; 0 for none, or NOT_FINITE."""
    found = []
    for kind in range(len(KINDS)):
        of_kind = ids[:, :, kind]
        if of_kind.shape[1] == 0:
            return no_hits()
        low, high = of_kind.min(axis=1), of_kind.max(axis=1)
        alike = np.flatnonzero((low == high) & (low != 0) & (low != NOT_FINITE))  # most pixels see one object
        found.append(Hits(_keys(alike, kind, low[alike]), np.full(len(alike), of_kind.shape[1], np.int64)))
        mixed = np.flatnonzero(low != high)
        places = np.repeat(mixed, of_kind.shape[1])
        numbers = of_kind[mixed].reshape(-1)
        is_hit = (numbers != 0) & (numbers != NOT_FINITE)
        key, count = np.unique(_keys(places[is_hit], kind, numbers[is_hit]), return_counts=True)
        found.append(Hits(key, count.astype(np.int64)))
    return merged(found)


def _keys(place: npt.NDArray[np.int64], kind: int, number: U32) -> npt.NDArray[np.uint64]:
    return place.astype(np.uint64) << _PLACE_BIT | np.uint64(kind) << _KIND_BIT | number.astype(np.uint64)


def merged(parts: Iterable[Hits]) -> Hits:
    """Returns the sum of several Hits, such as those of different batches; their order has no effect on the result."""
    known = [part for part in parts if len(part.key)]
    if len(known) < 2:
        return known[0] if known else no_hits()
    return _summed(np.concatenate([part.key for part in known]), np.concatenate([part.count for part in known]))


def _summed(keys: npt.NDArray[np.uint64], counts: npt.NDArray[np.int64]) -> Hits:
    """Returns the sums of the counts by key. keys: (n,) in any order, possibly repeated."""
    key, where = np.unique(keys, return_inverse=True)
    count = np.zeros(len(key), np.int64)
    np.add.at(count, where, counts)
    return Hits(key, count)


def moved(hits: Hits, x: int, y: int, width: int, frame_width: int) -> Hits:
    """Converts the counts of a tile from pixel indices in the tile to pixel indices in the frame.

    x, y: the tile's upper left corner in the frame. width, frame_width: widths of the tile and of the frame, in pixels.
    """
    place = (hits.key >> _PLACE_BIT).astype(np.int64)
    in_frame = ((y + place // width) * frame_width + x + place % width).astype(np.uint64)
    return Hits(in_frame << _PLACE_BIT | hits.key & np.uint64(0xFFFFFFFF), hits.count)


def hash_of(name: str) -> int:
    """Returns the id of a name: MurmurHash3_32 of its UTF-8, with one bit inverted if these bits are no normal float32."""
    found = _murmur3(name.encode())
    exponent = found >> 23 & 255
    return found ^ 1 << 23 if exponent in (0, 255) else found


def _murmur3(data: bytes) -> int:
    """Returns MurmurHash3_x86_32 of the bytes, with seed 0 (Appleby, public domain)."""
    found = 0
    end = len(data) & ~3
    for start in range(0, end, 4):
        found ^= _mix_word(int.from_bytes(data[start : start + 4], "little"))
        found = (_rotate_left(found, 13) * 5 + 0xE6546B64) & 0xFFFFFFFF
    if len(data) > end:
        found ^= _mix_word(int.from_bytes(data[end:], "little"))
    found ^= len(data)
    found = (found ^ found >> 16) * 0x85EBCA6B & 0xFFFFFFFF
    found = (found ^ found >> 13) * 0xC2B2AE35 & 0xFFFFFFFF
    return found ^ found >> 16


def _mix_word(word: int) -> int:
    return _rotate_left(word * 0xCC9E2D51 & 0xFFFFFFFF, 15) * 0x1B873593 & 0xFFFFFFFF


def _rotate_left(word: int, bits: int) -> int:
    return (word << bits | word >> (32 - bits)) & 0xFFFFFFFF


def channel_names(ranks: int) -> tuple[str, ...]:
    """Returns the names of the channels of `layers` in an EXR."""
    return tuple(
        f"{_LAYER_NAMES[kind]}{i:02}.{c}" for kind in _LAYER_NAMES for i in range(_number_of_layers(ranks)) for c in "RGBA"
    )


def _number_of_layers(ranks: int) -> int:
    """Returns the number of layers that hold `ranks` ids per pixel, two in each layer."""
    return -(-ranks // 2)


def _names(numbers: Iterable[int], names: Sequence[str], kind: str) -> list[str]:
    """Returns the names of objects or materials, given by number; for those without a name, `kind` and the number."""
    return [names[k] if k < len(names) and names[k] else f"{kind} {k}" for k in numbers]


def asset_of(name: str) -> str:
    """Returns the name of the asset that an object belongs to: an object with all its parts (cup/handle) and copies (cup [2])."""
    return _COPY.sub("", name.partition("/")[0]) or name


def _layer_names(numbers: Iterable[int], names: Mapping[str, Sequence[str]], layer: str) -> list[str]:
    """Returns the names of the ids of a layer, one for each number of an object or material."""
    kind = "object" if layer == "asset" else layer
    found = _names(numbers, names.get(f"{kind}s", ()), kind)
    return [asset_of(name) for name in found] if layer == "asset" else found


def header(names: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Returns the attributes of an EXR's header. names: of objects and materials, by the keys `objects` and `materials`."""
    found: dict[str, str] = {}
    for layer, layer_name in _LAYER_NAMES.items():
        known = names.get("materials" if layer == "material" else "objects", ())
        manifest = {name: f"{hash_of(name):08x}" for name in _layer_names(range(len(known)), names, layer)}
        key = f"cryptomatte/{_murmur3(layer_name.encode()):08x}"[: len("cryptomatte/") + 7]
        found |= {
            f"{key}/name": layer_name,
            f"{key}/hash": "MurmurHash3_32",
            f"{key}/conversion": "uint32_to_float32",
            f"{key}/manifest": json.dumps(manifest, ensure_ascii=False, separators=(",", ":")),
        }
    return found


def layers(hits: Hits, samples: npt.NDArray[np.int64], ranks: int, names: Mapping[str, Sequence[str]]) -> F32:
    """Returns the layers of an image, (h, w, channels) float32, in the order of `channel_names`: pairs of an id and its coverage.

    hits: pixels row by row. samples: (h, w), of the film. ranks: ids per pixel, those with the most samples; of equal ones the
    lower id comes first. names: as for `header`; ids of equal names are one.
    """
    height, width = samples.shape
    pairs = _number_of_layers(ranks)
    found = np.zeros((len(_LAYER_NAMES), height * width, 2 * pairs, 2), np.float32)
    total = np.maximum(samples.reshape(-1), 1).astype(np.float64)
    for layer, layer_kind in enumerate(_LAYER_NAMES):
        of_kind = (hits.key >> _KIND_BIT & np.uint64(1)) == KINDS.index("material" if layer_kind == "material" else "object")
        place = (hits.key[of_kind] >> _PLACE_BIT).astype(np.int64)
        number = (hits.key[of_kind] & _ID_MASK).astype(np.int64) - 1
        occurring, which = np.unique(number, return_inverse=True)
        hashes = np.array([hash_of(name) for name in _layer_names(occurring.tolist(), names, layer_kind)], np.uint64)
        key, count = _summed(place.astype(np.uint64) << _PLACE_BIT | hashes[which], hits.count[of_kind])
        place, ids = (key >> _PLACE_BIT).astype(np.int64), (key & np.uint64(0xFFFFFFFF)).astype(np.uint32)
        order = np.lexsort((ids, -count, place))
        place, ids, count = place[order], ids[order], count[order]
        rank = np.arange(len(place)) - np.searchsorted(place, place, "left")
        is_kept = rank < ranks
        place, rank = place[is_kept], rank[is_kept]
        found[layer, place, rank, 0] = ids[is_kept].view(np.float32)
        found[layer, place, rank, 1] = count[is_kept] / total[place]
    return np.moveaxis(found, 0, 1).reshape(height, width, -1)
