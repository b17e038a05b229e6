"""Denoised frames: made by a worker on request, and stored until the film changes, also over restarts of the service."""

from __future__ import annotations

from collections.abc import Collection

from protocol.contract import DenoiseFrame, WorkerReport, denoise_queue
from renderer.sentences import Sentence
from service.errors import Unavailable
from service.events import Events, FrameDenoised
from service.scheduling.artifacts.artifact_result import ArtifactResult
from service.scheduling.artifacts.artifact_task import ArtifactTask, Key
from service.scheduling.artifacts.kept_artifacts import KeptArtifacts
from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.fleet.workers import Workers
from service.store.blobs import BlobStore

__all__ = ["MAX_STORED_BYTES", "DenoisedLights", "Denoising"]

MAX_STORED_BYTES = 2 << 30  # of denoised light groups: four frames of the largest size (service.jobs.denoised)
_GUIDE_S = 60.0  # seconds to render the guide, of a worker that may have to fetch the scene and its kernel
_MOMENT_S = 600.0  # if the frame is compiled again


class Denoising(ArtifactTask[DenoiseFrame]):
    """Requests for denoised frames. The result is valid for one version of the film."""

    _name = Sentence("artifact-denoised-picture", "denoised picture")
    _doing = "denoise"

    _kept: KeptArtifacts | None = None
    _precedents: Collection[Denoising] = ()

    def yield_to(self, others: Collection[Denoising]) -> None:
        """Makes these requests wait while those of `others` occupy the slots for denoising. Called once, before any request."""
        self._precedents = others

    def keep_in(self, kept: KeptArtifacts) -> None:
        """Loads the results of an earlier run, and stores those of this one. Called once, before any request."""
        self._kept = kept
        self._made.update(kept.load())

    def made_of(self, job: str, frame: int, version: str) -> ArtifactResult | None:
        """Returns the denoised frame of this version of its film, if it is stored. Thread-safe; the store may be slow."""
        made = self._made.get((job, frame))
        return made if made is not None and made.version == version and self._blobs.exists(made.sha256) else None

    def last_of(self, job: str, frame: int) -> ArtifactResult | None:
        """Returns the latest denoised picture of a frame, also of an older film; None if there is none. Its blob may be lost."""
        return self._made.get((job, frame))

    def is_stored(self, made: ArtifactResult) -> bool:
        """Returns True if a picture's blob is stored. Thread-safe; the store may be slow."""
        return self._blobs.exists(made.sha256)

    def blobs_of(self, jobs: Collection[str]) -> set[str]:
        """Returns the hashes of the stored frames of these jobs, and forgets those of all others.

        Their jobs were deleted, but an earlier run was killed before it stored that.
        """
        with self._lock:
            for key in [key for key in self._made if key[0] not in jobs]:
                del self._made[key]
            return {made.sha256 for made in self._made.values()}

    def _save_made(self) -> None:
        if self._kept is not None:
            with self._lock:
                made = dict(self._made)
            self._kept.save(made)

    def _record_duration(self, request: DenoiseFrame, seconds: float) -> None:
        if not (request.is_preview or request.frames):
            self._events.publish(FrameDenoised(request.job, request.width * request.height, seconds))

    def _kind(self, request: DenoiseFrame) -> str | None:
        return self._workers.roster.denoising_kind()

    def _able_workers(self) -> list[WorkerReport]:
        return [report for report in self._workers.roster.ready_reports() if report.denoises]

    def _queue(self, kind: str) -> str:
        return denoise_queue(kind)

    def _room(self) -> int | None:
        """Returns how many requests may be sent now. One slot remains for live views and batches, if there are several.

        The others wait here, where they can be superseded; without workers they fail at once.
        """
        slots = sum(report.slots for report in self._able_workers())
        if not slots:
            return None
        sent = self._count_sent() + sum(each._count_sent() for each in self._precedents)
        return max(max(slots - 1, 1) - sent, 0)

    def _count_sent(self) -> int:
        with self._lock:
            return sum(wanted.lease is not None for wanted in self._wanted.values())

    def _send(self, request: DenoiseFrame, queue: str) -> None:
        self._dispatcher.send_denoise(request, queue)

    def _patience(self, request: DenoiseFrame) -> float:
        guide = request.guide
        more = 0.0 if guide is None else _GUIDE_S if guide.moment is None else _MOMENT_S
        return super()._patience(request) * max(1, len(request.frames), len(request.lights)) + more

    def _is_size(self, size: int, request: DenoiseFrame) -> bool:
        return size == _size_of(request)

    def _no_worker_error(self) -> Unavailable:
        if not self._workers.roster.ready_reports():
            return Unavailable(
                Sentence(
                    "denoising-needs-worker",
                    "Denoising needs a worker, but none is ready. Start one, or resume a paused one, then try again.",
                )
            )
        return Unavailable(
            Sentence(
                "denoising-needs-oidn",
                "No worker has Open Image Denoise. Install it for one (pip install 'pyoidn>=2.5,<3'), and restart that worker.",
            ),
        )


class DenoisedLights(Denoising):
    """Requests for the denoised light of all light groups of a frame, which clients mix. Not kept over restarts.

    At most MAX_STORED_BYTES bytes are stored for all frames of all jobs; beyond that, the oldest results are deleted, and made
    again on request.
    """

    _name = Sentence("artifact-denoised-lights", "denoised light groups")

    def __init__(self, dispatcher: Dispatcher, workers: Workers, blobs: BlobStore, events: Events) -> None:
        super().__init__(dispatcher, workers, blobs, events)
        self._bytes: dict[Key, int] = {}  # in the order in which they were made; some may be released

    def _record_made(self, result: ArtifactResult, request: DenoiseFrame) -> None:
        latest = request.job, request.frame
        self._bytes.pop(latest, None)
        self._bytes = {key: size for key, size in self._bytes.items() if key in self._made}
        self._bytes[latest] = _size_of(request)
        while sum(self._bytes.values()) > MAX_STORED_BYTES and len(self._bytes) > 1:
            oldest = next(iter(self._bytes))
            del self._bytes[oldest]
            self._run_in_background(self._delete, self._made.pop(oldest).sha256)


def _size_of(request: DenoiseFrame) -> int:
    """Returns the size of a requested picture in bytes: three float32 a pixel, for each of its light groups."""
    return 3 * 4 * request.width * request.height * max(1, len(request.lights))
