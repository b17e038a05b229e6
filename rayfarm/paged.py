"""Fetches complete lists from an API that returns them in pages."""

from __future__ import annotations

from typing import Any

from rayfarm.client import Client

__all__ = ["all_of"]

PAGE = 1000


def all_of(farm: Client, path: str) -> list[dict[str, Any]]:
    """Returns all items of a paginated list. Raises ClientError."""
    found: list[dict[str, Any]] = []
    while True:
        some = farm.call("GET", f"{path}{'&' if '?' in path else '?'}limit={PAGE}&offset={len(found)}")
        found += some
        if len(some) < PAGE:
            return found
