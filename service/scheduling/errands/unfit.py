"""Machines that cannot prepare something, whatever the scene: their limits, their memory, their temporary folder.

What one of them hands back goes to another worker by that worker's own queue. Where none is left, a sentence names them all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from worker.protocol.contract import WorkerReport, own_prepare_queue

__all__ = ["Fault", "Place", "Unfit"]

MOST_TRIED = 5  # machines: what none of so many can prepare, the others are spared


@dataclass(frozen=True)
class Fault:
    """What a worker says of its machine. passing: for now, as of a full disk."""

    worker: str
    why: str
    passing: bool

    def __str__(self) -> str:
        return f"{self.worker}: {self.why.rstrip('.')}."


@dataclass(frozen=True)
class Place:
    """A worker, and the queue that it alone takes from."""

    worker: str
    kind: str
    queue: str


class Unfit:
    """The machines that failed, by scene or job."""

    def __init__(self) -> None:
        self._faults: dict[str, dict[str, Fault]] = {}  # by owner and worker

    def __contains__(self, owner: str) -> bool:
        return owner in self._faults

    def add(self, owner: str, fault: Fault) -> None:
        """A worker cannot prepare what is the owner's."""
        self._faults.setdefault(owner, {})[fault.worker] = fault

    def forget(self, owner: str) -> None:
        """The owner is over, or begun anew."""
        self._faults.pop(owner, None)

    def next(self, owner: str, able: Sequence[WorkerReport]) -> Place | None:
        """The place to try next among the workers that are able; None where there is none.

        Workers whose trouble may pass are tried again once no other is left.
        """
        faults = self._faults[owner]
        left = [report for report in able if report.name not in faults] if len(faults) < MOST_TRIED else []
        if not left:
            left = [report for report in able if report.name in faults and faults[report.name].passing]
            self._faults[owner] = {name: fault for name, fault in faults.items() if not (left and fault.passing)}
        if not left:
            return None
        report = max(left, key=lambda each: (each.slots, each.name))
        return Place(report.name, report.kind, own_prepare_queue(report.kind, report.name))

    def sentence(self, owner: str, what: str) -> str:
        """Why nobody is left. what: "this scene", or "this shot"."""
        return f"No worker can prepare {what}. {' '.join(map(str, self._faults[owner].values()))}"
