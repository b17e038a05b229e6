"""What was rendered once is not rendered again: a job begins with what the film of an earlier one of the same picture has.

A film is exact sums of numbered samples, so a job of 256 samples that begins with another's 64 ends with the bits of one that
rendered all of them. The film is copied: what becomes of the earlier job makes no difference to the later one.

Not taken is what would show in the bits: samples of another kind of workers than those that are connected (other kernels, another
processor), more samples than are asked for, and of a picture that ends by noise tiles that would have ended sooner. A job that
asks for a time asks for work, and takes nothing.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import select

from renderer.settings import MAX_SPP, RenderSettings
from service.errors import FarmError
from service.scheduling.history import History
from service.scheduling.plan import FIRST_CHECK
from service.scheduling.workers import Roster
from service.store.database import Sessions
from service.store.film_store import FilmStore
from service.store.models import Frame, Job
from service.store.room import need_room

__all__ = ["Reuse"]

LOOKED_AT = 32  # of the latest jobs of a picture
RESTS = ("finished", "cancelled")

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Source:
    """A job that another may take from. samples: of its frame, all pixels together."""

    job: Job
    samples: int

    @property
    def end(self) -> tuple[str, int | None, float | None, float | None]:
        """What a person may have changed meanwhile."""
        return self.job.state, self.job.spp, self.job.noise, self.job.seconds


class Reuse:
    """May be called from any thread."""

    def __init__(
        self, sessions: Sessions, films: FilmStore, roster: Callable[[], Roster], data: Path, min_free_bytes: int
    ) -> None:
        """data: the folder whose disk has the films, of which so many bytes stay free."""
        self._sessions = sessions
        self._films = films
        self._roster = roster
        self._data = data
        self._min_free_bytes = min_free_bytes

    def begin(self, job: Job) -> int:
        """Give a job that is about to be written down a film to begin with, and have its row say so; returns the film's samples.

        0: there is none that it may take, or its settings are not known yet. Whoever does not write it down deletes the film.
        """
        if job.picture is None or job.settings is None or job.tile_size is None or job.seconds is not None:
            return 0
        settings = RenderSettings.from_json(job.settings)
        most = job.spp or MAX_SPP
        for source in self._sources(job):
            try:
                need_room(self._data, self._min_free_bytes + self._films.size(source.job.id))
                samples = self._films.copy(job.id, source.job.id, settings, job.tile_size, most)
            except FarmError as error:
                log.info("nothing is taken from job %s: %s", source.job.id, error)
                continue
            if self._source(source.job.id, source.end) is None:
                self._films.delete(job.id)  # it went on meanwhile, and may have got samples of another end
                continue
            self._note(job, source, samples)
            return samples
        return 0

    def _sources(self, job: Job) -> list[_Source]:
        """Jobs from which this one may take, those with most samples first."""
        kinds = {report.kind for report in self._roster().reports.values()}
        with self._sessions() as session:
            rows = session.execute(
                select(Job, Frame.samples)
                .join(Frame, Frame.job == Job.id)
                .where(Job.picture == job.picture, Job.state.in_(RESTS), Job.shot.is_(None), Frame.samples > 0)
                .order_by(Job.created.desc())
                .limit(LOOKED_AT)
            )
            found = [_Source(*row) for row in rows]
        found = [
            each
            for each in found
            if each.job.kind and not each.job.doubted and (not kinds or each.job.kind in kinds) and _is_part(each.job, job)
        ]
        return sorted(found, key=lambda each: -each.samples)

    def _source(self, id: str, end: tuple[str, int | None, float | None, float | None]) -> _Source | None:
        """A job as it is now; None where its end is another, or it is deleted."""
        with self._sessions() as session:
            job = session.get(Job, id)
        found = _Source(job, 0) if job is not None else None
        return found if found is not None and found.end == end else None

    def _note(self, job: Job, source: _Source, samples: int) -> None:
        settings = job.settings or {}
        spp = samples / (settings["width"] * settings["height"])
        job.kind = source.job.kind
        job.taken = {"job": source.job.id, "spp": round(spp, 3)}
        history = History(events=[[round(time.time(), 2), "taken", source.job.id]])
        with self._sessions() as session:
            of_source = History.of(session.scalar(select(Job.history).where(Job.id == source.job.id)))
        last: list[Any] = of_source.points[-1] if of_source.points else []
        if last and last[1] == samples:
            history.points.append([0.0, float(samples), last[2]])
        job.history = history.to_json()
        log.info("job %s begins with %g samples a pixel of job %s", job.id, spp, source.job.id)


def _is_part(source: Job, job: Job) -> bool:
    """Whether all that a job has rendered is part of what another of its picture asks for."""
    if source.noise is None and source.seconds is None and (source.spp or 0) > (job.spp or MAX_SPP):
        return False  # which is seen without a look at its film
    if job.noise is None or (source.spp or MAX_SPP) <= FIRST_CHECK:
        return True
    # A tile that has gone on for a coarser end goes on for a finer one too: both look at the same numbers of samples.
    return source.seconds is None and source.noise is not None and source.noise >= job.noise
