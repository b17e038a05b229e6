"""From the workers' answers to the film: entries of the result stream become parts, grouped by job, each group one write."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

from renderer.film import BadSample
from renderer.settings import Tile
from service.errors import FilmLost
from service.scheduling.active_job import ActiveJob
from service.scheduling.plan import Range
from service.scheduling.results import Entry
from service.store.films import Part

__all__ = ["Merged", "batch_of", "merge"]

LARGE = 1 << 31  # bounds what a faulty worker may make us store

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Merged:
    """A batch that arrived, and whether the film took it."""

    job: ActiveJob
    lease: str
    batch: Range
    seconds: float
    worker: str
    part: Part
    taken: bool


def merge(entries: list[Entry], jobs: dict[str, ActiveJob]) -> tuple[list[Merged], dict[str, str]]:
    """Add all rendered batches among the entries to their films; those of jobs that are over are left out.

    Also returns the jobs whose film is broken, each with its fault. What may pass (a full disk, a lock) is raised instead,
    as FilmWaits: the entries are still in the stream, and are taken in later.
    """
    groups: dict[str, list[tuple[str, Range, float, str, Part]]] = {}
    for entry in entries:
        if entry.result is None or entry.result.event["type"] != "batch" or entry.result.sums is None:
            continue
        try:
            job = jobs.get(entry.result.event["job"])
            read = _read(entry.result.event, entry.result.sums, job) if job else None
        except (KeyError, TypeError, ValueError) as error:
            log.warning("a batch in the result stream is left out: %r", error)
            continue
        if job is not None and read is not None:
            groups.setdefault(job.id, []).append(read)
    merged: list[Merged] = []
    broken: dict[str, str] = {}
    for id, group in groups.items():
        job = jobs[id]
        try:
            taken = job.film.merge([part for *_, part in group])
        except FilmLost as error:
            broken[id] = str(error)
            continue
        for (lease, batch, seconds, worker, part), is_new in zip(group, taken, strict=True):
            merged.append(Merged(job, lease, batch, seconds, worker, part, is_new))
    return merged, broken


def batch_of(event: dict[str, Any], job: ActiveJob) -> Range | None:
    """The batch that an event is about; None where the job's film has no such tile."""
    tile = job.film.index_of(Tile(*event["tile"]))
    return None if tile is None else Range(tile, int(event["first"]), int(event["count"]))


def _read(event: dict[str, Any], sums: bytes, job: ActiveJob) -> tuple[str, Range, float, str, Part] | None:
    batch = batch_of(event, job)
    if batch is None or int(event["frame"]) != job.frame or not job.plan.wants(batch):
        return None
    bad = [BadSample(*(min(max(int(value), 0), LARGE) for value in sample)) for sample in event.get("bad", [])]
    part = Part(job.frame, *batch, sums, bad, min(max(int(event.get("bad_count", 0)), 0), LARGE))
    return str(event["batch"]), batch, min(max(float(event["seconds"]), 0.0), 86400.0), str(event.get("worker", "")), part
