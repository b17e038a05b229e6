"""Packet of a display view as a 3D table, by which the page shows it. Little-endian."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
import numpy.typing as npt

from protocol.layout import U16, Layout

__all__ = ["VIEW_TABLE", "ViewTableHead", "encode_view_table"]


class ViewTableHead(NamedTuple):
    """The head of a display view's table.

    size^3 u32 follow, red fastest, then green: encoded red in the lowest 10 bits, then green, then blue. The points of an axis
    are at the radiance (2 ** (16 i / (size - 1)) - 1) / 255, i = 0 ... size - 1.
    """

    size: Annotated[int, U16, "points an axis"]


VIEW_TABLE = Layout("view table", ViewTableHead, version=1, kind=5)


def encode_view_table(words: npt.NDArray[np.uint32]) -> bytes:
    """Encodes a table, (size, size, size) uint32, as a packet."""
    return VIEW_TABLE.pack(ViewTableHead(len(words))) + words.astype("<u4").tobytes()
