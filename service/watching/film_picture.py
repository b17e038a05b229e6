"""Picture files made from a stored packet (film_packet.py), for frames whose film was deleted."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from protocol.pictures import decode_film
from renderer.image import rgbe9995
from renderer.image.tonemap import Curve
from renderer.sentences import Sentence
from service.errors import Failed
from service.watching.film_packet import GZIP
from service.watching.picture_response import PictureBody

__all__ = ["film_picture", "film_picture_memory", "radiance_of"]


def radiance_of(packed: Iterable[bytes]) -> npt.NDArray[np.float32]:
    """Returns the radiance in a gzip-compressed packet, shape (h, w, 3). Raises Failed if the packet is damaged."""
    try:
        data = zlib.decompress(b"".join(packed), GZIP)
        words = decode_film(data).words
    except (zlib.error, ValueError) as error:
        raise Failed(
            Sentence(
                "picture-snapshot-damaged",
                "The stored copy of this picture is damaged ({error}). Render it again, or upload it again.",
                error=error,
            )
        ) from error
    return rgbe9995.unpack(words)


def film_picture(packed: Iterable[bytes], extension: str, exposure: float, curve: Curve, folder: Path) -> PictureBody:
    """Returns a picture file made from a gzip-compressed packet.

    extension: the file format. exposure: in stops. curve: the tone curve. folder: for temporary files.
    """
    from renderer.image.encode import encode  # imported only if needed: OpenImageIO is large

    return PictureBody.from_bytes(encode(radiance_of(packed), extension, exposure, curve), folder)


def film_picture_memory(width: int, height: int) -> int:
    """Returns the estimated peak memory of `film_picture` at this size, in bytes."""
    return 48 * width * height
