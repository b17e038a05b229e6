"""Guides as files: one worker trains the guide of an image, and the others read it.

A file has the arrays of `renderer.arrays.guide.Guide` in NumPy's format, one after the other. That of an image whose paths follow
no guide has those of an empty one. Equal guides make equal files.
"""

from __future__ import annotations

import io

import numpy as np

from renderer.arrays.guide import (
    BIN_WIDTH,
    BINS,
    BLOCK_WIDTH,
    CELL_WIDTH,
    CELLS_PER_UNIT,
    COUNT,
    FRAME_COLUMNS,
    MOST_PORTALS,
    PORTAL_COLUMNS,
    PORTAL_RADIUS,
    RADIANCE_COLUMNS,
    SIDES,
    Array,
    Guide,
    empty_guide,
)

__all__ = ["MAX_BYTES", "is_of_use", "read_guide", "write_guide"]

MAX_BYTES = 256 << 20


def is_of_use(guide: Guide) -> bool:
    """Returns True if paths follow the guide; otherwise a film has the same bits without it."""
    return len(guide.portal) > 0 or bool((guide.cell[:, 1] > 0).any())


def write_guide(guide: Guide | None) -> bytes:
    """Returns the file of a guide; None if paths follow none."""
    out = io.BytesIO()
    for array in guide or empty_guide():
        np.save(out, array, allow_pickle=False)
    return out.getvalue()


def read_guide(data: bytes) -> Guide | None:
    """Returns the guide of a file; None if paths follow none. Raises ValueError if kernels must not read it."""
    if len(data) > MAX_BYTES:
        raise ValueError(f"a guide of {len(data)} bytes is too large")
    file = io.BytesIO(data)
    try:
        guide = Guide(*(_array(file) for _ in Guide._fields))
    except (ValueError, EOFError, OSError, SyntaxError, TypeError, OverflowError, MemoryError) as error:
        raise ValueError(f"the file of a guide is damaged ({error})") from error
    if file.read(1) or not _is_sound(guide):
        raise ValueError("the file of a guide is damaged")
    for array in guide:
        array.flags.writeable = False
    return guide if is_of_use(guide) else None


def _array(file: io.BytesIO) -> Array:
    array: Array = np.lib.format.read_array(file, allow_pickle=False)
    return array


def _is_sound(guide: Guide) -> bool:
    """Returns True if the arrays fit each other, so that kernels read no element beyond their ends."""
    if not all(array.dtype == np.float32 and array.flags.c_contiguous and np.isfinite(array).all() for array in guide):
        return False
    frame, cell, cdf, bins, portal, radiance = guide
    if frame.shape != (FRAME_COLUMNS,) or not (frame[CELLS_PER_UNIT:] >= 0).all():
        return False
    counts, blocks = frame[COUNT:].astype(np.float64), cdf.size // BLOCK_WIDTH
    cubes = float(counts.prod())
    has_portals = len(portal) > 0
    shapes = {
        "cell": (SIDES if has_portals else cubes * SIDES, CELL_WIDTH),
        "cdf": (blocks * BLOCK_WIDTH,),
        "bin": (blocks * BINS, BIN_WIDTH),
        "radiance": (cubes if has_portals else 1, RADIANCE_COLUMNS),
    }
    if any(getattr(guide, name).shape != shape for name, shape in shapes.items()) or blocks == 0:
        return False
    if (
        portal.ndim != 2
        or portal.shape[1] != PORTAL_COLUMNS
        or len(portal) > MOST_PORTALS
        or (portal[:, PORTAL_RADIUS] <= 0).any()
    ):
        return False
    blocks_of = np.concatenate((cell[:, 0], bins[:, 1]))
    are_blocks = bool(((blocks_of >= 0) & (blocks_of < blocks) & (blocks_of == np.floor(blocks_of))).all())
    are_counts = bool(((counts >= 1) & (counts == np.floor(counts))).all())
    rows = cdf.reshape(blocks, BLOCK_WIDTH)
    are_parts = bool(
        ((cdf >= 0) & (cdf <= 1)).all() and ((cell[:, 1] >= 0) & (cell[:, 1] <= 1)).all() and (rows[:, -1] == 1).all()
    )
    return are_blocks and are_counts and are_parts and bool((radiance >= 0).all() and (bins[:, 0] >= 0).all())
