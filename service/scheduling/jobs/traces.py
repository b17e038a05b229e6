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
    """Returns message headers that make the worker's spans part of a job's or scene's trace; None if tracing is disabled.

    what: "job" or "scene".
    """
    return {tracing.HEADER: str(tracing.root_span(item_kind, id))} if tracing.is_on() else None


def record_job_span(job: ActiveJob, state: str, error: str | None = None) -> None:
    """Records the span of an ended job, which starts at its creation, with a link to the upload of its scene."""
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
    """Records the span of a merge into a job's film. begun: its start. batch_spans: spans in which the batches were rendered."""
    if tracing.is_on():
        links = [tracing.parse_traceparent(each) for each in batch_spans]
        tracing.record_span(
            "merge", begun, time.time(), tracing.root_span("job", job.id), links=links, job=job.id, batches=batches
        )
