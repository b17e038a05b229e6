"""Denoised frames: asked for by readers, made by a worker, kept until the film goes on.

A film that grows makes its denoised picture old at once. So a request while one is being made waits for that one, and the
next request asks for a new one. Pictures are blobs that no database names: after a restart they are made again.
"""

from __future__ import annotations

import contextlib
import threading
from concurrent.futures import Future
from dataclasses import dataclass, field

from service.errors import Failed, FarmError, NotFound, TooLate, Unavailable
from service.scheduling.dispatch import Dispatcher, QueueError
from service.scheduling.leases import Lease
from service.scheduling.workers import Workers
from service.store.blobs import BlobStore, is_sha256
from worker.contract import DenoiseFrame

__all__ = ["Denoised", "Denoising"]

PATIENCE_S = 60.0
PATIENCE_S_PER_PIXEL = 1e-5
Key = tuple[str, int]  # job, frame


@dataclass(frozen=True)
class Denoised:
    """A denoised frame: its blob (as worker.contract.DenoiseFrame says), and of which film content it is."""

    sha256: str
    version: str
    samples: int


@dataclass
class _Wanted:
    width: int
    height: int
    answer: Future[Denoised] = field(default_factory=Future)
    lease: Lease | None = None


class Denoising:
    """Asked by any thread; handed out and heard about in the engine's."""

    def __init__(self, dispatcher: Dispatcher, workers: Workers, blobs: BlobStore) -> None:
        self._dispatcher = dispatcher
        self._workers = workers
        self._blobs = blobs
        self._lock = threading.Lock()
        self._wanted: dict[Key, _Wanted] = {}
        self._made: dict[Key, Denoised] = {}

    def want(self, job: str, frame: int, version: str, width: int, height: int) -> Future[Denoised]:
        """The frame, denoised: of this version or of a newer one; or of one a moment older that is just being made.

        The future has a FarmError where it cannot be made. Raises Unavailable where no worker can.
        """
        made = self._made.get((job, frame))
        # Asked without the lock, for which the engine's thread would wait: the store may be far away.
        if made is not None and made.version == version and self._blobs.exists(made.sha256):
            done: Future[Denoised] = Future()
            done.set_result(made)
            return done
        with self._lock:
            wanted = self._wanted.get((job, frame))
            if wanted is None:
                if self._workers.roster.denoising_kind() is None:
                    raise self._nobody()
                wanted = self._wanted[job, frame] = _Wanted(width, height)
            return wanted.answer

    def fill(self) -> None:
        """Hand out what is wanted and not in hand. Raises QueueError."""
        for key, wanted in self._waiting():
            kind = self._workers.roster.denoising_kind()
            if kind is None:
                self._fail(key, self._nobody())
                continue
            patience = PATIENCE_S + PATIENCE_S_PER_PIXEL * wanted.width * wanted.height
            lease = Lease(key[0], kind, None, patience)
            work = DenoiseFrame(lease.id, *key, wanted.width, wanted.height)
            try:
                self._dispatcher.send_denoise(work, kind)
            except QueueError as error:
                self._fail(key, Unavailable(f"Redis does not answer ({error}). Try again when it does."))
                raise
            wanted.lease = lease

    def heard(self, work: str, made: Denoised | None, error: str = "") -> None:
        """A worker has made it, or says why not."""
        with self._lock:
            key = next((key for key, wanted in self._wanted.items() if wanted.lease and wanted.lease.id == work), None)
        if key is None:
            return  # too late, or of an earlier life of the service
        if made is None or not is_sha256(made.sha256) or not self._is_there(made.sha256):
            self._fail(key, Failed(f"The picture could not be denoised: {(error or 'its file is missing').rstrip('.')}."))
            return
        with self._lock:
            wanted = self._wanted.pop(key, None)
            old = self._made.get(key)
            self._made[key] = made
        if old is not None and old.sha256 != made.sha256:
            self._delete(old.sha256)
        if wanted is not None:
            wanted.answer.set_result(made)

    def review(self) -> None:
        """Once a second: give up on what does not come back."""
        with self._lock:
            late = [key for key, wanted in self._wanted.items() if wanted.lease is not None and wanted.lease.is_overdue]
        for key in late:
            self._fail(key, TooLate("No worker gave the denoised picture in time; they may be busy. Try again."))

    def forget(self, job: str) -> None:
        """The job is deleted."""
        with self._lock:
            gone = [self._made.pop(key) for key in list(self._made) if key[0] == job]
            waiting = [key for key in self._wanted if key[0] == job]
        for made in gone:
            self._delete(made.sha256)
        for key in waiting:
            self._fail(key, NotFound("The job was deleted while its picture was denoised."))

    def _is_there(self, sha256: str) -> bool:
        try:
            return self._blobs.exists(sha256)
        except FarmError:
            return False  # the store is away: as good as missing

    def _delete(self, sha256: str) -> None:
        with contextlib.suppress(FarmError):  # the next start sweeps what no scene refers to
            self._blobs.delete(sha256)

    def _waiting(self) -> list[tuple[Key, _Wanted]]:
        with self._lock:
            return [(key, wanted) for key, wanted in self._wanted.items() if wanted.lease is None]

    def _fail(self, key: Key, error: FarmError) -> None:
        with self._lock:
            wanted = self._wanted.pop(key, None)
        if wanted is not None:
            wanted.answer.set_exception(error)

    def _nobody(self) -> Unavailable:
        if not self._workers.roster.ready():
            return Unavailable("Denoising needs a worker, and none is connected. Start one, then ask again.")
        return Unavailable(
            "No worker has Open Image Denoise. Install it beside one (pip install 'pyoidn>=2.5,<3'), and start that anew.",
        )
