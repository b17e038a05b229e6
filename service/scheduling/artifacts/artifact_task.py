"""Artifacts: files that workers make when clients request them, such as denoised frames, motion vectors and thumbnails;
and path guides, which the engine requests.

If a machine cannot make an artifact, the request is sent to another worker (unfit_machines.py).

An artifact is outdated as soon as its film grows. A client that requests one while it is being made receives that one; the next
request starts a new one. Artifacts are blobs to which the database does not refer; all but denoised frames are made again after a
restart.
"""

from __future__ import annotations

import contextlib
import threading
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

from protocol.contract import DenoiseFrame, FrameVectors, ShowEnvironment, TrainPathGuide, WorkerReport, prepare_queue
from renderer.sentences import Sentence
from service.errors import AnswerTimeout, Failed, FarmError, NotFound, QueueError, Unavailable
from service.events import ArtifactStored, BlobsReleased, Events
from service.scheduling.artifacts.artifact_result import ArtifactResult
from service.scheduling.artifacts.unfit_machines import MachineFault, UnfitMachines
from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.dispatching.leases import Lease
from service.scheduling.faults.redis_errors import redis_unavailable
from service.scheduling.fleet.workers import Workers
from service.store.blobs import BlobStore, is_sha256

__all__ = ["ArtifactResult", "ArtifactTask", "Key"]

TIMEOUT_S_PER_PIXEL = 1e-5
MAX_UNSEEN_POLLS = 10  # consecutive polls without a holder, since a crashed slot restarts its work
MAX_ATTEMPTS = 3
Key = tuple[str, int]  # job, frame

Request = TypeVar("Request", DenoiseFrame, FrameVectors, ShowEnvironment, TrainPathGuide)


@dataclass
class _PendingRequest(Generic[Request]):
    request: Request
    answer: Future[ArtifactResult] = field(default_factory=Future)
    lease: Lease | None = None
    sent: int = 0
    begun: float = field(default_factory=time.monotonic)


