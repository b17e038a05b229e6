"""A frame as the bytes of a picture file: colour or denoised colour, one of the planes beside it, or all of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from renderer import aovs
from renderer import film as film_math
from renderer.image import rgbe9995, tonemap
from renderer.image.encode import encode, encode_shown
from service.errors import Invalid
from service.store.films import Film

__all__ = ["MEDIA", "PictureWish", "picture"]

F32 = npt.NDArray[np.float32]
ROWS = 64  # at a time, of a denoised picture
MEDIA = {
    "png": "image/png",
    "jpg": "image/jpeg",
    "exr": "image/x-exr",
    "hdr": "image/vnd.radiance",
    "rgb9e5": "application/octet-stream",
}


@dataclass(frozen=True)
class PictureWish:
    """What a reader asks for.

    planes: AOVs by name, none for colour. in_layers: as layers beside the colour, else the one plane alone.
    denoised: opens the colour to take instead.
    """

    extension: str
    planes: tuple[str, ...] = ()
    in_layers: bool = False
    exposure: float = 0.0
    curve: str = "neutral"
    width: int | None = None
    denoised: Callable[[], BinaryIO] | None = None

    def check(self) -> None:
        """Raise Invalid for a wish that no file fulfils."""
        if self.in_layers and self.extension != "exr":
            raise Invalid(f"aov: a .{self.extension} holds one plane; ask for one, or for image.exr.")
        if self.planes and self.extension == "rgb9e5":
            raise Invalid("aov: rgb9e5 holds colour alone; ask for image.exr or image.png.")


def picture(film: Film, frame: int, wish: PictureWish) -> bytes:
    """The file."""
    if wish.planes and not wish.in_layers:
        return _plane(film, frame, wish, wish.planes[0])
    if wish.extension in ("png", "jpg") and wish.width is None:
        return encode_shown(_shown(film, frame, wish), wish.extension)
    color = _smaller(_color(film, frame, wish.denoised), wish.width)
    if wish.extension == "rgb9e5":
        return rgbe9995.pack(color).astype("<u4").tobytes()
    channels = aovs.layers({name: _smaller(film.aov(frame, name), wish.width) for name in wish.planes})
    return encode(color, wish.extension, wish.exposure, wish.curve, channels)


def _shown(film: Film, frame: int, wish: PictureWish) -> npt.NDArray[np.uint8]:
    """What a screen shows, piece by piece: the whole frame's radiance is never in memory, which would be many times as large."""
    out = np.zeros((film.height, film.width, 3), np.uint8)
    if wish.denoised is None:
        return film.each(
            frame, lambda sums: tonemap.apply(film_math.mean(sums, film.film_exponent), wish.exposure, wish.curve), out
        )
    with wish.denoised() as file:
        for rows in np.array_split(out, -(-film.height // ROWS)):
            color = np.frombuffer(file.read(rows.size * 4), "<f4").reshape(rows.shape)
            rows[:] = tonemap.apply(color, wish.exposure, wish.curve)
    return out


def _color(film: Film, frame: int, denoised: Callable[[], BinaryIO] | None) -> F32:
    if denoised is None:
        return film.channel(frame)
    with denoised() as file:
        return np.frombuffer(file.read(), "<f4").reshape(film.height, film.width, 3)


def _plane(film: Film, frame: int, wish: PictureWish, name: str) -> bytes:
    plane = film.aov(frame, name)
    if wish.extension in ("png", "jpg"):
        return encode_shown(_smaller(aovs.visible(name, plane), wish.width), wish.extension)
    values = _smaller(plane, wish.width)
    return encode(values if values.ndim == 3 else np.repeat(values[..., None], 3, axis=2), wish.extension)


def _smaller(values: npt.NDArray, width: int | None) -> npt.NDArray:
    """The (h, w, ...) picture averaged over squares of whole pixels, so that it is at least `width` wide; what is left over
    at the right and lower edges of the last squares is cut off."""
    side = min(values.shape[1] // (width or values.shape[1]), values.shape[0])
    if side <= 1:
        return values
    h, w = values.shape[0] // side, values.shape[1] // side
    squares = values[: h * side, : w * side].reshape(h, side, w, side, *values.shape[2:])
    return squares.mean(axis=(1, 3), dtype=np.float32).astype(values.dtype)
