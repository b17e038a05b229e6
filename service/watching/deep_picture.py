"""The deep picture of a frame as an EXR file."""

from __future__ import annotations

from pathlib import Path

from renderer.deep import SUMS
from renderer.film import plane_count
from service.store.bands import deep_bands
from service.store.films import Film
from service.watching.picture_response import PictureBody

__all__ = ["deep_picture", "deep_picture_memory"]


def deep_picture(film: Film, frame: int, folder: Path) -> PictureBody:
    """Returns the deep EXR file of a frame. frame: its key. folder: for temporary files.

    The film may grow meanwhile: the file shows it as it was at the beginning.
    """
    from renderer.image.deep_exr import write_deep  # imported only if needed

    with film.snapshot() as moment:
        return PictureBody.from_writer(
            lambda path: write_deep(path, deep_bands(moment, frame), film.width, film.height), folder, ".exr"
        )


def deep_picture_memory(film: Film) -> int:
    """Returns the estimated peak memory of `deep_picture`, in bytes."""
    pixels = film.width * film.tiles[0].h
    return pixels * (8 * plane_count(len(film.groups), film.is_transparent) + 3 * 8 * (SUMS + 3) * film.deep)
