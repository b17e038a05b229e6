"""Lookup of a job by its id or the beginning of its id."""

from __future__ import annotations

from rayfarm.client import Client, ClientError
from rayfarm.errors import CommandError
from rayfarm.responses import Job

__all__ = ["find_job"]

MAX_CANDIDATES = 5  # candidates that an error lists


def find_job(farm: Client, text: str) -> Job:
    """Returns the job with this id, or the only job whose id begins with `text`. Raises ClientError or CommandError."""
    try:
        return farm.job(text)
    except ClientError as error:
        if error.status != 404:
            raise
        found = [job for job in farm.jobs(search=text) if job.id.startswith(text)]
        if not found:
            raise
    if len(found) > 1:
        listed = ", ".join(job.id for job in found[:MAX_CANDIDATES]) + (", ..." if len(found) > MAX_CANDIDATES else "")
        raise CommandError(f"{len(found)} jobs have ids that begin with {text!r}: {listed}. Give more of the id.")
    return found[0]
