"""Terminal output: results to standard output, everything else to standard error."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.segment import Segment
from rich.text import Text

from renderer.printable import printable

__all__ = ["PROGRAM", "PlainConsole", "PlainProgress", "bar", "err", "out"]

# The program's name as typed; set by farm.py if it started this process.
PROGRAM = os.environ.get("RAYFARM_PROGRAM", "rayfarm")


class PlainConsole(Console):
    """A rich console that prints control characters in texts as escapes; only rich's own styles and movements are sent."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Converts a string that is printed, measured or in a table's cell to text, with control characters escaped."""
        return super().render_str(printable(text), **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Yields the segments of any printed object, with control characters escaped."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(printable(segment.text), segment.style)


# Width of tables and lines in a pipe or a file, whose readers must get ids and names uncut; $COLUMNS sets another.
PIPE_WIDTH = 1000

out = PlainConsole(highlight=False, width=None if sys.stdout.isatty() or "COLUMNS" in os.environ else PIPE_WIDTH)
err = PlainConsole(stderr=True, highlight=False)


def bar(unit: str = "") -> Progress:
    """Returns a progress bar on standard error. It is disabled if standard error is not a terminal."""
    columns = [TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn()]
    if unit:
        columns += [MofNCompleteColumn(), TextColumn(unit)]
    return Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=err, disable=not err.is_terminal)


class PlainProgress:
    """Progress as plain lines, at most one every few seconds, for output that is not a terminal."""

    def __init__(self, every_s: float = 5.0) -> None:
        self.every_s = every_s
        self.last = time.monotonic()

    def print_if_due(self, sentence: str) -> None:
        """Prints the sentence if the interval has passed and standard error is not a terminal."""
        now = time.monotonic()
        if not err.is_terminal and now - self.last >= self.every_s:
            self.last = now
            print(printable(sentence), file=sys.stderr, flush=True)
