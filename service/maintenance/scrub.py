"""Checks stored films: reads each completely from time to time, and queues jobs whose films lack samples.

A disk may return wrong bytes, a folder may be restored in part, a file may be deleted by hand. The engine notices damage to films
of active jobs, but a finished job's film may not be read for months. So when the service starts, a thread checks that each film
exists. Then it reads one film after another, the longest unchecked first, using a twentieth of a core. A film is checked at once
if reading it failed. A job whose film lacks samples is queued again, and ends with the same bits.
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
from renderer.sentences import Sentence
from renderer.settings import RenderSettings
from service.errors import FarmError, FilmDamaged
from service.events import Events, FilmSuspected, RowWritten
from service.scheduling.jobs.history import History
from service.scheduling.jobs.job_changes import set_state
from service.store.database import Sessions
from service.store.film_faults import FILM
from service.store.film_store import FilmStore
from service.store.models import Frame, Job, Scene

__all__ = ["Scrubber", "check_film"]

PAUSE_FACTOR = 19  # multiple of the check's duration
MAX_PAUSE_S = 60.0
SEARCH_EVERY_S = 600.0  # seconds between searches for due films
RETRY_AFTER_S = 3600.0  # seconds until a film that could not be read is tried again
TRIES = 3  # repairs of a job's film per run of the service: rendering cannot repair a failing disk
DAY_S = 86400.0

log = logging.getLogger(__name__)


def check_film(films: FilmStore, job: str, settings: RenderSettings, tile_size: int, recorded: Mapping[int, int]) -> None:
    """Reads a whole film and checks it. recorded: sample count of each frame in the database.

    Raises FilmDamaged, FilmLost, FilmUnavailable.
    """
    if not any(recorded.values()):
        return
    if not films.size(job):
        raise FilmDamaged(Sentence("film-emptied", "{film} is missing or was emptied.", film=FILM))
    has = films.verify(job, settings, tile_size)
    if lacking := [number for number, samples in recorded.items() if has.get(number, 0) < samples]:
        raise FilmDamaged(
            Sentence(
                "film-lacks-samples",
                "{film} lacks samples in {count} of {total} frames.",
                film=FILM,
                count=len(lacking),
                total=len(recorded),
            )
        )


class Scrubber:
    """Reads and checks films in a thread. `check_first` is thread-safe.

    A `FilmSuspected` event triggers an immediate check of the film.
    """

    def __init__(
        self,
        sessions: Sessions,
        films: FilmStore,
        prepare: Callable[[str], None],
        events: Events,
        every_days: float,
    ) -> None:
        """Stores the parameters.

        prepare: function that restores the scene of a job, given the job's id. every_days: period of the checks in days; 0: no
        checks.
        """
        self._sessions = sessions
        self._films = films
        self._prepare = prepare
        self._events = events
        events.subscribe(FilmSuspected, lambda event: self.check_first(event.job))
        self._every_s = every_days * DAY_S
        self._suspects: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._waiting: set[str] = set()  # elements of the queue
        self._tries: Counter[str] = Counter()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="scrub", daemon=True)

    def start(self) -> None:
        """Starts the thread, unless checks are disabled."""
        if self._every_s > 0:
            self._thread.start()

    def stop(self) -> None:
        """Stops the thread within seconds, after the film that it is reading."""
        self._stopping.set()
        self._suspects.put(None)
        if self._thread.is_alive():
            self._thread.join(5)

    def check_first(self, job: str) -> None:
        """Puts a job's film at the front of the films to check."""
        if self._every_s > 0 and job not in self._waiting:
            self._waiting.add(job)
            self._suspects.put(job)

    def _run(self) -> None:
        self._guarded(self._find_missing)
        rest_s = 0.0
        while not self._stopping.is_set():
            job = self._next_suspect(rest_s)
            is_suspect = job is not None
            began = time.monotonic()
            if job is None and not self._stopping.is_set():
                job = self._guarded(self._longest_due)
            if job is None or self._stopping.is_set():
                rest_s = SEARCH_EVERY_S
                continue
            self._guarded(lambda job=job: self._check_due_film(job))  # type: ignore[misc]
            rest_s = 0.0 if is_suspect else min(PAUSE_FACTOR * (time.monotonic() - began), MAX_PAUSE_S)

    def _next_suspect(self, timeout_s: float) -> str | None:
        try:
            job = self._suspects.get(timeout=timeout_s) if timeout_s > 0 else self._suspects.get_nowait()
        except queue.Empty:
            return None
        self._waiting.discard(job or "")
        return job

    def _guarded(self, action: Callable[[], str | None]) -> str | None:
        try:
            return action()
        except FarmError as error:
            log.warning("checking films is postponed: %s", error)
        except Exception:
            log.exception("unexpected error in the check of films")
        return None

    def _find_missing(self) -> None:
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
                self.check_first(job)

    def _longest_due(self) -> str | None:
        """Returns the id of the finished job whose check is longest overdue; None if no check is due."""
        due = time.time() - self._every_s
        with self._sessions() as session:
            for looked_at in (Job.checked.is_(None), Job.checked < due):
                if (found := session.scalar(select(Job.id).where(Job.state == "finished", looked_at).limit(1))) is not None:
                    return found
        return None

    def _check_due_film(self, id: str) -> None:
        with self._sessions() as session:
            job = session.get(Job, id)
            frames = session.scalars(select(Frame).where(Frame.job == id)).all() if job is not None else ()
        if job is None:
            return
        again_s = self._every_s
        try:
            if _is_ended(job):
                self._check(job, {frame.number: frame.samples for frame in frames})
        except SettingsError:
            pass  # of another release, whose settings cannot be interpreted
        except FarmError as error:  # the film is held, the disk full, the database away
            log.warning("checking the film of job %s is postponed: %s", id, error)
            again_s = min(again_s, RETRY_AFTER_S)
        with self._sessions.begin() as session:
            session.execute(update(Job).where(Job.id == id).values(checked=time.time() - self._every_s + again_s))

    def _check(self, job: Job, recorded: dict[int, int]) -> None:
        settings = RenderSettings.from_json(job.settings or {})
        assert job.tile_size is not None
        try:
            check_film(self._films, job.id, settings, job.tile_size, recorded)
        except FilmDamaged as error:
            self._repair(job, settings, str(error))

    def _repair(self, job: Job, settings: RenderSettings, why: str) -> None:
        self._tries[job.id] += 1
        if self._tries[job.id] > TRIES:
            return
        assert job.tile_size is not None
        self._films.delete_damaged(job.id, settings, job.tile_size)
        is_anew = self._films.open(job.id, settings, job.tile_size).is_empty
        self._prepare(job.id)
        with self._sessions.begin() as session:
            row = session.get(Job, job.id, with_for_update=True)
            if row is None or not _is_ended(row):
                return
            if session.get(Scene, row.compiled_scene_id) is None:
                row.error = Sentence(
                    "film-damaged-scene-deleted",
                    "{film} was damaged, and its scene was deleted: the missing samples cannot be rendered again.",
                    film=FILM,
                )
                log.warning("%s: %s", row.id, row.error)
            else:
                set_state(row, "running", is_anew)
                history = History.parse(row.history)
                history.add_event("healed")
                row.history = history.to_json()
                log.warning("the missing samples of job %s are rendered again: %s", row.id, why)
        self._events.publish(RowWritten("job", job.id))


def _is_ended(job: Job) -> bool:
    """Returns True if a job's film is not being changed.

    That is so if the job is finished, or if it failed because the film was damaged.
    """
    is_over = job.state == "finished" or (job.state == "failed" and FILM in (job.error or ""))
    return is_over and job.settings is not None and job.tile_size is not None
