"""What happened to a batch that did not succeed, and how often that may be."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

__all__ = ["FAILURES_ALLOWED", "LOSSES_ALLOWED", "Trouble"]

FAILURES_ALLOWED = 3
LOSSES_ALLOWED = 5


@dataclass
class Trouble:
    """Of one batch."""

    since: float = field(default_factory=time.monotonic)
    losses: int = 0
    workers: list[str] = field(default_factory=list)  # on which it failed, one entry a failure
    error: str = ""
    reproduce: str | None = None
