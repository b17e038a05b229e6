"""Terminal output: results on standard output, everything else on standard error."""

from __future__ import annotations

import os
import sys
import time

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

__all__ = ["PROGRAM", "Ticker", "bar", "err", "out"]

# The program's name as typed; set by farm.py if it started this process.
PROGRAM = os.environ.get("RAYFARM_PROGRAM", "rayfarm")

out = Console(highlight=False)
err = Console(stderr=True, highlight=False)


def bar(unit: str = "") -> Progress:
    """A progress bar on standard error; disabled if that is not a terminal."""
    columns = [TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn()]
    if unit:
        columns += [MofNCompleteColumn(), TextColumn(unit)]
    return Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=err, disable=not err.is_terminal)


class Ticker:
    """Progress as plain lines, one every few seconds, for output that is not a terminal."""

    def __init__(self, every_s: float = 5.0) -> None:
        self.every_s = every_s
        self.last = time.monotonic()

    def tick(self, sentence: str) -> None:
        """Prints the sentence if the interval has passed and standard error is not a terminal."""
        now = time.monotonic()
        if not err.is_terminal and now - self.last >= self.every_s:
            self.last = now
            print(sentence, file=sys.stderr, flush=True)
