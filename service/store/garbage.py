"""Which blobs can be deleted: those that no scene and no frame refers to, and that nobody is about to refer to.

An upload pins its blobs until its scene is recorded; what a worker stores is pinned until its answer must have arrived. Blobs
are deleted under the lock by which they are pinned, together with the row that referred to them. So code that pins a blob and
then finds or stores it can rely on it.
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
from service.store.blobs import BlobStore
from service.store.database import Sessions
from service.store.models import Environment, Frame, Reference, Scene

__all__ = ["Garbage"]

FEW = 2
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
        self._pins: Counter[str] = Counter()
        self._promised: dict[str, list[float]] = {}  # until when, once for each time that it was stored
        self._left: set[str] = set()  # what would have gone, had it not been pinned

    @contextmanager
    def pinned(self, hashes: Iterable[str]) -> Iterator[None]:
        """Keep blobs, whether they are there already or will be put, while somebody makes a scene of them."""
        mine = set(hashes)
        with self._lock:
            self._pins.update(mine)
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
                leftover = bool(self._left)
            if leftover:
                with contextlib.suppress(FarmError):  # the next one to collect takes them along
                    self.collect(lambda session: set())

    def promise(self, sha256: str) -> None:
        """A worker stores a blob, and will say for which scene."""
        with self._lock:
            self._forget_promises()
            self._promised.setdefault(sha256, []).append(time.monotonic() + self._patience_s)

    def keep_promise(self, sha256: str, times: int = 1) -> None:
        """What was promised is referred to by now, or was never stored."""
        with self._lock:
            if left := self._promised.pop(sha256, [])[times:]:
                self._promised[sha256] = left

    def let_go(self, counts: Counter[str]) -> None:
        """Delete those of these blobs that nobody needs. A worker had promised each so often, and they were referred to since."""
        for sha256, times in counts.items():
            self.keep_promise(sha256, times)
        self.collect(lambda session: set(counts))

    def collect(self, let_go: Callable[[Session], set[str]]) -> None:
        """Change the database by a function that returns the blobs that it let go of, and delete those that nobody needs."""
        with self._lock:
            with self._sessions.begin() as session:
                gone = let_go(session) | self._left
                session.flush()
                for query in _that_may_refer_to(gone) if gone else ():
                    for row in session.scalars(query):
                        gone -= row.blobs
            self._forget_promises()
            self._left = {sha256 for sha256 in gone if sha256 in self._pins or sha256 in self._promised}
            for sha256 in gone - self._left:
                try:
                    self._guard()  # since that was written down, another service may have made a scene of it
                    self._blobs.delete(sha256)
                except (FarmError, OSError) as error:  # what was written down stands; the next one to collect takes it along
                    log.warning("the blob %s stays for now: %s", sha256, error)
                    self._left.add(sha256)

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
