"""How many views fit into memory at a time: 52 bytes a pixel each, for as long as somebody looks."""

from __future__ import annotations

from collections.abc import Iterable

from service.viewing.watch import Watch

__all__ = ["FULL", "MOST_TOGETHER", "has_room"]

MOST_TOGETHER = 1 << 24  # pixels, about 1 GB
FULL = "So many look at scenes now that another view has no room. It comes when one of them leaves."


def has_room(pixels: int, watches: Iterable[Watch]) -> bool:
    """Whether another view of this size fits beside theirs. Pages that nobody sees give theirs up for it, and begin again."""
    room = MOST_TOGETHER - pixels - sum(watch.pixels for watch in watches)
    for watch in watches:
        if room >= 0:
            break
        if watch.is_paused and watch.pixels:
            room += watch.pixels
            watch.begin_again()
    return room >= 0
