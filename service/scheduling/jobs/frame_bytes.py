"""Computes the storage used by compiled frames, in bytes. A shared blob is counted once; blobs of the scene are not counted."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

from service.scheduling.jobs.active_frame import ActiveFrame
from service.scheduling.jobs.active_job import ActiveJob

__all__ = ["additional_bytes", "exclusive_bytes", "total_bytes"]


def total_bytes(jobs: Iterable[ActiveJob]) -> dict[str, int]:
    """Returns the sizes in bytes, by hash, of the blobs that were compiled for frames of these jobs."""
    return {
        sha256: size
        for job in jobs
        for frame in job.agenda.turns.frames_with_own_scene()
        for sha256, size in _of_frame(job, frame)
    }


def exclusive_bytes(job: ActiveJob, frame: ActiveFrame) -> int:
    """Returns the total size in bytes of the blobs to which only this frame of the job refers."""
    others = {
        sha256 for other in job.agenda.turns.frames_with_own_scene() if other is not frame for sha256, _ in _of_frame(job, other)
    }
    return _sum_without(_of_frame(job, frame), others)


def additional_bytes(job: ActiveJob, ref: Mapping[str, Any]) -> int:
    """Returns by how many bytes the blobs of this BlobRef (protocol.contract; as JSON) would increase the job's storage."""
    return _sum_without(_blobs(ref), {*total_bytes([job]), *job.of_scene})


def _of_frame(job: ActiveJob, frame: ActiveFrame) -> Iterator[tuple[str, int]]:
    for kind, ref in frame.own.items():
        if kind in frame.compiled:
            yield from ((sha256, size) for sha256, size in _blobs(ref) if sha256 not in job.of_scene)


def _blobs(ref: Mapping[str, Any]) -> Iterator[tuple[str, int]]:
    yield str(ref["sha256"]), int(ref.get("size", 0))
    for sha256, size in ref.get("parts") or ():
        yield str(sha256), int(size)


def _sum_without(blobs: Iterable[tuple[str, int]], without: Collection[str]) -> int:
    return sum(size for sha256, size in dict(blobs).items() if sha256 not in without)
