"""Who sent a row of a film: the workers whose sums are in it, as the row keeps their names."""

from __future__ import annotations

import json
from collections.abc import Collection

__all__ = ["senders_of", "senders_text"]

MOST = 64  # of more, the row says that it may be anybody
ANYBODY = "*"


class _Everybody(frozenset[str]):
    def __contains__(self, name: object) -> bool:
        return True


def senders_text(names: Collection[str]) -> str | None:
    """For the row; None where nobody knows."""
    known = sorted({name for name in names if name})
    if not known:
        return None
    return json.dumps(known if len(known) <= MOST and ANYBODY not in known else [ANYBODY])


def senders_of(text: str | None) -> frozenset[str]:
    """From the row; where that says anybody, all names are in it."""
    try:
        found = json.loads(text) if text else []
    except ValueError:
        found = []
    names = frozenset(str(name) for name in found) if isinstance(found, list) else frozenset()
    return _Everybody(names) if ANYBODY in names else names
