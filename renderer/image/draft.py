"""Draft of a picture (renderer/kernel/draft.py) as a JPEG."""

from __future__ import annotations

import io

import numpy as np
import numpy.typing as npt
from PIL import Image

__all__ = ["encode_draft"]

QUALITY = 85


def encode_draft(words: npt.NDArray[np.uint32]) -> bytes:
    """Returns a draft, (h, w) uint32, as a JPEG. Runs mostly without the GIL."""
    height, width = words.shape
    out = io.BytesIO()
    picture = Image.frombuffer("RGBX", (width, height), np.ascontiguousarray(words, "<u4").data, "raw", "RGBX", 0, 1)
    picture.save(out, "JPEG", quality=QUALITY, subsampling="4:2:0")
    return out.getvalue()
