"""The results of a fault campaign as table rows."""

from __future__ import annotations

import json
import statistics
from collections import defaultdict
from dataclasses import asdict, dataclass
from pathlib import Path

__all__ = ["Fault", "into_page", "read", "table", "write"]

BEGIN, END = "<!-- faults: made by `farm.py bench faults` -->", "<!-- end of faults -->"


@dataclass
class Fault:
    """One injected fault and its outcome.

    recovered_s: seconds until new samples arrived; None if none arrived. digest_is_right: None if the fault's job did not end.
    asked: whether the job failed with an error that asks the user to resume it, and was resumed.
    """

    kind: str
    ground: str
    recovered_s: float | None = None
    repeated: int = 0
    digest_is_right: bool | None = None
    asked: bool = False
    undone: str = ""  # reason why it could not be injected


def write(path: Path, faults: list[Fault]) -> None:
    """Appends faults to a file, one per line."""
    with path.open("a") as file:
        file.writelines(json.dumps(asdict(fault)) + "\n" for fault in faults)


def read(paths: list[Path]) -> list[Fault]:
    """Returns the faults of files written by `write`."""
    return [Fault(**json.loads(line)) for path in paths for line in path.read_text().splitlines()]


def table(faults: list[Fault]) -> str:
    """Returns a Markdown table with a row for each kind of fault and one for all."""
    rows = defaultdict(list)
    for fault in faults:
        if not fault.undone:
            rows[fault.kind].append(fault)
    head = [
        "fault",
        "times",
        "wrong digests",
        "jobs unfinished",
        "set to running by hand",
        "batches repeated",
        "back after: median",
        "worst",
    ]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += [_row(kind, found) for kind, found in sorted(rows.items())]
    return "\n".join([*lines, _row("**all**", [fault for found in rows.values() for fault in found])])


def _row(kind: str, faults: list[Fault]) -> str:
    times = [fault.recovered_s for fault in faults if fault.recovered_s is not None]
    cells = [kind, str(len(faults))]
    cells += [str(sum(fault.digest_is_right is False for fault in faults))]
    cells += [str(sum(fault.digest_is_right is None or fault.recovered_s is None for fault in faults))]
    cells += [str(sum(fault.asked for fault in faults)), str(sum(fault.repeated for fault in faults))]
    cells += [f"{statistics.median(times):.1f} s", f"{max(times):.1f} s"] if times else ["", ""]
    return "| " + " | ".join(cells) + " |"


def into_page(page: Path, text: str) -> None:
    """Replaces the text between two markers in a documentation page."""
    before, _, rest = page.read_text().partition(BEGIN)
    if not rest:
        raise SystemExit(f"{page} has no place for the table: a line {BEGIN}, and one {END}")
    page.write_text(before + BEGIN + "\n\n" + text + "\n\n" + END + rest.partition(END)[2])
