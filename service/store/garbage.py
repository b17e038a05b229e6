"""Which blobs can be deleted: those that no scene and no frame refers to, and that nobody is about to refer to.

An upload pins its blobs until its scene is recorded; what a worker stores is pinned until its answer must have arrived. What is
to go is decided under the lock by which blobs are pinned, together with the row that referred to them, and then deleted without
it, some at a time. Whoever pins a blob takes it off what is to go, or waits until it has gone. So code that pins a blob and then
finds or stores it can rely on it.
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
from service.events import BlobsReleased
from service.store.blobs import BlobStore
from service.store.database import Sessions
from service.store.models import Environment, Frame, Reference, Scene

__all__ = ["Garbage"]

FEW = 2
AT_A_TIME = 256  # blobs that are deleted between two looks at who has pinned one since
REFERRING: dict[Any, tuple[Any, ...]] = {  # tables, and their columns that refer to blobs
    Scene: (Scene.files, Scene.compiled, Scene.info),
    Environment: (Environment.file, Environment.thumbnail),
    Reference: (Reference.file, Reference.film),
    Frame: (Frame.compiled,),
}

log = logging.getLogger(__name__)


class Garbage:
    """The one place that deletes blobs of scenes. Safe to use from several threads."""

    def __init__(self, sessions: Sessions, blobs: BlobStore, patience_s: float, guard: Callable[[], None] = lambda: None) -> None:
        """patience_s: how long what a worker stored may wait for the scene that will refer to it. guard: raises FarmError where
        none may be deleted."""
        self._sessions = sessions
        self._blobs = blobs
        self._patience_s = patience_s
        self._guard = guard
        self._lock = threading.Lock()
        self._deleted = threading.Condition(self._lock)
        self._pins: Counter[str] = Counter()
        self._promised: dict[str, list[float]] = {}  # until when, once for each time that it was stored
        self._left: set[str] = set()  # what would have gone, had it not been pinned
        self._going: set[str] = set()  # what is to be deleted
        self._deleting: set[str] = set()  # what is being deleted

    @contextmanager
    def pinned(self, hashes: Iterable[str]) -> Iterator[None]:
        """Keep blobs, whether they are there already or will be put, while somebody makes a scene of them."""
        mine = set(hashes)
        with self._lock:
            self._pins.update(mine)
            self._save(mine)
        try:
            yield
        except BaseException:
            with self._lock:
                self._left |= mine  # no scene came of them
            raise
        finally:
            with self._lock:
                self._pins.subtract(mine)
                self._pins += Counter()  # forgets those that are 0
                leftover = bool(self._free())
            if leftover:
                with contextlib.suppress(FarmError):  # the next one to collect takes them along
                    self.collect(lambda session: set())

    def promise(self, sha256: str) -> None:
        """A worker stores a blob, and will say for which scene."""
        with self._lock:
            self._forget_promises()
            self._promise(sha256)
            self._save({sha256})

    def inherit(self, hashes: set[str]) -> None:
        """Nobody refers to these blobs of an earlier life. Some of them a worker may have stored, whose answer is still on its
        way; those that have none in time go with the next to collect."""
        with self._lock:
            for sha256 in hashes:
                self._promise(sha256)
            self._left |= hashes

    def keep_promise(self, sha256: str, times: int = 1) -> None:
        """What was promised is referred to by now, or was never stored."""
        with self._lock:
            if left := self._promised.pop(sha256, [])[times:]:
                self._promised[sha256] = left

    def release(self, event: BlobsReleased) -> None:
        """Delete those of these blobs that nobody needs. A worker had promised each so often, and they were referred to since."""
        for sha256, times in event.references.items():
            self.keep_promise(sha256, times)
        self.collect(lambda session: set(event.references))

    def collect(self, let_go: Callable[[Session], set[str]]) -> None:
        """Change the database by a function that returns the blobs that it let go of, and delete those that nobody needs."""
        with self._lock:
            with self._sessions.begin() as session:
                gone = let_go(session) | self._free()
                session.flush()
                for query in _that_may_refer_to(gone) if gone else ():
                    for row in session.scalars(query):
                        gone -= row.blobs
            needed = {sha256 for sha256 in gone if self._is_kept(sha256)}
            self._left = (self._left - self._free()) | needed
            self._going |= gone - needed
        while self._delete_some():
            pass

    def _delete_some(self) -> bool:
        """Delete some of what is to go; whether there was any."""
        with self._lock:
            some = {self._going.pop() for _ in range(min(AT_A_TIME, len(self._going)))}
            self._deleting |= some
        failed = True
        try:
            if some:
                self._blobs.delete(some, self._guard)  # another service may have made a scene of them since
            failed = False
        except (FarmError, OSError) as error:  # what was written down stands; the next one to collect takes it along
            log.warning("%d blobs stay for now: %s", len(some), error)
        finally:
            with self._deleted:
                self._deleting -= some
                self._left |= some if failed else set()
                self._deleted.notify_all()
        return bool(some)

    def _save(self, hashes: set[str]) -> None:
        """What was pinned is not deleted; what is being deleted already will be gone."""
        self._left |= hashes & self._going
        self._going -= hashes
        self._deleted.wait_for(lambda: not hashes & self._deleting)

    def _free(self) -> set[str]:
        """What was left, and is not kept by anybody now."""
        self._forget_promises()
        return {sha256 for sha256 in self._left if not self._is_kept(sha256)}

    def _is_kept(self, sha256: str) -> bool:
        return sha256 in self._pins or sha256 in self._promised

    def _promise(self, sha256: str) -> None:
        self._promised.setdefault(sha256, []).append(time.monotonic() + self._patience_s)

    def _forget_promises(self) -> None:
        now = time.monotonic()
        left = {sha256: [until for until in untils if until > now] for sha256, untils in self._promised.items()}
        self._promised = {sha256: untils for sha256, untils in left.items() if untils}


def _that_may_refer_to(hashes: set[str]) -> list[Select[Any]]:
    """The rows of which some may refer to one of these blobs. Of few blobs the database finds them, and they alone are read."""
    found: list[Select[Any]] = []
    for table, columns in REFERRING.items():
        query = select(table)
        if len(hashes) <= FEW:
            query = query.where(or_(*(cast(column, Text).contains(sha256) for column in columns for sha256 in hashes)))
        elif table is Frame:
            query = query.where(Frame.compiled.is_not(None))
        found.append(query)
    return found
