"""Writes deep pictures: OpenEXR's deep scan lines, compressed line by line (ZIPS).

OpenImageIO's Python module sets the values of a deep picture one by one, which takes minutes for a frame. The format: "OpenEXR
File Layout" and "Interpreting OpenEXR Deep Pixels" (openexr.com).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np

from renderer.deep_samples import CHANNELS, DeepRows

__all__ = ["write_deep"]

_MAGIC, _VERSION, _DEEP = 20000630, 2, 0x800
_FLOAT, _ZIPS, _INCREASING_Y = 2, 2, 0
_REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # primaries and white point
_LEVEL = 4  # of compression


def write_deep(path: Path, bands: Iterable[DeepRows], width: int, height: int, texts: Mapping[str, str] | None = None) -> None:
    """Writes an EXR file from bands of rows, from the top: the whole picture is never in memory.

    texts: further attributes of the header. Raises OSError if the file cannot be written.
    """
    with path.open("wb") as file:
        most_at = _write_header(file, width, height, texts or {})
        table = file.tell()
        file.write(bytes(8 * height))
        offsets, most = [], 0
        for band in bands:
            most = max(most, int(band.count.max(initial=0)))
            ends = np.concatenate([[0], np.cumsum(band.count.sum(axis=1))])
            for row, count in enumerate(band.count):
                offsets.append(file.tell())
                values = band.values[ends[row] : ends[row + 1]]
                counts = _packed(np.cumsum(count).astype("<i4").tobytes())
                raw = np.ascontiguousarray(values.T, "<f4").tobytes()
                data = _packed(raw)
                file.write(struct.pack("<iQQQ", len(offsets) - 1, len(counts), len(data), len(raw)) + counts + data)
        file.seek(table)
        file.write(np.array(offsets, "<u8").tobytes())
        file.seek(most_at)
        file.write(struct.pack("<i", most))


def _write_header(file: BinaryIO, width: int, height: int, texts: Mapping[str, str]) -> int:
    """Writes the header; returns the position of the number of samples in the fullest pixel, which is not known yet."""
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channels = b"".join(name.encode() + struct.pack("<xiB3xii", _FLOAT, 0, 1, 1) for name in CHANNELS) + b"\0"
    attributes = {
        "channels": ("chlist", channels),
        "chromaticities": ("chromaticities", struct.pack("<8f", *_REC709)),
        "chunkCount": ("int", struct.pack("<i", height)),
        "compression": ("compression", bytes([_ZIPS])),
        "dataWindow": ("box2i", window),
        "displayWindow": ("box2i", window),
        "lineOrder": ("lineOrder", bytes([_INCREASING_Y])),
        "pixelAspectRatio": ("float", struct.pack("<f", 1)),
        "screenWindowCenter": ("v2f", struct.pack("<2f", 0, 0)),
        "screenWindowWidth": ("float", struct.pack("<f", 1)),
        "type": ("string", b"deepscanline"),
        "version": ("int", struct.pack("<i", 1)),
        **{name: ("string", text.encode()) for name, text in {"Software": "Rayfarm", **texts}.items()},
        "maxSamplesPerPixel": ("int", bytes(4)),
    }
    file.write(struct.pack("<ii", _MAGIC, _VERSION | _DEEP))
    for name, (kind, value) in attributes.items():
        file.write(name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value)
    position = file.tell() - 4
    file.write(b"\0")
    return position


def _packed(raw: bytes) -> bytes:
    """Returns bytes compressed as by OpenEXR's ZIP; as they are if that is not shorter."""
    data = np.frombuffer(raw, np.uint8)
    split = np.concatenate([data[::2], data[1::2]])
    steps = split.copy()
    steps[1:] = split[1:] - split[:-1] + np.uint8(128)
    found = zlib.compress(steps.tobytes(), _LEVEL)
    return found if len(found) < len(raw) else raw
