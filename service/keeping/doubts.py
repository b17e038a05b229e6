"""Finds and marks the pictures with samples of a worker that was found to render something other than the rest.

In unfinished jobs such samples are removed at once (service/scheduling/trust/trust.py). A finished picture stays as it was
delivered: its job names the workers in doubt, and somebody can set it to running to render those samples again. A thread searches
the films at rest, using a fifth of a core; when the service starts, it does so for all workers that are still set aside.
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
from service.events import Events, RowWritten, WorkerSetAside
from service.store.database import Sessions
from service.store.film_store import FilmStore
from service.store.models import FINAL, Job

__all__ = ["Doubts"]

RESTS = 4  # times as long as it looked

log = logging.getLogger(__name__)


class Doubts:
    """One thread, notified by `WorkerSetAside`."""

    def __init__(self, sessions: Sessions, films: FilmStore, events: Events) -> None:
        self._sessions = sessions
        self._films = films
        self._events = events
        events.subscribe(WorkerSetAside, lambda event: self._wanted.put(event.worker))
        self._wanted: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="doubts", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End after the film in hand."""
        self._stopping.set()
        self._wanted.put(None)
        if self._thread.is_alive():
            self._thread.join(5)

    def _run(self) -> None:
        while (worker := self._wanted.get()) is not None and not self._stopping.is_set():
            try:
                self._look(worker)
            except FarmError as error:
                log.warning("pictures that hold samples of %s are not all marked: %s", worker, error)
            except Exception:
                log.exception("a fault while pictures that hold samples of %s were looked for", worker)

    def _look(self, worker: str) -> None:
        with self._sessions() as session:
            over = select(Job.id).where(Job.state.in_(FINAL), Job.kind.is_not(None)).order_by(Job.created.desc())
            jobs = list(session.scalars(over))
        found = 0
        for id in jobs:
            began = time.monotonic()
            try:
                found += self._see_to(id, worker)
            except FarmError as error:
                log.warning("whether the film of %s holds samples of %s is not known: %s", id, worker, error)
            if self._stopping.wait(RESTS * (time.monotonic() - began)):
                return
        log.info("%d finished jobs hold samples of %s", found, worker)

    def _see_to(self, id: str, worker: str) -> bool:
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
            return False  # of another release: it can be rendered no more
        if not self._films.open(id, settings, job.tile_size).has_sent(worker):
            return False
        with self._sessions.begin() as session:
            row = session.get(Job, id, with_for_update=True)
            if row is None or row.state not in FINAL:
                return False  # it goes on, and is dealt with as what is not over
            row.doubted = sorted({worker, *(row.doubted or ())})
        self._events.publish(RowWritten("job", id))
        return True
