"""Garbage collection of blobs: deletes those to which no scene, environment, reference picture or frame refers.

Pinned blobs are not deleted. An upload pins its blobs until its scene is recorded. A blob stored by a worker is pinned until
its message must have arrived. The lock is held while the row that referred to blobs is deleted and the blobs to delete are
selected; the blobs are then deleted without the lock, in portions. Pinning a blob removes it from the pending deletions, or
waits until its deletion is done. So code that pins a blob and then finds or stores it can rely on its existence.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from sqlalchemy import Select, Text, cast, or_, select
from sqlalchemy.orm import Session

from service.errors import FarmError
from service.events import ArtifactStored, BlobsReleased
from service.store.blobs import BlobStore
from service.store.database import Sessions
from service.store.models import Environment, Frame, Reference, Scene

__all__ = ["Garbage"]

FEW_BLOBS = 2
AT_A_TIME = 256  # blobs deleted between two checks for new pins
REFERRING: dict[Any, tuple[Any, ...]] = {  # tables, and their columns that refer to blobs
    Scene: (Scene.files, Scene.compiled, Scene.info),
    Environment: (Environment.file, Environment.thumbnail),
    Reference: (Reference.file, Reference.film),
    Frame: (Frame.compiled,),
}

log = logging.getLogger(__name__)


class Garbage:
    """Deletes unreferenced blobs. No other part of the service deletes blobs of scenes. Thread-safe."""

    def __init__(
        self, sessions: Sessions, blobs: BlobStore, max_unreferenced_s: float, guard: Callable[[], None] = lambda: None
    ) -> None:
        """Stores the parameters.

        max_unreferenced_s: seconds for which a blob stored by a worker may stay unreferenced. guard: raises FarmError if
        deleting is not allowed.
        """
        self._sessions = sessions
        self._blobs = blobs
        self._max_unreferenced_s = max_unreferenced_s
        self._guard = guard
        self._lock = threading.Lock()
        self._deleted = threading.Condition(self._lock)
        self._pins: Counter[str] = Counter()
        self._promised: dict[str, list[float]] = {}  # expiry times, one for each time the blob was stored
        self._left: set[str] = set()  # unreferenced blobs that were kept because they were pinned
        self._going: set[str] = set()  # to be deleted
        self._deleting: set[str] = set()  # being deleted

    @contextmanager
    def pinned(self, hashes: Iterable[str]) -> Iterator[None]:
        """Context manager that pins blobs, whether they exist or not, while a scene is created from them."""
        mine = set(hashes)
        with self._lock:
            self._pins.update(mine)
            self._cancel_deletions(mine)
        try:
            yield
        except BaseException:
            with self._lock:
                self._left |= mine  # no scene was created
            raise
        finally:
            with self._lock:
                self._pins.subtract(mine)
                self._pins += Counter()  # removes zero counts
                leftover = bool(self._released_blobs())
            if leftover:
                with contextlib.suppress(FarmError):  # the next collection deletes them
                    self.collect(lambda session: set())

    def pin_until_recorded(self, sha256: str) -> None:
        """Pins a blob that a worker stores, until a reference to it is recorded, but at most for `max_unreferenced_s` seconds."""
        with self._lock:
            self._drop_expired_pins()
            self._pin_for_a_while(sha256)
            self._cancel_deletions({sha256})

    def adopt_unreferenced(self, hashes: set[str]) -> None:
        """Registers unreferenced blobs that were found at the start of the service.

        A worker may have stored some of them with its message still in transit. Those without a reference after
        `max_unreferenced_s` seconds are deleted by the next collection.
        """
        with self._lock:
            for sha256 in hashes:
                self._pin_for_a_while(sha256)
            self._left |= hashes

    def remove_pins(self, sha256: str, times: int = 1) -> None:
        """Removes `times` pins made by `pin_until_recorded`, because the blob is now referenced or was never stored."""
        with self._lock:
            if left := self._promised.pop(sha256, [])[times:]:
                self._promised[sha256] = left

    def handle_artifact(self, event: ArtifactStored) -> None:
        """Does not delete an artifact's blob until it is released, if it was found unreferenced at the start of the service."""
        with self._lock:
            self._left.discard(event.sha256)

    def handle_release(self, event: BlobsReleased) -> None:
        """Removes one pin of each blob per counted reference of the event, and deletes blobs that are now unreferenced."""
        for sha256, times in event.references.items():
            self.remove_pins(sha256, times)
        self.collect(lambda session: set(event.references))

    def collect(self, change: Callable[[Session], set[str]]) -> None:
        """Makes a database change, then deletes the blobs that are no longer referenced or pinned.

        change: makes the change in the session, and returns the hashes of the blobs to which it removed references.
        """
        with self._lock:
            with self._sessions.begin() as session:
                gone = change(session) | self._released_blobs()
                session.flush()
                for query in _queries_of_possible_references(gone) if gone else ():
                    for row in session.scalars(query):
                        gone -= row.blobs
            needed = {sha256 for sha256 in gone if self._is_pinned(sha256)}
            self._left = (self._left - self._released_blobs()) | needed
            self._going |= gone - needed
        while self._delete_some():
            pass

    def _delete_some(self) -> bool:
        """Deletes one portion of the pending blobs. Returns whether there was one."""
        with self._lock:
            some = {self._going.pop() for _ in range(min(AT_A_TIME, len(self._going)))}
            self._deleting |= some
        failed = True
        try:
            if some:
                self._blobs.delete(some, self._guard)  # guarded: another service may have taken over and made a scene of them
            failed = False
        except (FarmError, OSError) as error:  # the database change stands; the next collection tries again
            log.warning("%d blobs are not deleted yet: %s", len(some), error)
        finally:
            with self._deleted:
                self._deleting -= some
                self._left |= some if failed else set()
                self._deleted.notify_all()
        return bool(some)

    def _cancel_deletions(self, hashes: set[str]) -> None:
        """Prevents the deletion of these blobs, which were just pinned.

        Removes them from the pending deletions. If another thread is deleting some of them, waits until it has finished: those
        blobs are gone afterwards, and the caller must store them again.
        """
        self._left |= hashes & self._going
        self._going -= hashes
        self._deleted.wait_for(lambda: not hashes & self._deleting)

    def _released_blobs(self) -> set[str]:
        """Returns the unreferenced blobs that are still to be deleted, and that are not pinned any more."""
        self._drop_expired_pins()
        return {sha256 for sha256 in self._left if not self._is_pinned(sha256)}

    def _is_pinned(self, sha256: str) -> bool:
        return sha256 in self._pins or sha256 in self._promised

    def _pin_for_a_while(self, sha256: str) -> None:
        self._promised.setdefault(sha256, []).append(time.monotonic() + self._max_unreferenced_s)

    def _drop_expired_pins(self) -> None:
        now = time.monotonic()
        left = {sha256: [until for until in untils if until > now] for sha256, untils in self._promised.items()}
        self._promised = {sha256: untils for sha256, untils in left.items() if untils}


def _queries_of_possible_references(hashes: set[str]) -> list[Select[Any]]:
    """Returns queries for the rows that may refer to one of these blobs.

    For at most FEW blobs, the database filters the rows by text search. For more, the queries return all rows that can have
    references.
    """
    found: list[Select[Any]] = []
    for table, columns in REFERRING.items():
        query = select(table)
        if len(hashes) <= FEW_BLOBS:
            query = query.where(or_(*(cast(column, Text).contains(sha256) for column in columns for sha256 in hashes)))
        elif table is Frame:
            query = query.where(Frame.compiled.is_not(None))
        found.append(query)
    return found
