"""Denoised frames: asked for by readers, made by a worker, kept until the film goes on.

A film that grows makes its denoised picture old at once. So a request while one is being made waits for that one, and the
next request asks for a new one. Pictures are blobs that no database names: after a restart they are made again.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
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
    """Asked by any thread; handed out and heard about in the engine's. What the blobs are asked is asked in a thread of its own:
    their store may be far away.
    """

    def __init__(self, dispatcher: Dispatcher, workers: Workers, blobs: BlobStore) -> None:
        self._dispatcher = dispatcher
        self._workers = workers
        self._blobs = blobs
        self._aside = ThreadPoolExecutor(1, thread_name_prefix="denoised")
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
        if made is None:
            self._fail(key, self._failed(error))
        else:
            self._later(self._keep, key, work, made)

    def _keep(self, key: Key, work: str, made: Denoised) -> None:
        is_there = is_sha256(made.sha256) and self._is_there(made.sha256)
        with self._lock:
            wanted = self._wanted.get(key)
            if wanted is None or wanted.lease is None or wanted.lease.id != work:
                return  # given up meanwhile, or its job is deleted
            del self._wanted[key]
            old = self._made.get(key)
            if is_there:
                self._made[key] = made
        if not is_there:
            wanted.answer.set_exception(self._failed(""))
            return
        wanted.answer.set_result(made)
        if old is not None and old.sha256 != made.sha256:
            self._delete(old.sha256)

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
        for key in waiting:
            self._fail(key, NotFound("The job was deleted while its picture was denoised."))
        for made in gone:
            self._later(self._delete, made.sha256)

    def close(self) -> None:
        """Ask the blobs nothing any more."""
        self._aside.shutdown(wait=False, cancel_futures=True)

    def _later(self, function: Callable[..., None], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # the service ends
            self._aside.submit(function, *arguments)

    def _failed(self, why: str) -> Failed:
        return Failed(f"The picture could not be denoised: {(why or 'its file is missing').rstrip('.')}.")

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
