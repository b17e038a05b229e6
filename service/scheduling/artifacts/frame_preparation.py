"""Preparation of the frames of shots: each frame is compiled shortly before it is rendered, within a storage limit.

Every frame of an animation has its own compiled scene, which can be compiled again and is deleted when the frame is finished.
If storage is short, the compiled scene of the frame that is needed last is deleted first; a shot rendered breadth-first
compiles it again later.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict

from protocol.contract import FrameInfo, PrepareFrames, prepare_queue
from renderer.sentences import Sentence
from renderer.settings import OPTIONAL
from service.scheduling.artifacts.lost_preparations import lost_leases
from service.scheduling.artifacts.unfit_machines import Destination, MachineFault, UnfitMachines
from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.dispatching.leases import Lease, Leases
from service.scheduling.fleet.workers import Workers
from service.scheduling.incoming.results import Results
from service.scheduling.jobs.active_frame import ActiveFrame
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.frame_bytes import additional_bytes, exclusive_bytes, total_bytes
from service.shot import variation_of

__all__ = ["FramePreparation"]

LOSSES_ALLOWED = 3
MIN_FRAMES_AHEAD = 4  # frames, at least
MAX_FRAMES_PER_MESSAGE = 32
MAX_CAMERA_ONLY_FRAMES = 500  # frames without a compiled scene, if only the camera moves
TARGET_S = 1.0  # target duration of frames handed out together
SHUTTER = tuple(name for name in OPTIONAL if name.startswith("shutter"))

FrameOf = Callable[[ActiveJob], dict[str, object]]  # returns the view that frames the scene, for PrepareFrames


class FramePreparation:
    """Selects the frames to prepare, and tracks the leases of their preparation. Used only by the engine's thread."""

    def __init__(self, dispatcher: Dispatcher, workers: Workers, deadline_s: float, max_bytes: int) -> None:
        """Stores the parameters.

        deadline_s: timeout of a lease in seconds. max_bytes: maximum size of the compiled frames of all jobs together, in bytes.
        """
        self._dispatcher = dispatcher
        self._workers = workers
        self._deadline_s = deadline_s
        self._room = max_bytes
        self.leases = Leases()
        self._frames: dict[str, set[int]] = {}  # unanswered frames, by lease
        self._seconds: dict[str, float] = {}  # preparation time per frame, by job
        self._sizes: dict[str, int] = {}  # unshared bytes of the latest frame, by job
        self._losses: Counter[tuple[str, int]] = Counter()
        self._unfit = UnfitMachines()
        self._unfit_kind: dict[str, str] = {}  # kind of the unfit workers, by job

    def dispatch_work(
        self, jobs: Iterable[tuple[ActiveJob, str | None]], automatic_view_of: FrameOf, busy: set[tuple[str, int]]
    ) -> list[ActiveJob]:
        """Sends the frames that are needed next to workers, to be prepared. Raises QueueError.

        jobs: the jobs in the order in which they are served, with the worker kind that renders each.
        automatic_view_of: returns the camera that frames a job's scene.
        busy: (job id, frame key) pairs with outstanding batches.

        Returns the jobs that lost a compiled frame because storage is short.
        """
        cleared = []
        shots = [(job, kind) for job, kind in jobs if job.shot is not None and kind is not None and kind in job.compiled]
        left = self._room - self._bytes_in_use([job for job, _ in shots])
        for job, kind in shots:
            if kind is None or len(self.leases.leases_of(job.id)) >= max(1, self._workers.roster.slots(kind) // 2):
                continue
            place = self._choose_destination(job.id, kind)
            if place is None:
                continue
            chosen, size = self._choose_frames(job, kind), self._sizes.get(job.id)
            if size is None:
                chosen = chosen[:1]
            if chosen and size and left < size:
                room = self._make_room(job, kind, chosen[0], busy)
                if room is None:
                    continue
                left += room
                cleared.append(job)
            if chosen and size:
                chosen = chosen[: max(1, left // size)]
                left -= len(chosen) * size
            if chosen:
                self._send(job, place, chosen, automatic_view_of(job))
        return cleared

    def discard_job(self, job: str) -> None:
        """Discards the state of a job that has ended or whose frames are planned again."""
        self._seconds.pop(job, None)
        self._sizes.pop(job, None)
        self._unfit.remove_owner(job)
        self._unfit_kind.pop(job, None)
        for key in [key for key in self._losses if key[0] == job]:
            del self._losses[key]
        for lease in self.leases.leases_of(job):
            self._end_lease(lease)

    def handle_answer(self, job: ActiveJob, work: str, frame: int, worker: str, info: FrameInfo | None) -> None:
        """Handles a worker's answer about a frame. work: lease id. frame: frame key.

        info: the prepared frame; None if the preparation failed.
        """
        if info is not None:
            before = self._seconds.get(job.id, info.seconds)
            self._seconds[job.id] = before + (info.seconds - before) / 2
            if info.compiled is None:
                self._sizes[job.id] = 0
            elif not info.compiled.parts or total_bytes([job]):  # otherwise the shared part is unknown
                self._sizes[job.id] = additional_bytes(job, asdict(info.compiled))
        lease = self.leases.get(work)
        if lease is None:
            return
        lease.holder, lease.unseen, lease.answered_by = worker, 0, None
        left = self._frames[work]
        if frame in left:
            left.discard(frame)
            self._mark_unprepared(job, [frame])
        if not left:
            self._end_lease(lease)

    def handle_return(self, job: ActiveJob, work: str, unfit: MachineFault | None = None) -> None:
        """Ends the lease (with the id `work`) of frames that a worker returned without preparing them.

        unfit: fault of that worker's machine, after which the frames are sent to another worker.
        """
        lease = self.leases.get(work)
        if lease is not None:
            self._mark_unprepared(job, self._end_lease(lease))
            if unfit is not None:
                self._unfit.add(job.id, unfit)
                self._unfit_kind[job.id] = lease.kind

    def impossible_jobs(self, jobs: Mapping[str, ActiveJob]) -> list[tuple[ActiveJob, str]]:
        """Returns the jobs whose frames no connected worker can prepare because of machine faults, with error sentences."""
        found = []
        for id, kind in self._unfit_kind.items():
            able = [each for each in self._workers.roster.reports.values() if each.kind == kind and each.frames]
            if id in jobs and able and not self.leases.leases_of(id) and self._unfit.next_destination(id, able) is None:
                found.append((jobs[id], self._unfit.error_message(id, Sentence("task-prepare-shot", "prepare this shot"))))
        return found

    def _choose_destination(self, job: str, kind: str) -> Destination | None:
        """Returns the worker or queue to which a job's next frames are sent; None if no suitable worker is left."""
        if job not in self._unfit:
            return Destination("", kind, prepare_queue(kind))
        ready = self._workers.roster.ready_reports()
        return self._unfit.next_destination(job, [report for report in ready if report.kind == kind and report.frames])

    def end_lost_leases(self, jobs: dict[str, ActiveJob], results: Results) -> list[tuple[ActiveJob, ActiveFrame]]:
        """Ends lost leases. Returns the frames whose preparation was lost too often. Called once a second.

        Raises redis.RedisError.
        """
        in_hand = {str(doing["work"]) for doing in self._workers.roster.current() if "work" in doing}
        hopeless = []
        for lease in self.leases:
            if lease.owner not in jobs:
                self._end_lease(lease)
        lost = lost_leases(self.leases, self._dispatcher, self._workers, results, lambda lease: lease.id in in_hand)
        for lease, is_waiting in lost:
            job, frames = jobs[lease.owner], self._end_lease(lease)
            self._mark_unprepared(job, frames)
            for frame in sorted(frames)[:1] if not is_waiting else ():  # the frame that was in progress
                self._losses[job.id, frame] += 1
                if self._losses[job.id, frame] >= LOSSES_ALLOWED and frame in job.frames:
                    hopeless.append((job, job.frames[frame]))
        return hopeless

    def _choose_frames(self, job: ActiveJob, kind: str) -> list[ActiveFrame]:
        """Returns the frames to prepare with the next message; empty if enough frames are ready to render.

        A message is filled, since each one interrupts a slot's rendering, unless slots may soon have nothing to render.
        """
        turns, seconds = job.agenda.turns, self._seconds.get(job.id)
        most = MAX_FRAMES_PER_MESSAGE if self._sizes.get(job.id) else MAX_CAMERA_ONLY_FRAMES
        together = 1 if seconds is None else max(1, min(most, int(TARGET_S / max(seconds, 1e-6))))
        ahead = max(MIN_FRAMES_AHEAD, 2 * self._workers.roster.slots(kind), 2 * together)
        lacking = turns.frames_to_prepare(kind, together)
        if not lacking:
            return []
        in_hand = sum(not frame.is_over and not frame.is_idle for frame in turns.preparing_frames())
        waiting = turns.count_ready_before(kind, job.agenda.sort_key(lacking[0]), ahead) + turns.count_without_guide(kind)
        room = ahead - in_hand - waiting
        if room < len(lacking) and waiting >= self._workers.roster.slots(kind):
            return []
        return lacking[: max(room, 0)]

    def _make_room(self, job: ActiveJob, kind: str, frame: ActiveFrame, busy: set[tuple[str, int]]) -> int | None:
        """Deletes the compiled scene of the idle frame that is needed last. Returns the number of bytes freed.

        Candidates are frames that are needed later than `frame`, or not needed at present, and are not in `busy`: (job id,
        frame key) pairs with outstanding batches. Returns None if the preparation of `frame` must wait for space. Returns 0 if
        nothing can be deleted but the job has no other work, so that `frame` is prepared anyway.
        """
        turn = job.agenda.sort_key(frame)
        idle = [
            f
            for f in job.agenda.turns.frames_with_own_scene()
            if f.own.keys() & f.compiled.keys() and (job.id, f.key) not in busy
        ]
        later = [f for f in idle if f.is_idle or job.agenda.sort_key(f) > turn]
        if later:
            victim = max(later, key=job.agenda.sort_key)
            gone = exclusive_bytes(job, victim)
            victim.compiled.clear()
            job.mark_changed(victim)
            return gone
        return 0 if job.agenda.next_frame(kind) is None and not self.leases.leases_of(job.id) else None

    def _bytes_in_use(self, jobs: list[ActiveJob]) -> int:
        """Returns the size of all compiled frames in bytes, including the expected size of frames in preparation."""
        awaited = sum(self._sizes.get(job.id, 0) * len(job.agenda.turns.preparing_frames()) for job in jobs)
        return awaited + sum(total_bytes(jobs).values())

    def _send(self, job: ActiveJob, place: Destination, frames: list[ActiveFrame], automatic_view: dict[str, object]) -> None:
        assert job.shot is not None
        lease = Lease(job.id, place.kind, None, self._deadline_s, queue=place.queue, only=place.worker)
        work = PrepareFrames(
            work=lease.id,
            job=job.id,
            scene=job.scene,
            frames=[frame.key for frame in frames],
            base=job.compiled[place.kind],
            base_auto=automatic_view,
            fps=job.shot.fps,
            clip=job.shot.clip,
            camera=job.request.get("camera"),
            view=job.request.get("view"),
            turntable=job.shot.turntable,
            shutter={name: job.request[name] for name in SHUTTER if job.request.get(name) is not None},
            vary=variation_of(job.request, job.shot),
        )
        self._dispatcher.send_frames(work, place.queue)
        self.leases.add(lease)
        self._frames[lease.id] = {frame.key for frame in frames}
        for frame in frames:
            frame.is_preparing = True
            job.mark_changed(frame)

    def _end_lease(self, lease: Lease) -> set[int]:
        self.leases.end(lease.id)
        return self._frames.pop(lease.id, set())

    def _mark_unprepared(self, job: ActiveJob, keys: Iterable[int]) -> None:
        for key in keys:
            if (frame := job.frames.get(key)) is not None:
                frame.is_preparing = False
                job.mark_changed(frame)
