"""The number of the slot that this process is."""

from __future__ import annotations

from billiard import current_process

__all__ = ["slot"]


def slot() -> int:
    """Returns this process's slot: its index in the prefork pool. A replacement process inherits the index."""
    return int(getattr(current_process(), "index", 0) or 0)
