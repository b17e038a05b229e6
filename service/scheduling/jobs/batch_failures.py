"""Failures and losses of batches, and their limits."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

__all__ = ["FAILURES_ALLOWED", "LOSSES_ALLOWED", "BatchFailures"]

FAILURES_ALLOWED = 3
LOSSES_ALLOWED = 5


@dataclass
class BatchFailures:
    """Counts of the failures and losses of one batch."""

    since: float = field(default_factory=time.monotonic)
    losses: int = 0
    workers: list[str] = field(default_factory=list)  # workers on which it failed, one entry per failure
    error: str = ""
    reproduce: str | None = None
