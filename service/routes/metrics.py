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
        yield GaugeMetricFamily("rayfarm_jobs_late", "Unfinished jobs that are expected after their deadline", late)
        yield _gauge("rayfarm_scenes", "Scenes by status", "status", {row[0]: row[1] for row in scenes})
        reports = list(view.roster.reports.values())
        yield _gauge("rayfarm_worker_slots", "Slots by worker", "worker", {r.name: r.slots for r in reports})
        speeds = {r.name: r.samples_per_s * r.slots for r in reports}
        yield _gauge("rayfarm_worker_samples_per_second", "Speed by worker, all slots", "worker", speeds)
        failures = {r.name: float(view.failures.get(r.name, 0)) for r in reports}
        yield _gauge("rayfarm_worker_failures", "Batches that failed by worker, since the service started", "worker", failures)
        busy = len(view.roster.current())
        idle = sum(r.slots for r in reports) - busy
        yield _gauge("rayfarm_slots", "Slots by what they do", "state", {"busy": busy, "idle": idle})
        text = "Slots that would each have half a minute of work or more"
        yield GaugeMetricFamily("rayfarm_slots_wanted", text, _slots_wanted(view, dict(jobs), dict(scenes)))
        speed = sum(job.samples_per_s for job in view.jobs.values())
        yield GaugeMetricFamily("rayfarm_samples_per_second", "Samples a second that come into films", speed)
        yield GaugeMetricFamily("rayfarm_watchers", "Connections that are told what changes", self._farm.broadcast.listeners)
        free = shutil.disk_usage(self._farm.settings.data).free
        yield GaugeMetricFamily("rayfarm_data_free_bytes", "Free space where the data folder lies", free)
        yield GaugeMetricFamily("rayfarm_batches_out", "Batches handed out and not back", view.batches_out)
        yield GaugeMetricFamily("rayfarm_results_unread", "Results in the stream that nobody has read yet", view.results_unread)
        text = "Processor time of the engine that a batch takes, lately"
        yield GaugeMetricFamily("rayfarm_batch_cost_seconds", text, view.batch_cost_s)
        yield GaugeMetricFamily(
            "rayfarm_pictures_asked", "Pictures asked for and not made yet", self._farm.pictures.pending_count
        )
        yield GaugeMetricFamily("rayfarm_film_samples", "Samples in the films", float(samples or 0))
        yield GaugeMetricFamily("rayfarm_film_bad_samples", "Samples left out as NaN or infinite", float(bad or 0))
        for name, text in (
            ("merged", "Batches added to a film"),
            ("dropped", "Batches that came twice or too late"),
            ("failed", "Batches that failed"),
            ("lost", "Batches handed out again"),
            ("doubled", "Batches of stragglers that a second worker tried too"),
            ("verified", "Batches that were rendered twice or more, and compared"),
            ("differed", "Batches that workers rendered differently"),
        ):
            yield CounterMetricFamily(f"rayfarm_batches_{name}", text, view.counts.get(name, 0))
        text = "Workers that were set aside as they rendered something else than others"
        yield CounterMetricFamily("rayfarm_workers_distrusted", text, view.counts.get("distrusted", 0))
        text = "Results of workers, each of a batch or of some whose sums they added up"
        yield CounterMetricFamily("rayfarm_results", text, view.counts.get("results", 0))
        text = "Messages of workers that could not be handled"
        yield CounterMetricFamily("rayfarm_messages_put_aside", text, view.counts.get("put_aside", 0))
        owner = rows.current_owner(self._farm.sessions)
        yield GaugeMetricFamily("rayfarm_owner", "1 where this service works as the farm, 0 where it stands by", 1.0)
        text = "How often a service took the farm over from another that had died or hung"
        yield CounterMetricFamily("rayfarm_takeovers", text, owner.takeovers if owner is not None else 0)
        asked_at = owner.asked_at if owner is not None else None
        is_there = asked_at is not None and time.time() - asked_at < STANDBY_RECENT_S
        yield GaugeMetricFamily("rayfarm_standby", "1 while another service stands by", float(is_there))
        text = "Bytes of their sums, as they came"
        yield CounterMetricFamily("rayfarm_result_bytes", text, view.counts.get("result_bytes", 0))
        yield GaugeMetricFamily("rayfarm_engine_up", "1 while the engine works", 0.0 if view.fault else 1.0)


def _slots_wanted(view: Snapshot, jobs: dict[str, int], scenes: dict[str, int]) -> int:
    """Returns the number of slots that the waiting and running work could occupy at present, for autoscaling.

    Work of unknown duration counts as one slot each, so that a farm scaled to no workers gets some.
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
