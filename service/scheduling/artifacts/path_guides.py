"""Path guides of the frames of jobs with `guiding`: one slot trains a frame's guide, and the others read it.

A frame's batches are dispatched when its guide is trained; meanwhile slots render other frames and jobs. If no worker can train
it, or all that read such requests are paused, each slot that renders the frame trains it, to the same bits.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass

from protocol.contract import TrainPathGuide, WorkerReport
from renderer.frames import frame_number, frame_text
from renderer.guiding.stored_guide import MAX_BYTES
from renderer.sentences import Sentence
from service.errors import FarmError, Unavailable
from service.events import Events
from service.scheduling.artifacts.artifact_result import ArtifactResult
from service.scheduling.artifacts.artifact_task import ArtifactTask, Key
from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.fleet.workers import Workers
from service.scheduling.jobs.active_frame import ActiveFrame
from service.scheduling.jobs.active_job import ActiveJob
from service.store.blobs import BlobStore

__all__ = ["PathGuides"]

MIN_FRAMES_AHEAD = 4  # frames with a guide that wait for slots, at least


@dataclass(frozen=True)
class _Awaited:
    """A guide that was requested for a worker kind at a monotonic time."""

    kind: str
    since: float
    answer: Future[ArtifactResult]


class PathGuides(ArtifactTask[TrainPathGuide]):
    """Requests for path guides. Only the engine's thread requests them."""

    _name = Sentence("artifact-path-guide", "path guide")
    _doing = "path_guide"
    _patience_s = 600.0  # the kernel of pilot paths may have to be compiled first

    def __init__(self, dispatcher: Dispatcher, workers: Workers, blobs: BlobStore, events: Events) -> None:
        super().__init__(dispatcher, workers, blobs, events)
        self._awaited: dict[Key, _Awaited] = {}

    def request_guides(self, jobs: Mapping[str, ActiveJob], kind_for: Callable[[ActiveJob], str | None]) -> None:
        """Requests the guides of the frames that are rendered next, and passes those that were trained on to their frames.

        There is at most one open request per slot, so that many jobs neither fill the queue nor exceed its patience.
        jobs: the active jobs. kind_for: returns the worker kind that renders a job, or None.
        """
        self._hand_over(jobs)
        requested = Counter(awaited.kind for awaited in self._awaited.values())
        for job in _in_order(job for job in jobs.values() if job.is_guided):
            kind = kind_for(job)
            if kind is not None and kind in job.compiled:
                for frame in self._frames_in_need(job, kind, requested[kind]):
                    self._request_guide(job, frame, kind)
                    requested[kind] += (job.id, frame.key) in self._awaited
        self._release_unneeded(jobs)

    def discard_job(self, job: str) -> None:
        """Discards the open requests and the guides of a job that was deleted, has ended or is loaded again."""
        for key in [key for key in self._awaited if key[0] == job]:
            del self._awaited[key]
        super().discard_job(job)

    def release_lost(self) -> None:
        """Also fails requests that no worker has begun and none reads any more, since only slots with cards are left."""
        super().release_lost()
        roster = self._workers.roster
        with self._lock:
            unread = [
                key
                for key, wanted in self._wanted.items()
                if (lease := wanted.lease) is not None
                and not (lease.holder or lease.has_arrived)
                and roster.slots(lease.kind)
                and not roster.reads_preparation(lease.kind)
            ]
        for key in unread:
            self._fail_request(key, self._no_worker_error())

    def _frames_in_need(self, job: ActiveJob, kind: str, requested: int) -> list[ActiveFrame]:
        """Returns the frames whose guides are requested now: few more than are rendered soon.

        requested: number of open requests, of all jobs for this kind.
        """
        slots, turns = self._workers.roster.slots(kind), job.agenda.turns
        if requested >= slots:  # also after a restart, until the workers report
            return []
        frames = turns.frames_without_guide(kind, max(1, slots // 2))
        ahead = max(MIN_FRAMES_AHEAD, 2 * slots)
        if not frames or turns.count_ready_before(kind, job.agenda.sort_key(frames[0]), ahead) >= ahead:
            return []
        return [frame for frame in frames if (job.id, frame.key) not in self._awaited][: slots - requested]

    def _request_guide(self, job: ActiveJob, frame: ActiveFrame, kind: str) -> None:
        self.release(job.id, frame.key)  # that of another worker kind, with which the job has not started
        request = TrainPathGuide("", job.id, frame.key, kind, frame.compiled[kind], frame.settings or job.settings)
        try:
            self._awaited[job.id, frame.key] = _Awaited(kind, time.monotonic(), self.request(request))
        except Unavailable:
            self._set_guide(job, frame, kind, "")

    def _hand_over(self, jobs: Mapping[str, ActiveJob]) -> None:
        for key, awaited in list(self._awaited.items()):
            if not awaited.answer.done():
                continue
            del self._awaited[key]
            job = jobs.get(key[0])
            frame = job.frames.get(key[1]) if job is not None else None
            if job is None or frame is None:
                continue
            name = Sentence("label-frame", "frame {frame}", frame=frame_text(frame_number(frame.key)))
            try:
                found = awaited.answer.result().sha256
                job.history.log.add_line(f"the path guide of {name} was trained in {time.monotonic() - awaited.since:.2f} s")
            except FarmError as error:
                found = ""  # each slot trains it
                job.history.log.add_line(f"{name}: {error}")
            self._set_guide(job, frame, awaited.kind, found)

    def _set_guide(self, job: ActiveJob, frame: ActiveFrame, kind: str, sha256: str) -> None:
        frame.guides[kind] = sha256
        job.mark_changed(frame)

    def _release_unneeded(self, jobs: Mapping[str, ActiveJob]) -> None:
        """Releases the guides of frames that are finished, and of jobs that have ended."""
        with self._lock:
            made = list(self._made)
        for job, key in made:
            frame = jobs[job].frames.get(key) if job in jobs else None
            if (job, key) not in self._awaited and (frame is None or frame.is_over):
                self.release(job, key)

    def _kind(self, request: TrainPathGuide) -> str | None:
        roster = self._workers.roster
        trains = all(report.trains_guides for report in roster.ready_reports() if report.kind == request.kind)
        return request.kind if trains and roster.reads_preparation(request.kind) else None

    def _able_workers(self) -> list[WorkerReport]:
        return [report for report in self._workers.roster.ready_reports() if report.trains_guides]

    def _send(self, request: TrainPathGuide, queue: str) -> None:
        self._dispatcher.send_path_guide(request, queue)

    def _is_size(self, size: int, request: TrainPathGuide) -> bool:
        return 0 < size <= MAX_BYTES

    def _no_worker_error(self) -> Unavailable:
        return Unavailable(
            Sentence("path-guide-needs-worker", "No ready worker can train path guides. Start one, or resume a paused one.")
        )


def _in_order(jobs: Iterable[ActiveJob]) -> list[ActiveJob]:
    """Returns the unfinished jobs by priority, then in turn by share, as they are rendered, and by age."""
    found = [job for job in jobs if job.state in ("queued", "running") and not job.is_done]
    earlier: Counter[tuple[int, str]] = Counter()
    turns: dict[str, int] = {}
    for job in sorted(found, key=lambda job: job.created):
        turns[job.id] = earlier[job.priority, job.share]
        earlier[job.priority, job.share] += 1
    return sorted(found, key=lambda job: (-job.priority, turns[job.id], job.created))
