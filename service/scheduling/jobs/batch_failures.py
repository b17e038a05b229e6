"""Failures and losses of batches, and how many of them are tolerated."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

__all__ = ["FAILURES_ALLOWED", "LOSSES_ALLOWED", "BatchFailures"]

FAILURES_ALLOWED = 3
LOSSES_ALLOWED = 5


@dataclass
class BatchFailures:
    """Failures and losses of one batch. A loss is a batch whose result never arrived."""

    since: float = field(default_factory=time.monotonic)
    losses: int = 0
    workers: list[str] = field(default_factory=list)  # workers on which it failed, one entry per failure
    error: str = ""
    reproduce: str | None = None
