"""Idempotency keys: repeating a request with the same Idempotency-Key returns the job that the first request created.

Keys are separate for each user: the same key from two users means two requests.
"""

from __future__ import annotations

import hashlib

from sqlalchemy import select

from renderer.sentences import Sentence
from service.access.projects import ProjectVisibility
from service.errors import Conflict
from service.farm import Farm
from service.jobs.describe import job_out
from service.models.jobs import JobOut
from service.store.models import Job

__all__ = ["job_with_key", "repeated_answer", "stored_key"]


def stored_key(key: str | None, user: str | None) -> str | None:
    """Returns the key in the form stored in a job's row, which includes the user. user: None without authentication."""
    return hashlib.sha256(f"{user or ''}\0{key}".encode()).hexdigest() if key else None


def job_with_key(key: str | None, user: str | None, farm: Farm) -> Job | None:
    """Returns the job that this user created with this key; None if there is none.

    Releases without per-user keys stored the plain key; those jobs are found too.
    """
    if not key:
        return None
    with farm.sessions() as session:
        if (found := session.scalar(select(Job).where(Job.idempotency_key == stored_key(key, user)))) is not None:
            return found
        return session.scalar(
            select(Job).where(Job.idempotency_key == key, Job.user.is_(None) if user is None else Job.user == user)
        )


def repeated_answer(found: Job, request: dict[str, object], farm: Farm, sight: ProjectVisibility) -> JobOut:
    """Returns the current state of the job that the first request created. Raises Conflict if that request was different."""
    if found.request != request or not sight.is_visible(found.project):
        raise Conflict(
            Sentence("idempotency-key-reused", "This Idempotency-Key was used for another request. Use a new key for a new job.")
        )
    with farm.sessions() as session:
        return job_out(found, session, farm.engine)
