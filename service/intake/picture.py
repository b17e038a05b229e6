"""Whether two jobs are of the same picture: then the samples of one are the samples of the other, to the bit."""

from __future__ import annotations

import hashlib
import json

from service.shot import Shot
from service.store.models import Job

__all__ = ["picture_of"]

# What is asked for and says nothing of any sample of a frame, or says it in the job's settings, its tiles or its shot. Whatever
# is not named here makes two shots different.
_OF_SAMPLES = {"scene", "name", "spp", "noise", "seconds", "width", "height", "tile_size"}
_OF_FRAMES = {"frames", "frame", "fps", "clip", "turntable", "order", "every"}
_OF_THE_QUEUE = {"priority", "after", "max_slots", "deadline", "needs", "verify", "fresh"}
NO_MATTER = _OF_SAMPLES | _OF_FRAMES | _OF_THE_QUEUE


def picture_of(job: Job) -> str | None:
    """A hash of all that a sample depends on but the kernels that render it, and of the tiles that a film is made of.

    The scene's id is a hash of its files, so that the same files uploaded again are the same picture. None for a job whose
    settings are not fixed yet. Of a shot it is that of all its frames: which of them are asked for makes no difference. What a
    frame's settings are follows from the request at the frame's own moment, so the request counts as it was asked.
    """
    if job.settings is None or job.tile_size is None:
        return None
    of = [job.stage, job.settings, job.tile_size]
    if (shot := Shot.of(job.shot)) is not None:
        asked = {name: value for name, value in job.request.items() if name not in NO_MATTER}
        of += [shot.fps, shot.clip, shot.turntable, asked]
    return hashlib.sha256(json.dumps(of, sort_keys=True).encode()).hexdigest()
