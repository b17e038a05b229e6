"""Selects the workers that can render live views: those that are ready and whose release supports views."""

from __future__ import annotations

from renderer.sentences import Sentence
from service.events import Events, PreparationRequested
from service.scheduling.snapshot import SnapshotHolder
from service.viewing.view_request import ViewRequest

__all__ = ["ViewWorkers"]


class ViewWorkers:
    """Selects workers for views from their latest reports. A kind is a worker kind (renderer.jit.kind)."""

    def __init__(self, board: SnapshotHolder, events: Events) -> None:
        self._board = board
        self._events = events

    def slots(self, kind: str) -> int:
        """Returns the number of slots of this worker kind that can render views."""
        return sum(report.slots for report in self._board.roster.ready_reports() if report.kind == kind and report.views)

    def can_denoise(self, kind: str) -> bool:
        """Returns True if all ready workers of this kind denoise views: any of them may take the message."""
        ready = [report for report in self._board.roster.ready_reports() if report.kind == kind and report.views]
        return bool(ready) and all(report.denoises_views for report in ready)

    def best_kind(self, request: ViewRequest) -> str | None:
        """Returns the worker kind with most slots for which the scene is compiled; None if no such worker is ready."""
        kinds = [kind for kind in request.compiled if self.slots(kind)]
        return max(sorted(kinds), key=self.slots, default=None)

    def unavailable_reason(self, request: ViewRequest) -> str:
        """Returns a sentence on why no worker renders the view.

        If only workers of other kinds are ready, requests that the scene is compiled for them.
        """
        ready = [report for report in self._board.roster.ready_reports() if report.views]
        if ready:
            self._events.publish(PreparationRequested(request.scene, ready[0].kind))
            return Sentence("view-scene-preparing", "The scene is being prepared for the connected workers.")
        if self._board.roster.ready_reports():
            return Sentence(
                "view-workers-too-old", "The workers are of an older release, which cannot show live views. Start newer ones."
            )
        return Sentence("view-waits-for-worker", "Waits for a worker.")
