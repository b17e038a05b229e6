"""The message about a job that has ended, or is late."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from service.store.models import FINAL, Job

__all__ = ["about", "set_aside", "trial"]


def about(job: Job, public_url: str) -> dict[str, Any]:
    """The message about a job that has ended, or of one that has not: that it is expected after its deadline.

    public_url: where the page is; may be empty.
    """
    told: dict[str, Any] = {
        "id": job.id,
        "name": job.name,
        "state": job.state,
        "scene": job.scene,
        "active_s": round(job.active_s, 1),
        "error": job.error,
        "path": f"/api/jobs/{job.id}",
    }
    if public_url:
        told["page"] = f"{public_url.rstrip('/')}/#/jobs/{job.id}"
    if job.deadline is not None:
        told["deadline"] = datetime.fromtimestamp(job.deadline, UTC).isoformat()
    is_over = job.state in FINAL
    return _event(f"job.{job.state}" if is_over else "job.late", (job.finished if is_over else job.late) or 0.0, told)


def set_aside(at: float, told: dict[str, Any]) -> dict[str, Any]:
    """The message about a worker that rendered something else than others. told: who, why, in which job it was found out, and
    which jobs are rendered again in part."""
    return _event("worker.set-aside", at, told)


def trial(now: float) -> dict[str, Any]:
    """A message that says only that messages arrive."""
    return _event("test", now, {"text": "This is a test: messages of this farm arrive here."})


def _event(type: str, at: float, data: dict[str, Any]) -> dict[str, Any]:
    return {"type": type, "timestamp": datetime.fromtimestamp(at, UTC).isoformat(), "data": data}
