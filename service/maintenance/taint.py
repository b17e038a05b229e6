"""Marks finished jobs that contain samples of a distrusted worker, one whose results were wrong.

In unfinished jobs such samples are removed at once (service/scheduling/trust/trust.py). A finished picture is not changed: its
job lists the workers, and a PATCH to running renders those samples again. A thread searches the stored films, using a fifth of a
core; when the service starts, it searches for all distrusted workers.
"""

from __future__ import annotations

import logging
import queue
import threading
import time

from sqlalchemy import select

from renderer.errors import SettingsError
from renderer.settings import RenderSettings
from service.errors import FarmError
from service.events import Events, RowWritten, WorkerQuarantined
from service.store.database import Sessions
from service.store.film_store import FilmStore
from service.store.models import FINAL_STATES, Job

__all__ = ["TaintMarker"]

PAUSE_FACTOR = 4  # multiple of the search's duration

log = logging.getLogger(__name__)


class TaintMarker:
    """Searches finished jobs for samples of distrusted workers, in a thread. `WorkerQuarantined` events trigger a search."""

    def __init__(self, sessions: Sessions, films: FilmStore, events: Events) -> None:
        self._sessions = sessions
        self._films = films
        self._events = events
        events.subscribe(WorkerQuarantined, lambda event: self._wanted.put(event.worker))
        self._wanted: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="taint", daemon=True)

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Stops the thread after the film that it is reading."""
        self._stopping.set()
        self._wanted.put(None)
        if self._thread.is_alive():
            self._thread.join(5)

    def _run(self) -> None:
        while (worker := self._wanted.get()) is not None and not self._stopping.is_set():
            try:
                self._mark_jobs(worker)
            except FarmError as error:
                log.warning("not all jobs with samples of worker %s are marked: %s", worker, error)
            except Exception:
                log.exception("unexpected error while jobs with samples of worker %s were searched", worker)

    def _mark_jobs(self, worker: str) -> None:
        with self._sessions() as session:
            finished = select(Job.id).where(Job.state.in_(FINAL_STATES), Job.kind.is_not(None)).order_by(Job.created.desc())
            jobs = list(session.scalars(finished))
        found = 0
        for id in jobs:
            began = time.monotonic()
            try:
                found += self._mark_job(id, worker)
            except FarmError as error:
                log.warning("the film of %s could not be searched for samples of %s: %s", id, worker, error)
            if self._stopping.wait(PAUSE_FACTOR * (time.monotonic() - began)):
                return
        log.info("%d finished jobs have samples of the distrusted worker %s", found, worker)

    def _mark_job(self, id: str, worker: str) -> bool:
        with self._sessions() as session:
            job = session.get(Job, id)
        if (
            job is None
            or job.settings is None
            or job.tile_size is None
            or worker in (job.doubted or ())
            or not self._films.size(id)
        ):
            return False
        try:
            settings = RenderSettings.from_json(job.settings)
        except SettingsError:
            return False  # of another release, whose settings cannot be interpreted
        if not self._films.open(id, settings, job.tile_size).has_sums_of(worker):
            return False
        with self._sessions.begin() as session:
            row = session.get(Job, id, with_for_update=True)
            if row is None or row.state not in FINAL_STATES:
                return False  # it continues, and trust.py removes the samples
            row.doubted = sorted({worker, *(row.doubted or ())})
        self._events.publish(RowWritten("job", id))
        return True
