"""Reads grids of heterogeneous media: numpy's .npy files, and Mitsuba's .vol files."""

from __future__ import annotations

import io
import struct
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.description import F32
from renderer.scene.volumes import MOST_VOXELS
from renderer.sentences import Sentence

__all__ = ["read_volume", "vol_bounds"]

_NPY, _VOL = b"\x93NUMPY", b"VOL"
_VOL_HEADER = 48  # bytes
_VOL_TYPES = {1: "<f4", 2: "<f2", 3: "|u1", 4: "<f8"}  # of version 3


def read_volume(data: bytes, name: str) -> F32:
    """Returns the grid of a file, (nz, ny, nx) float32.

    data: of a .npy file, a real array indexed [x, y, z], or of a .vol file of one channel. name: of the file. Raises SceneError
    if the file is damaged, has another shape or type, or is too large.
    """
    if data.startswith(_NPY):
        return _as_grid(_read_npy(data, name).transpose(2, 1, 0))
    if data.startswith(_VOL):
        return _as_grid(_read_vol(data, name))
    raise SceneError(
        Sentence(
            "volume-file-format-unknown", "{name} is not a volume; a numpy file (.npy) or a Mitsuba volume (.vol) is", name=name
        )
    )


def vol_bounds(data: bytes) -> npt.NDArray[Any]:
    """Returns the transform from the unit cube to the bounds that a .vol file states, (4, 4); the identity for other files."""
    place = np.eye(4)
    if data.startswith(_VOL) and len(data) >= _VOL_HEADER:
        corners = np.array(struct.unpack_from("<6f", data, 24), np.float64).reshape(2, 3)
        place[[0, 1, 2], [0, 1, 2]] = corners[1] - corners[0]
        place[:3, 3] = corners[0]
    return place


def _as_grid(values: npt.NDArray[Any]) -> F32:
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(values, np.float32)


def _damaged(name: str) -> SceneError:
    return SceneError(Sentence("volume-file-damaged", "{name} is damaged or incomplete; write it again", name=name))


def _check_size(count: int, name: str) -> None:
    if count > MOST_VOXELS:
        raise SceneError(
            Sentence(
                "volume-file-too-large",
                "{name} has {count} voxels; at most {most} are supported. Reduce its resolution",
                name=name,
                count=count,
                most=MOST_VOXELS,
            )
        )


def _read_npy(data: bytes, name: str) -> npt.NDArray[Any]:
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, is_fortran, dtype = read(stream)
    except (ValueError, EOFError, struct.error) as error:
        raise _damaged(name) from error
    if dtype.kind not in "fiu" or len(shape) != 3 or min(shape) < 1:
        raise SceneError(
            Sentence(
                "volume-array-unsuitable",
                "{name} holds {dtype} of the shape {shape}; a volume is an array of numbers with three axes, x, y and z",
                name=name,
                dtype=str(dtype)[:40],
                shape=list(shape),
            )
        )
    count = int(np.prod(shape, dtype=object))
    _check_size(count, name)
    if len(data) - stream.tell() != count * dtype.itemsize:
        raise _damaged(name)
    values = np.frombuffer(data, dtype, count, stream.tell())
    return values.reshape(shape, order="F" if is_fortran else "C")


def _read_vol(data: bytes, name: str) -> npt.NDArray[Any]:
    if len(data) < _VOL_HEADER:
        raise _damaged(name)
    version, (encoding, nx, ny, nz, channels) = data[3], struct.unpack_from("<5i", data, 4)
    if version != 3 or encoding not in _VOL_TYPES or channels != 1 or min(nx, ny, nz) < 1:
        raise SceneError(
            Sentence(
                "volume-vol-unsupported",
                "{name}: version {version}, encoding {encoding} and {channels} channels; only version 3 with one channel of "
                "numbers is supported",
                name=name,
                version=version,
                encoding=encoding,
                channels=channels,
            )
        )
    count, dtype = nx * ny * nz, np.dtype(_VOL_TYPES[encoding])
    _check_size(count, name)
    if len(data) - _VOL_HEADER != count * dtype.itemsize:
        raise _damaged(name)
    values: npt.NDArray[Any] = np.frombuffer(data, dtype, count, _VOL_HEADER).reshape(nz, ny, nx)
    return values / np.float32(255) if encoding == 3 else values
