"""Motion vectors of frames. A worker computes them on request from the scene's files. They depend only on the request."""

from __future__ import annotations

from protocol.contract import FrameVectors, WorkerReport
from renderer.sentences import Sentence
from service.errors import Unavailable
from service.scheduling.artifacts.artifact_task import ArtifactTask

__all__ = ["Vectors"]


class Vectors(ArtifactTask[FrameVectors]):
    """Requests for motion vectors. They do not depend on the film's samples, so an artifact stays valid."""

    _name = Sentence("artifact-motion-vectors", "motion vectors")
    _doing = "vectors"
    _patience_s = 600.0  # the scene is read and compiled first

    def _kind(self, request: FrameVectors) -> str | None:
        return self._workers.roster.motion_vector_kind()

    def _able_workers(self) -> list[WorkerReport]:
        return [report for report in self._workers.roster.ready_reports() if report.vectors]

    def _send(self, request: FrameVectors, queue: str) -> None:
        self._dispatcher.send_vectors(request, queue)

    def _is_size(self, size: int, request: FrameVectors) -> bool:
        return size == 4 * 4 * request.width * request.height

    def _no_worker_error(self) -> Unavailable:
        if not self._workers.roster.ready_reports():
            return Unavailable(
                Sentence(
                    "motion-vectors-need-worker",
                    "Motion vectors need a worker, but none is ready. Start one, or resume a paused one, then try again.",
                )
            )
        return Unavailable(
            Sentence(
                "motion-vectors-workers-too-old",
                "The connected workers are of an older release without motion vectors. Start newer ones.",
            )
        )
