"""Preparation of scenes: workers compile a scene's files for the kernels. Lost requests are sent again."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from protocol.blends import WAITS_FOR_BLENDER, blender_queue
from protocol.contract import ScenePreview, WorkerReport, prepare_queue
from renderer.sentences import Sentence, joined_sentences
from service.scheduling.artifacts.lost_preparations import lost_leases
from service.scheduling.artifacts.unfit_machines import Destination, MachineFault, UnfitMachines
from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.dispatching.leases import Lease, Leases
from service.scheduling.fleet.workers import Workers
from service.scheduling.incoming.results import Results

__all__ = ["Progress", "ScenePreparations"]

LOSSES_ALLOWED = 3


@dataclass(frozen=True)
class Progress:
    """Progress of preparing a scene: name of the current step, and the fraction done in [0, 1].

    preview: simple geometry that viewers can draw, available once the scene was read.
    """

    step: str
    fraction: float
    preview: ScenePreview | None = None


NO_BLENDER = Progress(WAITS_FOR_BLENDER, 0.0)


class ScenePreparations:
    """The scenes to prepare, each for one worker kind. The kind None stands for the kind with the most slots."""

    def __init__(self, dispatcher: Dispatcher, workers: Workers, deadline_s: float) -> None:
        self._dispatcher = dispatcher
        self._workers = workers
        self._deadline_s = deadline_s
        self._wanted: dict[tuple[str, str | None], int] = {}  # (scene, kind) -> number of losses
        self._by_blender: set[str] = set()
        self._unfit = UnfitMachines()
        self.leases = Leases()
        self.progress: dict[str, Progress] = {}

    def request(self, scene: str, kind: str | None, by_blender: bool = False) -> None:
        """Requests the preparation of a scene. by_blender: whether only workers with Blender can prepare it."""
        self._wanted.setdefault((scene, kind), 0)
        if by_blender:
            self._by_blender.add(scene)

    def remove_scene(self, scene: str) -> None:
        """Removes all requests for a scene that was deleted, prepared or failed."""
        for key in [key for key in self._wanted if key[0] == scene]:
            del self._wanted[key]
        self._by_blender.discard(scene)
        self._unfit.remove_owner(scene)
        self.progress.pop(scene, None)
        for lease in self.leases.leases_of(scene):
            self.leases.end(lease.id)

    def forget_kind(self, scene: str, kind: str) -> None:
        """Removes the request for a scene that is now prepared for this worker kind. Requests for other kinds remain."""
        self._wanted.pop((scene, kind), None)
        self._wanted.pop((scene, None), None)
        self._by_blender.discard(scene)
        self._unfit.remove_owner(scene)
        self.progress.pop(scene, None)
        for lease in self.leases.leases_of(scene):
            if lease.kind == kind:
                self.leases.end(lease.id)

    def dispatch_work(self) -> None:
        """Sends the requests without a lease to workers. Raises QueueError."""
        for scene, wanted_kind in list(self._wanted):
            roster, by_blender = self._workers.roster, scene in self._by_blender
            kind = roster.blender_kind() if by_blender else wanted_kind or roster.best_kind()
            out = self.leases.leases_of(scene)
            if any(wanted_kind in (None, lease.kind) for lease in out):
                continue
            if by_blender and kind is None and roster.ready_reports():
                self.progress[scene] = NO_BLENDER
            if kind is None or not roster.slots(kind):
                continue
            place = Destination("", kind, blender_queue(kind) if by_blender else prepare_queue(kind))
            if scene in self._unfit:
                other = self._unfit.next_destination(scene, self._able_workers(scene, wanted_kind, roster.ready_reports()))
                if other is None:
                    continue
                place = other
            lease = Lease(scene, place.kind, None, self._deadline_s, queue=place.queue, only=place.worker)
            self._dispatcher.send_prepare(scene, lease.queue, lease.id)
            self.leases.add(lease)
            if self.progress.get(scene) == NO_BLENDER:
                del self.progress[scene]

    def impossible_requests(self) -> list[tuple[str, str | None, str]]:
        """Returns the requests that no connected worker can serve because of machine faults: (scene, kind, error sentence)."""
        found = []
        for scene, kind in self._wanted:
            if scene not in self._unfit or any(kind in (None, lease.kind) for lease in self.leases.leases_of(scene)):
                continue
            able = self._able_workers(scene, kind, self._workers.roster.reports.values())
            if able and self._unfit.next_destination(scene, able) is None:
                found.append(
                    (scene, kind, self._unfit.error_message(scene, Sentence("task-prepare-scene", "prepare this scene")))
                )
        return found

    def _able_workers(self, scene: str, kind: str | None, reports: Iterable[WorkerReport]) -> list[WorkerReport]:
        """Returns the workers among `reports` that can prepare a scene for this kind."""
        by_blender, has_blender = scene in self._by_blender, self._workers.roster.has_blender
        return [each for each in reports if kind in (None, each.kind) and (not by_blender or has_blender(each.name))]

    def handle_progress(self, scene: str, kind: str, worker: str, progress: Progress | None) -> None:
        """Records that a worker is preparing a scene, and its progress if not None."""
        for lease in self.leases.leases_of(scene):
            if lease.kind == kind:
                lease.holder = worker
                lease.unseen, lease.answered_by = 0, None
        if progress is not None:
            before = self.progress.get(scene)
            self.progress[scene] = replace(progress, preview=progress.preview or (before.preview if before else None))

    def mark_answered(self, scene: str, kind: str) -> None:
        """Marks a preparation as answered, so that its lease cannot become lost while the answer waits for the database."""
        for lease in self.leases.leases_of(scene):
            if lease.kind == kind:
                lease.has_arrived = True

    def handle_return(self, scene: str, kind: str, reason: str, unfit: MachineFault | None = None) -> None:
        """Ends the lease of a scene that a worker returned through no fault of the scene. The scene will be sent again.

        reason: error sentence of the worker. unfit: fault of that worker's machine, after which the scene is sent to another
        worker.
        """
        for lease in self.leases.leases_of(scene):
            if lease.kind == kind:
                self.leases.end(lease.id)
                if unfit is not None:
                    self._unfit.add(scene, unfit)
                    reason = str(unfit)
                self.progress[scene] = Progress(
                    joined_sentences(reason, Sentence("advice-retried-automatically", "It will be retried.")), 0.0
                )

    def reject_answer(self, scene: str, kind: str) -> bool:
        """Ends the lease of a scene after an unusable answer, so that the scene is sent again.

        Returns True if that has happened too often.
        """
        for lease in self.leases.leases_of(scene):
            if lease.kind == kind:
                self.leases.end(lease.id)
                for key in [(scene, kind), (scene, None)]:
                    if key in self._wanted:
                        self._wanted[key] += 1
                        return self._wanted[key] >= LOSSES_ALLOWED
        return False

    def end_lost_leases(self, results: Results) -> list[tuple[str, str | None]]:
        """Ends lost leases. Returns the (scene, kind) pairs whose preparation was lost too often. Called once a second.

        Raises redis.RedisError.
        """
        in_hand = {str(doing["scene"]) for doing in self._workers.roster.current() if "scene" in doing}
        hopeless = []
        lost = lost_leases(self.leases, self._dispatcher, self._workers, results, lambda lease: lease.owner in in_hand)
        for lease, _ in lost:
            self.leases.end(lease.id)
            for key in [(lease.owner, lease.kind), (lease.owner, None)]:
                if key in self._wanted:
                    self._wanted[key] += lease.holder is not None
                    if self._wanted[key] >= LOSSES_ALLOWED:
                        hopeless.append(key)
        return hopeless
