"""Limit on the total memory of all live views, at 52 bytes per pixel."""

from __future__ import annotations

from collections.abc import Iterable

from renderer.sentences import Sentence
from service.viewing.session import ViewSession

__all__ = ["MAX_PIXELS", "MEMORY_LIMIT_REACHED", "fits_in_memory"]

MAX_PIXELS = 1 << 24  # about 1 GB
MEMORY_LIMIT_REACHED = Sentence(
    "view-slots-exhausted", "There are too many live views at the moment. Yours starts when another one ends."
)


def fits_in_memory(pixels: int, sessions: Iterable[ViewSession]) -> bool:
    """Returns True if another view of this many pixels fits into the memory limit.

    If it does not, discards the pictures of paused sessions, which are rendered again on resumption, until it fits.
    """
    room = MAX_PIXELS - pixels - sum(session.pixels for session in sessions)
    for session in sessions:
        if room >= 0:
            break
        if session.is_paused and session.pixels:
            room += session.pixels
            session.restart()
    return room >= 0
