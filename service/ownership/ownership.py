"""Ownership of the farm: this service has the latest epoch, and each of its writes is checked against it.

Timeouts decide when another service may take over, but never whether a write is allowed. That is checked in the writing
transaction itself: against the epoch in the database's row (`fence`), and in a film against a copy of it
(service/store/film_file.py). So a service that was suspended in the middle of a merge cannot write anything when it resumes.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from sqlalchemy import Engine, select, text
from sqlalchemy.orm import Session

from renderer.sentences import Sentence
from service.errors import FarmError, NotOwner, Unavailable
from service.ownership import rows
from service.ownership.folder_lock import FolderLock
from service.store.database import Sessions, close_database
from service.store.models import FarmOwner

__all__ = ["Ownership"]

CHECK_EVERY_S = 0.5
CONFIRM_AFTER = 0.6  # share of the lease after which ownership must be confirmed again
RETRY_AFTER_S = 1.0  # seconds before a database that did not respond is queried again
IDLE_TRANSACTION_TIMEOUT_MS = 5000  # ms; PostgreSQL ends a transaction that a suspended service left idle for this long
# KEY SHARE: the owner's transactions block neither each other nor requests and answers, but block a takeover.
POSTGRES_FENCE = text(
    "SELECT epoch, set_config('idle_in_transaction_session_timeout', :stuck, true) FROM owners WHERE what = :what FOR KEY SHARE"
)

log = logging.getLogger(__name__)


class Ownership:
    """Ownership of the farm, from `Candidate.attempt` until `stop` or until another service takes over. Thread-safe."""

    def __init__(
        self,
        engine: Engine,
        sessions: Sessions,
        lock: FolderLock,
        epoch: int,
        lease_s: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Stores the parameters of an ownership that was just acquired. sessions: database sessions without a fence."""
        self.engine = engine
        self.epoch = epoch
        self.sessions = sessions.fenced(self.fence)
        self._bare = sessions
        self._folder = lock
        self._doubt_s = CONFIRM_AFTER * lease_s
        self._clock = clock
        self._confirmed = clock()
        self._asked_in_vain = -RETRY_AFTER_S
        self._heard = False  # whether another service has asked for a sign of life
        self._said_locked = lock.is_held
        self._lost = threading.Event()
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._told = threading.Lock()  # taken once, so that `on_lost` is called once
        self._on_lost: Callable[[], None] = lambda: None
        self._moves: Callable[[], bool] = lambda: True
        self._thread = threading.Thread(target=self._run, name="owning", daemon=True)

    def start(self, on_lost: Callable[[], None], moves: Callable[[], bool]) -> None:
        """Starts the thread that answers services that want to take over the farm.

        on_lost: called once, from a thread, after another service has taken over. moves: returns whether this service makes
        progress; while it returns False, requests are not answered, so that another service takes over.
        """
        self._on_lost, self._moves = on_lost, moves
        self._thread.start()

    def stop(self) -> None:
        """Stops answering candidates, releases the farm, and closes the database."""
        self._stop.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join()
        try:
            if not self.is_lost:
                rows.give_up(self._bare, self.epoch)
        except FarmError as error:
            log.info("the release of the farm cannot be recorded, so the next service has to wait: %s", error)
        close_database(self.engine)
        self._folder.release()

    @property
    def is_lost(self) -> bool:
        """Returns True if another service has taken over."""
        return self._lost.is_set()

    @property
    def is_doubtful(self) -> bool:
        """Returns True if the last confirmation is so old that another service may have taken over since."""
        return self.is_lost or self._clock() - self._confirmed > self._doubt_s

    def fence(self, session: Session) -> None:
        """Raises NotOwner, which aborts the transaction, if this service is no longer the owner."""
        if session.get_bind().dialect.name == "postgresql":
            found = session.execute(POSTGRES_FENCE, {"what": rows.FARM, "stuck": str(IDLE_TRANSACTION_TIMEOUT_MS)}).scalar()
        else:
            found = session.scalar(select(FarmOwner.epoch).where(FarmOwner.what == rows.FARM))
        if found != self.epoch:
            self._handle_loss()
            raise NotOwner

    def guard(self) -> None:
        """Checks ownership before an action. Does not access the database if ownership was confirmed recently.

        Raises NotOwner, or Unavailable if another service may own the farm and the database does not respond.
        """
        if self.is_lost:
            raise NotOwner
        if not self.is_doubtful:
            return
        with self._lock:
            if not self.is_lost and self.is_doubtful and self._clock() - self._asked_in_vain > RETRY_AFTER_S:
                try:
                    self.confirm()
                except FarmError as error:
                    self._asked_in_vain = self._clock()
                    log.debug("ownership of the farm cannot be confirmed: %s", error)
        if self.is_lost:
            raise NotOwner
        if self.is_doubtful and self._heard:
            raise Unavailable(
                Sentence(
                    "farm-ownership-uncertain",
                    "The database does not say whether this service still owns the farm. Try again in a moment.",
                )
            )

    def confirm(self) -> None:
        """Confirms ownership by reading the owner's row, and answers a candidate's request if there is one.

        Raises Unavailable.
        """
        began = self._clock()
        row = rows.current_owner(self._bare)
        if row is None or row.epoch != self.epoch:
            self._handle_loss()
            return
        self._heard = self._heard or row.asked != row.answered
        has_lock = self._folder.attempt()
        answered = row.asked if self._moves() else row.answered
        if (answered, has_lock) != (row.answered, self._said_locked):
            if not rows.record_answer(self._bare, self.epoch, answered, has_lock):
                self._handle_loss()
                return
            self._said_locked = has_lock
        self._confirmed = began

    def _handle_loss(self) -> None:
        self._lost.set()
        self._stop.set()
        if self._told.acquire(blocking=False):
            log.warning("another service has taken over the farm: this one writes nothing from now on")
            threading.Thread(target=self._on_lost, name="lost", daemon=True).start()

    def _run(self) -> None:
        while not self._stop.wait(CHECK_EVERY_S):
            try:
                self.confirm()
            except FarmError as error:
                log.debug("ownership of the farm cannot be confirmed: %s", error)
            except Exception:
                log.exception("unexpected error while the owner of the farm was checked")
