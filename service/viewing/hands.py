"""Who can render views: the ready workers of a release that knows them."""

from __future__ import annotations

from collections.abc import Callable

from service.scheduling.fleet.workers import Roster
from service.viewing.look import Look

__all__ = ["Hands"]


class Hands:
    """By the latest look at the workers."""

    def __init__(self, roster: Callable[[], Roster], prepare: Callable[[str, str], None]) -> None:
        """prepare: told of a scene and a kind of workers that it is not compiled for."""
        self._roster = roster
        self._prepare = prepare

    def slots(self, kind: str) -> int:
        """How many slots of a kind render views."""
        return sum(report.slots for report in self._roster().ready() if report.kind == kind and report.views)

    def kind(self, look: Look) -> str | None:
        """Of the kinds that the scene is compiled for, the one with most slots; None where none is here."""
        kinds = [kind for kind in look.compiled if self.slots(kind)]
        return max(sorted(kinds), key=self.slots, default=None)

    def nobody(self, look: Look) -> str:
        """Why nobody renders it; where the scene only has to be compiled for those who are here, it will be."""
        ready = [report for report in self._roster().ready() if report.views]
        if ready:
            self._prepare(look.scene, ready[0].kind)
            return "The scene is prepared for the workers that are here."
        if self._roster().ready():
            return "The workers are of an older release, which shows no views."
        return "Waits for a worker."
