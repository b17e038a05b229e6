"""Whether two jobs are of the same picture: then the samples of one are the samples of the other, to the bit."""

from __future__ import annotations

import hashlib
import json

from service.store.models import Job

__all__ = ["picture_of"]


def picture_of(job: Job) -> str | None:
    """A hash of all that a sample depends on but the kernels that render it, and of the tiles that a film is made of.

    The scene's id is a hash of its files, so that the same files uploaded again are the same picture. None for a shot, and for a
    job whose settings are not fixed yet.
    """
    if job.shot is not None or job.settings is None or job.tile_size is None:
        return None
    of = [job.stage, job.settings, job.tile_size]
    return hashlib.sha256(json.dumps(of, sort_keys=True).encode()).hexdigest()
