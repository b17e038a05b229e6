"""Machines that cannot do some work because of their limits, memory or temporary folder, independent of the scene.

Work returned by such a machine is sent to another worker's own queue. If there is none, the error lists all faults.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

from protocol.contract import WorkerReport, own_prepare_queue
from renderer.sentences import Sentence, joined_sentences

__all__ = ["Destination", "MachineFault", "UnfitMachines"]

MAX_TRIED = 5  # after this many unfit machines, no others are tried


@dataclass(frozen=True)
class MachineFault:
    """A machine's fault as reported by its worker. passing: whether the fault may be temporary, such as a full disk."""

    worker: str
    reason: str
    passing: bool

    def __str__(self) -> str:
        return Sentence("worker-reason", "{worker}: {reason}.", worker=self.worker, reason=self.reason.rstrip("."))


@dataclass(frozen=True)
class Destination:
    """Destination of work: a worker, its kind, and the queue to use. If `worker` is empty, any worker of the kind."""

    worker: str
    kind: str
    queue: str


class UnfitMachines:
    """Faults of machines, by the owner of the work that they cannot do, and by worker.

    An owner is a scene, a job, or a client's request.
    """

    def __init__(self) -> None:
        self._faults: dict[str, dict[str, MachineFault]] = {}  # by owner and worker

    def __contains__(self, owner: str) -> bool:
        return owner in self._faults

    def add(self, owner: str, fault: MachineFault) -> None:
        """Records that a worker's machine cannot do the work of this owner."""
        self._faults.setdefault(owner, {})[fault.worker] = fault

    def remove_owner(self, owner: str) -> None:
        """Removes the faults recorded for an owner whose work has ended or starts again."""
        self._faults.pop(owner, None)

    def next_destination(self, owner: str, able: Sequence[WorkerReport]) -> Destination | None:
        """Returns the destination of the next worker to try among `able`; None if there is none.

        If all have failed, those whose fault may be temporary are tried again.
        """
        faults = self._faults[owner]
        left = [report for report in able if report.name not in faults] if len(faults) < MAX_TRIED else []
        if not left:
            left = [report for report in able if report.name in faults and faults[report.name].passing]
            self._faults[owner] = {name: fault for name, fault in faults.items() if not (left and fault.passing)}
        if not left:
            return None
        report = max(left, key=lambda each: (each.slots, each.name))
        return Destination(report.name, report.kind, own_prepare_queue(report.kind, report.name))

    def error_message(self, owner: str, task: str) -> str:
        """Returns the error sentence that lists the faults of all machines that were tried for an owner's work.

        task: the work, as a text that completes "No worker can", such as "prepare this scene".
        """
        return Sentence(
            "task-without-worker",
            "No worker can {task}. {faults}",
            task=task,
            faults=reduce(joined_sentences, map(str, self._faults[owner].values())),
        )
