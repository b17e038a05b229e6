"""Validates the workers' reports, and rejects invalid ones.

Reported numbers are shown to users and added to those of other workers, so an invalid one must not break the engine, the list
of workers or a page.
"""

from __future__ import annotations

import json
import math
import unicodedata
from typing import Any

from pydantic import TypeAdapter

from protocol.contract import WorkerReport, worker_key

__all__ = ["is_plain", "report_of"]

MAX_SLOTS = 4096
MAX_REPORT_BYTES = 4 << 20
MAX_NAME_LENGTH = 200
MAX_KIND_LENGTH = 128  # as in a job's row
MAX_TEXT_LENGTH = 4000
MAX_SPEED = 1e12  # samples per second of a slot
MAX_NUMBER = 1e15  # no arithmetic on it overflows
MAX_DEPTH = 4
MAX_CARDS = 64

_REPORT = TypeAdapter(WorkerReport)


def report_of(key: bytes, value: bytes) -> WorkerReport:
    """Parses a worker's report, stored in Redis under `key`. Raises ValueError or RecursionError if it is invalid."""
    if len(value) > MAX_REPORT_BYTES:
        raise ValueError(f"it has {len(value)} bytes")
    if b"NaN" in value or b"Infinity" in value:
        json.loads(value, parse_constant=_reject_constant)
    report = _REPORT.validate_json(value)
    if worker_key(report.name).encode() != key:
        raise ValueError(f"it is said to be of {report.name[:MAX_NAME_LENGTH]!r}")
    if not 0 < len(report.name) <= MAX_NAME_LENGTH or any(unicodedata.category(c) == "Cc" for c in report.name):
        raise ValueError("its name is none")
    if not (0 < report.slots <= MAX_SLOTS and len(report.current) <= MAX_SLOTS):
        raise ValueError(f"{report.slots} slots, of which {len(report.current)} do something")
    if not (0 <= report.samples_per_s <= MAX_SPEED and math.isfinite(report.started) and abs(report.pid) <= MAX_NUMBER):
        raise ValueError(f"{report.samples_per_s} samples a second")
    if len(report.kind) > MAX_KIND_LENGTH or not all(map(is_plain, (report.kind, report.host, report.cpu))):
        raise ValueError("its host, processor or kind is missing")
    if not all(is_plain(doing) for doing in report.current):
        raise ValueError("the activity of its slots is malformed")
    if len(report.cards) > MAX_CARDS or not all(_is_card(card) for card in report.cards):
        raise ValueError("its graphics cards are malformed")
    if len(report.cards_unused) > MAX_CARDS or not all(map(is_plain, report.cards_unused)):
        raise ValueError("the reasons for its unused graphics cards are malformed")
    return report


def _is_card(card: dict[str, Any]) -> bool:
    texts, numbers = (card.get("name"), card.get("capability")), (card.get("number"), card.get("memory"), card.get("slot"))
    speed = card.get("samples_per_s")
    return (
        is_plain(card)
        and all(isinstance(text, str) for text in texts)
        and all(isinstance(number, int) and number >= 0 for number in numbers)
        and isinstance(speed, int | float)
        and 0 <= speed <= MAX_SPEED
    )


def is_plain(value: Any, deepest: int = MAX_DEPTH, longest: int = MAX_TEXT_LENGTH) -> bool:
    """Returns True if a worker's JSON value is safe to use.

    Numbers must be finite, and texts have at most `longest` characters. deepest: maximum number of nesting levels.
    """
    if isinstance(value, str):
        return len(value) <= longest and "\0" not in value
    if isinstance(value, int | float):
        return abs(value) <= MAX_NUMBER  # False for NaN
    if isinstance(value, list | tuple | dict) and deepest > 0:
        inside = [*value, *value.values()] if isinstance(value, dict) else value
        return all(is_plain(each, deepest - 1, longest) for each in inside)
    return value is None


def _reject_constant(constant: str) -> float:
    raise ValueError(f"{constant} is not a number")
