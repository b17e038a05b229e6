"""Encodes which workers rendered how many samples of a film row.

The text is a JSON list with the name of one worker, which rendered all of the row's samples, or a JSON object from names to
numbers of samples. Films of versions before 4 have lists of several names, whose numbers are unknown.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

__all__ = ["ANY_WORKER", "added_shares", "senders_of", "senders_text", "shares_of"]

MAX_NAMES = 64  # with more workers than this, the row stands for any worker
ANY_WORKER = "*"


class _AllNames(frozenset[str]):
    def __contains__(self, name: object) -> bool:
        return True


def senders_text(shares: Mapping[str, int]) -> str | None:
    """Encodes the number of samples by worker for a film row. Returns None if no worker's name is known."""
    known = {name: shares[name] for name in sorted(shares) if name}
    if not known:
        return None
    if len(known) > MAX_NAMES or ANY_WORKER in known:
        return json.dumps([ANY_WORKER])
    return json.dumps(known if len(known) > 1 or len(shares) > 1 else [*known])


def senders_of(text: str | None) -> frozenset[str]:
    """Decodes the worker names of a film row. A row marked ANY_WORKER gives a set that contains every name."""
    found = _decoded(text)
    names = frozenset(str(name) for name in found) if isinstance(found, list | dict) else frozenset()
    return _AllNames(names) if ANY_WORKER in names else names


def shares_of(text: str | None, count: int) -> dict[str, int]:
    """Decodes the number of samples by worker of a film row with `count` samples per pixel.

    The sum is less than `count` if the numbers of some workers are unknown; these have 0.
    """
    found = _decoded(text)
    if isinstance(found, dict):
        return {str(name): samples if isinstance(samples, int) else 0 for name, samples in found.items()}
    names = [str(name) for name in found] if isinstance(found, list) else []
    return {name: count if len(names) == 1 else 0 for name in names}


def added_shares(each: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """Returns the sum of several numbers of samples by worker."""
    total: Counter[str] = Counter()
    for shares in each:
        total.update(shares)
    return dict(total)


def _decoded(text: str | None) -> Any:
    try:
        return json.loads(text) if text else None
    except ValueError:
        return None
