"""Picture key of a job: jobs with equal keys have bit-identical samples, so one can reuse those of the other."""

from __future__ import annotations

import hashlib
import json

from service.shot import Shot, variation_of
from service.store.models import Job

__all__ = ["picture_hash"]

# Fields of a request that do not affect the samples of a frame, or that the job's settings, tiles or shot already contain. Any
# other field makes two shots different.
_SIZE_AND_GOAL_FIELDS = {"scene", "name", "spp", "noise", "seconds", "width", "height", "tile_size"}
_FRAME_FIELDS = {"frames", "frame", "fps", "clip", "turntable", "order", "every"}
_QUEUE_FIELDS = {"priority", "after", "max_slots", "deadline", "needs", "verify", "fresh"}
_DISPLAY_FIELDS = {"denoise", "exposure", "tonemap"}
IGNORED_FIELDS = _SIZE_AND_GOAL_FIELDS | _FRAME_FIELDS | _QUEUE_FIELDS | _DISPLAY_FIELDS


def picture_hash(job: Job) -> str | None:
    """Returns the hash of everything that determines a job's samples and film tiles, except the renderer's kernels.

    None for a job whose settings are not fixed yet. The scene's id is a hash of its files, so uploading the same files again
    gives the same key. Shots that differ only in their choice of frames have equal keys: a frame's settings follow from the
    request and the frame's time, so the request is hashed as it was sent.
    """
    if job.settings is None or job.tile_size is None:
        return None
    of = [job.compiled_scene_id, job.settings, job.tile_size]
    if (shot := Shot.parse(job.shot)) is not None:
        asked = {name: value for name, value in job.request.items() if name not in IGNORED_FIELDS}
        if not asked.get("vary"):  # False says that the scene file's own does not apply
            asked.pop("vary", None)
        of += [shot.fps, shot.clip, shot.turntable, asked]
        if (variation := variation_of(job.request, shot)) and "vary" not in asked:
            of.append(variation)
        if asked.get("views"):  # they belong to the request's frames
            of += [job.request.get("frames"), job.request.get("frame")]
    return hashlib.sha256(json.dumps(of, sort_keys=True).encode()).hexdigest()
