"""The processes of this worker: its main process and all descendants (Linux only)."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["process_times"]


def process_times(proc: Path = Path("/proc")) -> dict[int, int]:
    """Returns, by pid, the processor time of each process of this worker and of its ended children, in clock ticks.

    The dict is empty if the system does not report these times. proc: where procfs is mounted.
    """
    parents: dict[int, int] = {}
    ticks: dict[int, int] = {}
    for entry in proc.glob("[0-9]*"):
        try:
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
            pid = int(entry.name)
            parents[pid], ticks[pid] = int(fields[1]), sum(map(int, fields[11:15]))
        except (OSError, ValueError, IndexError):
            continue  # it has ended
    found = {os.getpid()} & parents.keys()
    while more := {pid for pid, parent in parents.items() if parent in found} - found:
        found |= more
    return {pid: ticks[pid] for pid in found}
