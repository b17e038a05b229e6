"""The workers that can render views: ready, and of a release that supports them."""

from __future__ import annotations

from renderer.sentences import Sentence
from service.events import Events, PreparationRequested
from service.scheduling.snapshot import SnapshotBoard
from service.viewing.view_request import ViewRequest

__all__ = ["ViewWorkers"]


class ViewWorkers:
    """Selects workers by their latest reports."""

    def __init__(self, board: SnapshotBoard, events: Events) -> None:
        self._board = board
        self._events = events

    def slots(self, kind: str) -> int:
        """Number of slots of a kind that render views."""
        return sum(report.slots for report in self._board.roster.ready() if report.kind == kind and report.views)

    def best_kind(self, request: ViewRequest) -> str | None:
        """Returns the kind with most slots among those for which the scene is compiled; None if no such worker is ready."""
        kinds = [kind for kind in request.compiled if self.slots(kind)]
        return max(sorted(kinds), key=self.slots, default=None)

    def why_unavailable(self, request: ViewRequest) -> str:
        """Returns why no worker renders the view, and requests compilation for ready workers of another kind."""
        ready = [report for report in self._board.roster.ready() if report.views]
        if ready:
            self._events.publish(PreparationRequested(request.scene, ready[0].kind))
            return Sentence("view-scene-preparing", "The scene is prepared for the workers that are here.")
        if self._board.roster.ready():
            return Sentence("view-workers-too-old", "The workers are of an older release, which shows no views.")
        return Sentence("view-waits-for-worker", "Waits for a worker.")
