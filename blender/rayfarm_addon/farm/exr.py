"""Reads the OpenEXR files that a farm writes, and writes uncompressed ones.

Reads scan lines of float32 or half, uncompressed or with ZIP compression. Blender can load EXR files, but exposes only one layer
of them to Python. Source: "OpenEXR File Layout" and "Technical Introduction to OpenEXR" (openexr.com): the bytes of a block are
split into even and odd ones, and each is stored as the difference from its predecessor.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np
import numpy.typing as npt

__all__ = ["read", "write"]

MAGIC = 20000630
LINES = {0: 1, 2: 1, 3: 16}  # lines per block, by compression: none, ZIPS, ZIP
TYPES = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}


def read(data: bytes) -> dict[str, npt.NDArray[np.float32]]:
    """Returns the image of an EXR file: channel name -> (h, w) float32, rows from the top.

    Raises ValueError if the file is of an unsupported kind.
    """
    try:
        return _read(data)
    except (struct.error, zlib.error, IndexError, KeyError) as error:
        raise ValueError(f"the picture is damaged or of a kind that is not read ({error!r})") from None


def _read(data: bytes) -> dict[str, npt.NDArray[np.float32]]:
    magic, version = struct.unpack_from("<ii", data)
    if magic != MAGIC or version & 0x1A00:
        raise ValueError("this is no plain OpenEXR picture")
    at, attributes = 8, {}
    while data[at]:
        name, at = _text(data, at)
        _, at = _text(data, at)
        (size,) = struct.unpack_from("<i", data, at)
        attributes[name] = data[at + 4 : at + 4 + size]
        at += 4 + size
    channels = _channels(attributes["channels"])
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    compression = attributes["compression"][0]
    width, height, lines = x1 - x0 + 1, y1 - y0 + 1, LINES[compression]
    found = {name: np.zeros((height, width), np.float32) for name, _ in channels}
    blocks = -(-height // lines)
    for (offset,) in struct.iter_unpack("<Q", data[at + 1 : at + 1 + 8 * blocks]):
        y, size = struct.unpack_from("<ii", data, offset)
        rows = min(lines, y1 + 1 - y)
        whole = sum(kind.itemsize for _, kind in channels) * width * rows
        block = data[offset + 8 : offset + 8 + size]
        _copy_rows(_unzipped(block) if compression and size < whole else block, channels, found, y - y0, rows, width)
    return found


def _text(data: bytes, at: int) -> tuple[str, int]:
    end = data.index(b"\0", at)
    return data[at:end].decode("latin-1"), end + 1


def _channels(data: bytes) -> list[tuple[str, np.dtype]]:
    found, at = [], 0
    while data[at]:
        name, at = _text(data, at)
        (kind,) = struct.unpack_from("<i", data, at)
        found.append((name, TYPES[kind]))
        at += 16
    return found


def _unzipped(block: bytes) -> bytes:
    parted = np.frombuffer(zlib.decompress(block), np.uint8).copy()
    parted[1:] += 128  # differences are stored with 128 added
    told = np.cumsum(parted, dtype=np.uint8)
    half = (len(told) + 1) // 2
    whole = np.empty_like(told)
    whole[0::2], whole[1::2] = told[:half], told[half:]
    return whole.tobytes()


def _copy_rows(
    block: bytes,
    channels: list[tuple[str, np.dtype]],
    found: dict[str, npt.NDArray[np.float32]],
    y: int,
    rows: int,
    width: int,
) -> None:
    at = 0
    for row in range(y, y + rows):
        for name, kind in channels:
            found[name][row] = np.frombuffer(block, kind, width, at)
            at += width * kind.itemsize


def write(rgb: npt.NDArray[np.float32]) -> bytes:
    """Returns an image as an EXR file in float32 without compression. rgb: (h, w, 3) linear, rows from the top."""
    height, width, _ = rgb.shape
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channels = b"".join(name + b"\0" + struct.pack("<iiii", 2, 0, 1, 1) for name in (b"B", b"G", b"R")) + b"\0"
    said = [
        (b"channels", b"chlist", channels),
        (b"compression", b"compression", b"\0"),
        (b"dataWindow", b"box2i", box),
        (b"displayWindow", b"box2i", box),
        (b"lineOrder", b"lineOrder", b"\0"),
        (b"pixelAspectRatio", b"float", struct.pack("<f", 1)),
        (b"screenWindowCenter", b"v2f", struct.pack("<ff", 0, 0)),
        (b"screenWindowWidth", b"float", struct.pack("<f", 1)),
    ]
    head = struct.pack("<ii", MAGIC, 2) + b"".join(n + b"\0" + k + b"\0" + struct.pack("<i", len(d)) + d for n, k, d in said)
    line = 12 * width
    first = len(head) + 1 + 8 * height
    table = np.arange(height, dtype="<u8") * (8 + line) + first
    rows = np.zeros(height, np.dtype([("y", "<i4"), ("size", "<i4"), ("light", "<f4", (3, width))]))
    rows["y"], rows["size"] = np.arange(height), line
    rows["light"] = np.moveaxis(np.asarray(rgb, np.float32)[..., ::-1], 2, 1)
    return head + b"\0" + table.tobytes() + rows.tobytes()
