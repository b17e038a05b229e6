"""Converts images from the farm (protocol/) to Blender's form: (h, w, 4) float32 linear, rows from the bottom."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .protocol.pictures import decode_view

__all__ = ["ProgressiveView", "rgba"]

F32 = npt.NDArray[np.float32]


def rgba(rgb: F32) -> F32:
    """Converts (h, w, 3), rows from the top, to Blender's opaque RGBA (h, w, 4), rows from the bottom."""
    found = np.ones((*rgb.shape[:2], 4), np.float32)
    found[..., :3] = rgb[::-1]
    return found


class ProgressiveView:
    """The image of a view, updated by the packets of a viewport's channel. `rgb` is (h, w, 3), rows from the top."""

    def __init__(self) -> None:
        self.id = -1
        self.seq = 0
        self.rgb: F32 = np.zeros((0, 0, 3), np.float32)
        self.whole = (0, 0)

    def add_packet(self, packet: bytes) -> None:
        """Updates the image by a packet. Raises ValueError if the packet is malformed.

        A packet of another view, or of another size, begins a new image. Tiles of the new image that have not arrived yet show
        the old image, scaled.
        """
        head, tiles = decode_view(packet)
        if head.id != self.id or self.rgb.shape[:2] != (head.h, head.w):
            old, self.rgb = self.rgb, np.zeros((head.h, head.w, 3), np.float32)
            if old.size:
                self.rgb[:] = _enlarged(old, head.w, head.h)
        self.id, self.seq, self.whole = head.id, head.seq, (head.whole_w, head.whole_h)
        for tile in tiles:
            x, y, w, h = tile.rect
            self.rgb[y : y + h, x : x + w] = np.moveaxis(tile.mean, 0, -1)


def _enlarged(rgb: F32, w: int, h: int) -> F32:
    rows = np.arange(h) * rgb.shape[0] // h
    columns = np.arange(w) * rgb.shape[1] // w
    return np.asarray(rgb[rows][:, columns], np.float32)
