"""Counts the outcomes of reading damaged files, and prints them as a table."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

__all__ = ["OUTCOMES", "Tally", "into_page", "table"]

BEGIN, END = "<!-- mutations: made by `farm.py bench mutations` -->", "<!-- end of mutations -->"
# The possible outcomes, in the order of the table's columns.
OUTCOMES = ("read", "refused", "refused by the net", "too large", "too slow", "child crashed")


@dataclass
class Tally:
    """Counts of outcomes, longest time and most memory over all damaged files of one format."""

    outcomes: Counter[str] = field(default_factory=Counter)
    slowest_s: float = 0.0
    most_bytes: int = 0

    def add(self, outcome: str, seconds: float, memory: int) -> None:
        """Counts a file's outcome, its time (processor seconds; wall seconds if the child was lost), and its peak memory."""
        self.outcomes[outcome] += 1
        self.slowest_s, self.most_bytes = max(self.slowest_s, seconds), max(self.most_bytes, memory)

    def __add__(self, other: Tally) -> Tally:
        both = self.outcomes + other.outcomes
        return Tally(both, max(self.slowest_s, other.slowest_s), max(self.most_bytes, other.most_bytes))


def table(found: dict[str, Tally]) -> str:
    """Returns a Markdown table with a row for each format and one for all."""
    head = ["format", "files", *OUTCOMES, "slowest", "most memory of a child"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    whole = Tally()
    for name, tally in sorted(found.items()):
        lines.append(_row(name, tally))
        whole = whole + tally
    return "\n".join([*lines, _row("**all**", whole)])


def _row(name: str, tally: Tally) -> str:
    cells = [name, f"{tally.outcomes.total():,}", *(f"{tally.outcomes[each]:,}" for each in OUTCOMES)]
    return "| " + " | ".join([*cells, f"{tally.slowest_s:.1f} s", f"{tally.most_bytes / 2**20:.0f} MiB"]) + " |"


def into_page(page: Path, text: str) -> None:
    """Replaces the text between two markers in a documentation page."""
    before, _, rest = page.read_text().partition(BEGIN)
    if not rest:
        raise SystemExit(f"{page} has no place for the table: a line {BEGIN}, and one {END}")
    page.write_text(before + BEGIN + "\n\n" + text + "\n\n" + END + rest.partition(END)[2])
