"""Estimates the seconds that a sample of a scene takes on one slot, from measurements while its live views are rendered."""

from __future__ import annotations

from service.scheduling.fleet.workers import WorkerSnapshot
from service.viewing.view_request import ViewRequest

__all__ = ["SMOOTHING", "SampleCosts"]

ASSUMED_S = 2.5e-6  # of a scene without measurements, if no worker has reported a lower cost
MIN_S = 1e-9
SMOOTHING = 0.3
MAX_SCENES = 256


class SampleCosts:
    """Measured seconds per sample of a pixel on one slot, by scene, integrator and maximum depth.

    Used in the scheduler's thread only.
    """

    def __init__(self, smoothing: float = SMOOTHING) -> None:
        """smoothing: weight of the latest measurement."""
        self._smoothing = smoothing
        self._known: dict[str, float] = {}

    def known(self, request: ViewRequest) -> float | None:
        """Returns the measured seconds per sample of a pixel; None if there are no measurements."""
        return self._known.get(_name(request))

    def estimate(self, request: ViewRequest, kind: str, roster: WorkerSnapshot) -> float:
        """Returns the seconds per sample of a pixel: measured, or for a new scene estimated from the workers' speeds.

        kind: the worker kind. roster: the workers.
        """
        known = self.known(request)
        if known is not None:
            return known
        of_cpus = [report for report in roster.ready_reports() if report.kind == kind and not report.has_card_queue]
        speeds = [report.samples_per_s for report in of_cpus if report.samples_per_s > 0]
        return max(ASSUMED_S, len(speeds) / sum(speeds)) if speeds else ASSUMED_S

    def update(self, request: ViewRequest, cost_s: float) -> None:
        """Adds a measurement of the seconds per sample of a pixel, `cost_s`, to the running average of a scene."""
        name = _name(request)
        before = self._known.pop(name, cost_s)
        self._known[name] = max(MIN_S, before + (cost_s - before) * self._smoothing)
        if len(self._known) > MAX_SCENES:
            del self._known[next(iter(self._known))]


def _name(request: ViewRequest) -> str:
    return f"{request.upload} {request.settings.integrator} {request.settings.max_depth}"
