"""Tracing spans of jobs and scenes, recorded if tracing is enabled (telemetry/tracing.py)."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import TYPE_CHECKING

from telemetry import tracing

if TYPE_CHECKING:
    from service.scheduling.jobs.active_job import ActiveJob

__all__ = ["record_job_span", "record_merge_span", "trace_headers"]


def trace_headers(item_kind: str, id: str) -> dict[str, str] | None:
    """Returns message headers that add the worker's spans to the trace of a job or scene; None if tracing is disabled.

    item_kind: "job" or "scene".
    """
    return {tracing.HEADER: str(tracing.root_span(item_kind, id))} if tracing.is_on() else None


def record_job_span(job: ActiveJob, state: str, error: str | None = None) -> None:
    """Records the tracing span of an ended job, from its creation until now, with a link to the upload of its scene."""
    if not tracing.is_on():
        return
    tracing.record_span(
        "job",
        job.created,
        time.time(),
        None,
        own=tracing.root_span("job", job.id),
        links=[tracing.root_span("scene", job.scene)],
        error=error,
        job=job.id,
        scene=job.scene,
        state=state,
        samples=job.samples,
        active_s=job.active_s,
        frames=len(job.frames),
    )


def record_merge_span(job: ActiveJob, begun: float, batches: int, batch_spans: Iterable[str]) -> None:
    """Records the tracing span of a merge of batches into a job's film.

    begun: Unix time of its start. batches: number of batches. batch_spans: traceparents of the spans in which they were
    rendered.
    """
    if tracing.is_on():
        links = [tracing.parse_traceparent(each) for each in batch_spans]
        tracing.record_span(
            "merge", begun, time.time(), tracing.root_span("job", job.id), links=links, job=job.id, batches=batches
        )