class ArtifactTask(ABC, Generic[Request]):
    """Base class of artifacts of one type.

    Any thread may request one. The engine's thread dispatches the requests and handles the answers. A separate thread queries
    the blob store, which may be slow.
    """

    _patience_s = 60.0
    _doing: str  # the job name in workers' reports about this work

    def __init__(self, dispatcher: Dispatcher, workers: Workers, blobs: BlobStore, events: Events) -> None:
        self._dispatcher = dispatcher
        self._workers = workers
        self._blobs = blobs
        self._events = events
        self._aside = ThreadPoolExecutor(1, thread_name_prefix="aside")
        self._lock = threading.Lock()
        self._wanted: dict[Key, _PendingRequest[Request]] = {}
        self._unfit = UnfitMachines()
        self._made: dict[Key, ArtifactResult] = {}

    @property
    def has_requests(self) -> bool:
        """Returns True if a client waits for an artifact. Thread-safe."""
        return bool(self._wanted)

    @abstractmethod
    def _kind(self, request: Request) -> str | None:
        """Returns the worker kind that can make the requested artifact; None if there is none."""

    @abstractmethod
    def _able_workers(self) -> list[WorkerReport]:
        """Returns the ready workers that can make this artifact."""

    @abstractmethod
    def _send(self, request: Request, queue: str) -> None:
        """Sends a request to a queue. The request's field `work` is the id of its lease. Raises QueueError."""

    def _queue(self, kind: str) -> str:
        """Returns the queue for requests of this artifact to workers of this kind."""
        return prepare_queue(kind)

    def _patience(self, request: Request) -> float:
        """Returns the seconds after which a request without an answer fails."""
        return self._patience_s + TIMEOUT_S_PER_PIXEL * request.width * request.height

    def _room(self) -> int | None:
        """Returns how many requests may be sent now; None for any number."""
        return None

    @abstractmethod
    def _is_size(self, size: int, request: Request) -> bool:
        """Returns True if `size`, in bytes, is a plausible size of the requested artifact."""

    @abstractmethod
    def _no_worker_error(self) -> Unavailable:
        """Returns the error that is raised if no worker can make this artifact."""

    @property
    @abstractmethod
    def _name(self) -> str:
        """The name of this artifact in error messages."""

    def request(self, request: Request, version: str = "") -> Future[ArtifactResult]:
        """Requests an artifact, and returns a future of it.

        request: its field `work` is set later. version: required version of the film; a newer one is accepted. If the same
        artifact is already being made, returns the future of that one. The future raises FarmError if the artifact cannot be
        made. Raises Unavailable if no worker can make it.
        """
        job, frame = request.job, request.frame
        made = self._made.get((job, frame))
        # Queried without the lock, which the engine's thread needs: the store may be slow.
        if made is not None and made.version == version and self._blobs.exists(made.sha256):
            done: Future[ArtifactResult] = Future()
            done.set_result(made)
            return done
        with self._lock:
            wanted = self._wanted.get((job, frame))
            if wanted is None:
                if self._kind(request) is None:
                    raise self._no_worker_error()
                wanted = self._wanted[job, frame] = _PendingRequest(request)
            return wanted.answer

    def answer_of(self, job: str, frame: int) -> Future[ArtifactResult] | None:
        """Returns the future of a frame's artifact that is being made; None if there is none. Thread-safe."""
        with self._lock:
            wanted = self._wanted.get((job, frame))
            return None if wanted is None else wanted.answer

    def waiting_s(self, job: str, frame: int) -> float:
        """Returns the seconds since the request for a frame's artifact that is still being made; 0 without one. Thread-safe."""
        with self._lock:
            wanted = self._wanted.get((job, frame))
            return 0.0 if wanted is None else time.monotonic() - wanted.begun

    def supersede(self, job: str, frame: int, better: Future[ArtifactResult]) -> None:
        """Drops the request of a frame's artifact, unless it was sent. Thread-safe.

        better: its clients receive the result of this future.
        """
        with self._lock:
            wanted = self._wanted.get((job, frame))
            if wanted is None or wanted.lease is not None:
                return
            del self._wanted[job, frame]

        def pass_on(done: Future[ArtifactResult]) -> None:
            error = done.exception()
            if error is None:
                wanted.answer.set_result(done.result())
            else:
                wanted.answer.set_exception(error)

        better.add_done_callback(pass_on)

    def dispatch_work(self) -> None:
        """Sends the requests that are not in progress to workers. Raises QueueError."""
        for key, wanted in self._unsent_requests()[: self._room()]:
            kind = self._kind(wanted.request)
            if kind is None:
                self._fail_request(key, self._no_worker_error())
                continue
            queue = self._queue(kind)
            owner = _lease_owner(key)
            if owner in self._unfit:
                place = self._unfit.next_destination(owner, self._able_workers())
                if place is None:
                    self._fail_request(
                        key,
                        Failed(
                            self._unfit.error_message(
                                owner, Sentence("task-make-artifact", "make the {artifact}", artifact=self._name)
                            )
                        ),
                    )
                    continue
                kind, queue = place.kind, place.queue
            lease = Lease(key[0], kind, None, self._patience(wanted.request))
            try:
                self._send(replace(wanted.request, work=lease.id), queue)
            except QueueError as error:
                self._fail_request(key, redis_unavailable(error))
                raise
            wanted.lease = lease
            wanted.sent += 1

    def handle_answer(self, work: str, result: ArtifactResult | None, error: str = "", unfit: MachineFault | None = None) -> None:
        """Handles a worker's answer to a request. work: the id in the request's field `work`.

        result: the artifact; None if the worker failed with the message `error`. unfit: fault of that worker's machine, after
        which the request is sent to another worker.
        """
        with self._lock:
            key = next((key for key, wanted in self._wanted.items() if wanted.lease and wanted.lease.id == work), None)
            if key is not None and (lease := self._wanted[key].lease) is not None:
                lease.has_arrived = True
        if key is None:
            return  # late, or from before a restart
        if result is None and unfit is not None:
            with self._lock:
                if (wanted := self._wanted.get(key)) is not None:
                    self._unfit.add(_lease_owner(key), unfit)
                    wanted.lease, wanted.sent = None, 0
        elif result is None:
            self._fail_request(key, self._failure(error))
        else:
            self._run_in_background(self._keep_result, key, work, result)

    def _keep_result(self, key: Key, work: str, result: ArtifactResult) -> None:
        with self._lock:
            wanted = self._wanted.get(key)
        is_there = wanted is not None and is_sha256(result.sha256) and self._is_stored(result.sha256, wanted.request)
        with self._lock:
            if wanted is None or self._wanted.get(key) is not wanted or wanted.lease is None or wanted.lease.id != work:
                return  # given up meanwhile, or its job was deleted
            del self._wanted[key]
            self._unfit.remove_owner(_lease_owner(key))
            old = self._made.get(key)
            result = replace(result, waited_s=time.monotonic() - wanted.begun)
            if is_there:
                self._made[key] = result
                self._record_made(result, wanted.request)
        if not is_there:
            wanted.answer.set_exception(self._failure(""))
            return
        self._events.publish(ArtifactStored(result.sha256))
        wanted.answer.set_result(result)
        self._record_duration(wanted.request, result.waited_s)
        self._save_made()
        if old is not None and old.sha256 != result.sha256:
            self._delete(old.sha256)

    def _save_made(self) -> None:
        """Called after a change of the stored artifacts, in the thread that queries the blob store."""

    def _record_duration(self, request: Request, seconds: float) -> None:
        """Called after an artifact was stored, with the seconds since its request."""

    def _record_made(self, result: ArtifactResult, request: Request) -> None:
        """Called with each artifact that was made, and its request, under the lock."""

    def release(self, job: str, frame: int) -> None:
        """Releases a frame's artifact, if it was made."""
        with self._lock:
            made = self._made.pop((job, frame), None)
        if made is not None:
            self._run_in_background(self._delete, made.sha256)

    def release_lost(self) -> None:
        """Ends the leases of requests that were lost with their worker, and fails overdue requests. Called once a second."""
        with self._lock:
            self._release_lost()
            late = [
                key
                for key, wanted in self._wanted.items()
                if wanted.lease is not None and wanted.lease.is_overdue(time.monotonic())
            ]
        for key in late:
            self._fail_request(
                key,
                AnswerTimeout(
                    Sentence(
                        "artifact-timeout",
                        "No worker delivered the {artifact} in time; they may be busy. Try again.",
                        artifact=self._name,
                    )
                ),
            )

    def _release_lost(self) -> None:
        """Ends the leases of requests that no worker reports any more, so that they are sent again.

        When a worker is killed, its current request is lost, and the broker would deliver it again only much later.
        """
        if not self._wanted:
            return
        doing = [(report.name, each) for report in self._workers.roster.reports.values() for each in report.current]
        held = {(str(each.get(self._doing)), str(each.get("frame"))): name for name, each in doing}
        for (job, frame), wanted in self._wanted.items():
            lease = wanted.lease
            if lease is None or lease.has_arrived:
                continue
            holder = held.get((job, str(frame)))
            lease.holder = holder or lease.holder
            lease.unseen = 0 if holder or not lease.holder else lease.unseen + 1
            if lease.unseen >= MAX_UNSEEN_POLLS and wanted.sent < MAX_ATTEMPTS:
                wanted.lease = None

    def discard_job(self, job: str) -> None:
        """Fails the open requests of a deleted job and releases its artifacts."""
        with self._lock:
            gone = [self._made.pop(key) for key in list(self._made) if key[0] == job]
            waiting = [key for key in self._wanted if key[0] == job]
        for key in waiting:
            self._fail_request(
                key,
                NotFound(
                    Sentence(
                        "artifact-job-deleted", "The job was deleted while a worker made its {artifact}.", artifact=self._name
                    )
                ),
            )
        if gone:
            self._run_in_background(self._save_made)
        for made in gone:
            self._run_in_background(self._delete, made.sha256)

    def close(self) -> None:
        """Stops the thread that queries the blob store."""
        self._aside.shutdown(wait=False, cancel_futures=True)

    def _run_in_background(self, function: Callable[..., None], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # during shutdown
            self._aside.submit(function, *arguments)

    def _failure(self, reason: str) -> FarmError:
        return Failed(
            Sentence(
                "artifact-failed",
                "The {artifact} could not be made: {reason}.",
                artifact=self._name,
                reason=(reason or Sentence("artifact-file-missing", "its file is missing, or of another size")).rstrip("."),
            )
        )

    def _is_stored(self, sha256: str, request: Request) -> bool:
        try:
            size = self._blobs.size(sha256)
        except FarmError:
            return False  # an unreachable store counts as a missing blob
        return size is not None and self._is_size(size, request)

    def _delete(self, sha256: str) -> None:
        with self._lock:
            if any(made.sha256 == sha256 for made in self._made.values()):  # equal artifacts are one blob
                return
        self._events.publish(BlobsReleased(Counter([sha256])))  # other references to this blob may exist

    def _unsent_requests(self) -> list[tuple[Key, _PendingRequest[Request]]]:
        with self._lock:
            return [(key, wanted) for key, wanted in self._wanted.items() if wanted.lease is None]

    def _fail_request(self, key: Key, error: FarmError) -> None:
        with self._lock:
            wanted = self._wanted.pop(key, None)
            self._unfit.remove_owner(_lease_owner(key))
        if wanted is not None:
            wanted.answer.set_exception(error)


def _lease_owner(key: Key) -> str:
    return f"{key[0]} {key[1]}"
