"""The number of a slot's process."""

from __future__ import annotations

from billiard import current_process

__all__ = ["slot"]


def slot() -> int:
    """Returns this process's slot: its index in the prefork pool, which a replacement process inherits."""
    return int(getattr(current_process(), "index", 0) or 0)
