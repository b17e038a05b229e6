"""Bodies of the messages to hooks: about ended and late jobs and quarantined workers, and test messages."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from service.store.models import FINAL_STATES, Job

__all__ = ["job_message", "quarantine_message", "test_message"]


def job_message(job: Job, public_url: str) -> dict[str, Any]:
    """Returns the message about a job that has ended, or about a running one that is expected to miss its deadline.

    public_url: base URL of the page, for links; may be empty.
    """
    fields: dict[str, Any] = {
        "id": job.id,
        "name": job.name,
        "state": job.state,
        "scene": job.scene,
        "active_s": round(job.active_s, 1),
        "error": job.error,
        "path": f"/api/jobs/{job.id}",
    }
    if public_url:
        fields["page"] = f"{public_url.rstrip('/')}/#/jobs/{job.id}"
    if job.deadline is not None:
        fields["deadline"] = datetime.fromtimestamp(job.deadline, UTC).isoformat()
    is_over = job.state in FINAL_STATES
    return _event(f"job.{job.state}" if is_over else "job.late", (job.finished if is_over else job.late) or 0.0, fields)


def quarantine_message(time: float, details: dict[str, Any]) -> dict[str, Any]:
    """Returns the message about a worker that was quarantined because its samples differ from those of other workers.

    time: Unix time. details: details of the event: the worker, the reason, the job in which it was found, and the jobs that
    are partly rendered again.
    """
    return _event("worker.set-aside", time, details)


def test_message(now: float) -> dict[str, Any]:
    """Returns a test message."""
    return _event("test", now, {"text": "This is a test: messages of this farm arrive here."})


def _event(type: str, time: float, data: dict[str, Any]) -> dict[str, Any]:
    return {"type": type, "timestamp": datetime.fromtimestamp(time, UTC).isoformat(), "data": data}
