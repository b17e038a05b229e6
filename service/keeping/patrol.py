"""Checks films at rest: each is read completely now and then, and what is missing from it is rendered again.

A disk returns other bytes than were written, a folder is restored in part, a file is deleted by hand. While a job is being
rendered the engine notices, but nobody may read a finished job's film for months. So a thread looks: when the service starts,
whether each film exists; then at one after the other, starting with those not checked for longest, using a twentieth of a core;
and at once where a reader met damage. A job whose film lacks something is queued again as it is, and ends with the same bits.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping

from sqlalchemy import select, update

from renderer.errors import SettingsError
from renderer.settings import RenderSettings
from service.errors import FarmError, FilmDamaged
from service.events import Events, FilmSuspected, RowWritten
from service.scheduling.jobs.history import History
from service.scheduling.jobs.wishes import set_state
from service.store.database import Sessions
from service.store.film_faults import FILM
from service.store.film_store import FilmStore
from service.store.models import Frame, Job, Scene

__all__ = ["Patrol", "check_film"]

RESTS = 19  # times as long as it looked
REST_AT_MOST_S = 60.0
LOOK_ROUND_S = 600.0  # where all films were looked at
LATER_S = 3600.0  # when one that could not be looked at has its turn again
TRIES = 3  # of one job, in one life of the service: a disk that damages again and again is no matter of rendering
DAY_S = 86400.0

log = logging.getLogger(__name__)


def check_film(films: FilmStore, job: str, settings: RenderSettings, tile_size: int, recorded: Mapping[int, int]) -> None:
    """Read all of a film; recorded: the samples that the database says of each frame. Raises FilmDamaged, FilmLost, FilmWaits."""
    if not any(recorded.values()):
        return
    if not films.size(job):
        raise FilmDamaged(f"{FILM} is missing or was emptied.")
    has = films.verify(job, settings, tile_size)
    if lacking := [number for number, samples in recorded.items() if has.get(number, 0) < samples]:
        raise FilmDamaged(f"{FILM} lacks samples of {len(lacking)} of {len(recorded)} frames.")


class Patrol:
    """One thread; `suspect` may be called from any."""

    def __init__(
        self,
        sessions: Sessions,
        films: FilmStore,
        prepare: Callable[[str], None],
        events: Events,
        every_days: float,
    ) -> None:
        """prepare: sees to it that what a job is rendered of is there or is made again. every_days: how often; 0: never."""
        self._sessions = sessions
        self._films = films
        self._prepare = prepare
        self._events = events
        events.subscribe(FilmSuspected, lambda event: self.suspect(event.job))
        self._every_s = every_days * DAY_S
        self._suspects: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._waiting: set[str] = set()  # in it
        self._tries: Counter[str] = Counter()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="patrol", daemon=True)

    def start(self) -> None:
        """Begin."""
        if self._every_s > 0:
            self._thread.start()

    def stop(self) -> None:
        """End after the film in hand, which is read for seconds at most before it is let be."""
        self._stopping.set()
        self._suspects.put(None)
        if self._thread.is_alive():
            self._thread.join(5)

    def suspect(self, job: str) -> None:
        """Somebody could not read a film: look at it now."""
        if self._every_s > 0 and job not in self._waiting:
            self._waiting.add(job)
            self._suspects.put(job)

    def _run(self) -> None:
        self._guarded(self._look_for_absent)
        rest_s = 0.0
        while not self._stopping.is_set():
            job = self._next_suspect(rest_s)
            is_suspect = job is not None
            began = time.monotonic()
            if job is None and not self._stopping.is_set():
                job = self._guarded(self._oldest)
            if job is None or self._stopping.is_set():
                rest_s = LOOK_ROUND_S
                continue
            self._guarded(lambda job=job: self._look(job))  # type: ignore[misc]
            rest_s = 0.0 if is_suspect else min(RESTS * (time.monotonic() - began), REST_AT_MOST_S)

    def _next_suspect(self, patience_s: float) -> str | None:
        try:
            job = self._suspects.get(timeout=patience_s) if patience_s > 0 else self._suspects.get_nowait()
        except queue.Empty:
            return None
        self._waiting.discard(job or "")
        return job

    def _guarded(self, action: Callable[[], str | None]) -> str | None:
        try:
            return action()
        except FarmError as error:
            log.warning("films are looked at later: %s", error)
        except Exception:
            log.exception("a fault while films were looked at")
        return None

    def _look_for_absent(self) -> None:
        with self._sessions() as session:
            found = session.execute(
                select(Job.id).where(
                    Job.state == "finished", Job.id.in_(select(Frame.job).where(Frame.samples > 0).group_by(Frame.job))
                )
            )
            jobs = list(found.scalars())
        for job in jobs:
            if self._stopping.is_set():
                return
            if not self._films.size(job):
                self.suspect(job)

    def _oldest(self) -> str | None:
        """The finished job whose film was not looked at for longest, where that is long enough."""
        due = time.time() - self._every_s
        with self._sessions() as session:
            for looked_at in (Job.checked.is_(None), Job.checked < due):
                if (found := session.scalar(select(Job.id).where(Job.state == "finished", looked_at).limit(1))) is not None:
                    return found
        return None

    def _look(self, id: str) -> None:
        with self._sessions() as session:
            job = session.get(Job, id)
            frames = session.scalars(select(Frame).where(Frame.job == id)).all() if job is not None else ()
        if job is None:
            return
        again_s = self._every_s
        try:
            if _rests(job):
                self._see_to(job, {frame.number: frame.samples for frame in frames})
        except SettingsError:
            pass  # of another release: nobody can say what its film should have
        except FarmError as error:  # the film is held, the disk full, the database away
            log.warning("the film of %s is looked at later: %s", id, error)
            again_s = min(again_s, LATER_S)
        with self._sessions.begin() as session:
            session.execute(update(Job).where(Job.id == id).values(checked=time.time() - self._every_s + again_s))

    def _see_to(self, job: Job, recorded: dict[int, int]) -> None:
        settings = RenderSettings.from_json(job.settings or {})
        assert job.tile_size is not None
        try:
            check_film(self._films, job.id, settings, job.tile_size, recorded)
        except FilmDamaged as error:
            self._mend(job, settings, str(error))

    def _mend(self, job: Job, settings: RenderSettings, why: str) -> None:
        self._tries[job.id] += 1
        if self._tries[job.id] > TRIES:
            return
        assert job.tile_size is not None
        self._films.heal(job.id, settings, job.tile_size)
        is_anew = self._films.open(job.id, settings, job.tile_size).is_empty
        self._prepare(job.id)
        with self._sessions.begin() as session:
            row = session.get(Job, job.id, with_for_update=True)
            if row is None or not _rests(row):
                return
            if session.get(Scene, row.stage) is None:
                row.error = f"{FILM} was damaged, and its scene was deleted: what is missing cannot be rendered again."
                log.warning("%s: %s", row.id, row.error)
            else:
                set_state(row, "running", is_anew)
                history = History.of(row.history)
                history.happened("healed")
                row.history = history.to_json()
                log.warning("%s is rendered again, as far as it is missing: %s", row.id, why)
        self._events.publish(RowWritten("job", job.id))


def _rests(job: Job) -> bool:
    """Whether a job has all it asked for; or had, until its film was found damaged."""
    is_over = job.state == "finished" or (job.state == "failed" and FILM in (job.error or ""))
    return is_over and job.settings is not None and job.tile_size is not None
