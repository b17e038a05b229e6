"""What a sample of a pixel costs in each scene, as measured on the pieces of its views."""

from __future__ import annotations

from service.scheduling.fleet.workers import Roster
from service.viewing.look import Look

__all__ = ["Costs"]

UNKNOWN_S = 2.5e-6  # of a scene that was never rendered here, where the workers have not rendered anything faster
LEAST_S = 1e-9
SMOOTHING = 0.3
MOST = 256


class Costs:
    """Seconds on one slot, by scene, integrator and depth. Lives in the desk's thread."""

    def __init__(self) -> None:
        self._known: dict[str, float] = {}

    def of(self, look: Look, kind: str, roster: Roster) -> float:
        """The seconds of a sample of a pixel; a guess where the scene is new."""
        known = self._known.get(_name(look))
        if known is not None:
            return known
        speeds = [report.samples_per_s for report in roster.ready() if report.kind == kind and report.samples_per_s > 0]
        return max(UNKNOWN_S, len(speeds) / sum(speeds)) if speeds else UNKNOWN_S

    def learn(self, look: Look, cost_s: float) -> None:
        """A piece took so long."""
        name = _name(look)
        before = self._known.pop(name, cost_s)
        self._known[name] = max(LEAST_S, before + (cost_s - before) * SMOOTHING)
        if len(self._known) > MOST:
            del self._known[next(iter(self._known))]


def _name(look: Look) -> str:
    return f"{look.upload} {look.settings.integrator} {look.settings.max_depth}"
