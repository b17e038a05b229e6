"""Encodes the names of the workers whose sums a film row contains."""

from __future__ import annotations

import json
from collections.abc import Collection
from typing import Any

__all__ = ["senders_of", "senders_text"]

MAX_NAMES = 64  # with more workers than this, the row stands for any worker
ANY_WORKER = "*"


class _AllNames(frozenset[str]):
    def __contains__(self, name: object) -> bool:
        return True


def senders_text(names: Collection[str]) -> str | None:
    """Encodes worker names for a film row. Returns None if no name is known."""
    known = sorted({name for name in names if name})
    if not known:
        return None
    return json.dumps(known if len(known) <= MAX_NAMES and ANY_WORKER not in known else [ANY_WORKER])


def senders_of(text: str | None) -> frozenset[str]:
    """Decodes the worker names of a film row. A row marked ANY_WORKER gives a set that contains every name."""
    try:
        found: Any = json.loads(text) if text else []
    except ValueError:
        found = []
    names = frozenset(str(name) for name in found) if isinstance(found, list) else frozenset()
    return _AllNames(names) if ANY_WORKER in names else names
