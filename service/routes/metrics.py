"""Prometheus metrics, collected on each scrape."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator, Mapping

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from sqlalchemy import func, select

from service.farm import Farm
from service.ownership import rows
from service.scheduling.snapshot import Snapshot
from service.store.models import ACTIVE_STATES, Frame, Job, Scene

__all__ = ["render"]

STANDBY_RECENT_S = 10.0


COUNTERS = {  # by metric: the engine's counter, and its description
    "rayfarm_batches_merged": ("merged", "Batches added to a film"),
    "rayfarm_batches_dropped": ("dropped", "Duplicate or late batches"),
    "rayfarm_batches_failed": ("failed", "Batches that failed"),
    "rayfarm_batches_lost": ("lost", "Batches dispatched again"),
    "rayfarm_batches_doubled": ("doubled", "Batches of slow workers also given to a second worker"),
    "rayfarm_batches_verified": ("verified", "Batches rendered at least twice and compared"),
    "rayfarm_batches_differed": ("differed", "Batches with differing results"),
    "rayfarm_workers_distrusted": ("distrusted", "Workers excluded because their results differed from those of others"),
    "rayfarm_results": ("results", "Results of workers, each of one batch or of several merged batches"),
    "rayfarm_result_bytes": ("result_bytes", "Bytes of results as received"),
    "rayfarm_messages_put_aside": ("put_aside", "Messages of workers that could not be processed"),
}


class _Collector:
    def __init__(self, farm: Farm) -> None:
        self._farm = farm

    def collect(self) -> Iterator[Metric]:
        view = self._farm.engine.snapshot
        with self._farm.sessions() as session:
            jobs = session.execute(select(Job.state, func.count()).group_by(Job.state)).all()
            scenes = session.execute(select(Scene.status, func.count()).group_by(Scene.status)).all()
            late = session.scalar(select(func.count()).where(Job.state.in_(ACTIVE_STATES), Job.late.is_not(None))) or 0
            samples, bad = session.execute(select(func.sum(Frame.samples), func.sum(Frame.bad_samples))).one()
        yield _gauge("rayfarm_jobs", "Jobs by state", "state", {row[0]: row[1] for row in jobs})
        yield GaugeMetricFamily("rayfarm_jobs_late", "Unfinished jobs expected to miss their deadline", late)
        yield _gauge("rayfarm_scenes", "Scenes by status", "status", {row[0]: row[1] for row in scenes})
        reports = list(view.roster.reports.values())
        yield _gauge("rayfarm_worker_slots", "Slots by worker", "worker", {r.name: r.slots for r in reports})
        speeds = {r.name: r.samples_per_s * r.slots for r in reports}
        yield _gauge("rayfarm_worker_samples_per_second", "Speed by worker, all slots", "worker", speeds)
        failures = {r.name: float(view.failures.get(r.name, 0)) for r in reports}
        yield _gauge("rayfarm_worker_failures", "Batches that failed by worker, since the service started", "worker", failures)
        busy = len(view.roster.current())
        idle = sum(r.slots for r in reports) - busy
        yield _gauge("rayfarm_slots", "Slots by activity", "state", {"busy": busy, "idle": idle})
        text = "Slots for which there is at least half a minute of work each"
        yield GaugeMetricFamily("rayfarm_slots_wanted", text, _slots_wanted(view, dict(jobs), dict(scenes)))
        speed = sum(job.samples_per_s for job in view.jobs.values())
        yield GaugeMetricFamily("rayfarm_samples_per_second", "Samples per second added to films", speed)
        yield GaugeMetricFamily("rayfarm_watchers", "Connections subscribed to changes", self._farm.broadcast.listeners)
        free = shutil.disk_usage(self._farm.settings.data).free
        yield GaugeMetricFamily("rayfarm_data_free_bytes", "Free space in the data folder's file system", free)
        yield GaugeMetricFamily("rayfarm_batches_out", "Batches dispatched and not yet returned", view.batches_out)
        yield GaugeMetricFamily("rayfarm_results_unread", "Unread results in the stream", view.results_unread)
        text = "Recent processor time of the scheduler per batch"
        yield GaugeMetricFamily("rayfarm_batch_cost_seconds", text, view.batch_cost_s)
        yield GaugeMetricFamily(
            "rayfarm_pictures_asked", "Requested pictures that are not encoded yet", self._farm.pictures.pending_count
        )
        yield GaugeMetricFamily("rayfarm_film_samples", "Samples in the films", float(samples or 0))
        yield GaugeMetricFamily("rayfarm_film_bad_samples", "Samples excluded as NaN or infinite", float(bad or 0))
        for name, (counter, text) in COUNTERS.items():
            yield CounterMetricFamily(name, text, view.counts.get(counter, 0))
        owner = rows.current_owner(self._farm.sessions)
        yield GaugeMetricFamily("rayfarm_owner", "1 if this service is active, 0 if it is a standby", 1.0)
        text = "Number of takeovers from a service that had ended or hung"
        yield CounterMetricFamily("rayfarm_takeovers", text, owner.takeovers if owner is not None else 0)
        asked_at = owner.asked_at if owner is not None else None
        is_there = asked_at is not None and time.time() - asked_at < STANDBY_RECENT_S
        yield GaugeMetricFamily("rayfarm_standby", "1 while a standby service is present", float(is_there))
        yield GaugeMetricFamily("rayfarm_engine_up", "1 while the scheduler is running", 0.0 if view.fault else 1.0)


def _slots_wanted(view: Snapshot, jobs: dict[str, int], scenes: dict[str, int]) -> int:
    """Returns the number of slots that the waiting and running work could occupy at present, for autoscaling.

    jobs, scenes: numbers by state. Work of unknown duration counts as one slot each, so that a farm without workers is scaled
    up.
    """
    measured = sum(job.slots_wanted for job in view.jobs.values())
    return max(measured, jobs.get("queued", 0) + jobs.get("running", 0) + scenes.get("preparing", 0))


def _gauge(name: str, text: str, label: str, values: Mapping[str, float]) -> Metric:
    family = GaugeMetricFamily(name, text, labels=[label])
    for key, value in sorted(values.items()):
        family.add_metric([key], value)
    return family


def render(farm: Farm) -> bytes:
    """Returns all metrics in Prometheus's text format."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Collector(farm))
    return generate_latest(registry)
