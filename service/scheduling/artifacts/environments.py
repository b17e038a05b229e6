"""Thumbnails of uploaded environment images. A worker makes each one during the upload, which also validates the image."""

from __future__ import annotations

from protocol.contract import ShowEnvironment, WorkerReport
from renderer.sentences import Sentence, with_full_stop
from service.errors import FarmError, Invalid, Unavailable
from service.scheduling.artifacts.artifact_task import ArtifactTask

__all__ = ["Environments"]

MAX_BYTES = 1 << 20  # of a thumbnail


class Environments(ArtifactTask[ShowEnvironment]):
    """Requests for thumbnails of environment images. The `job` field of a request is the hash of the image."""

    _name = Sentence("artifact-environment-picture", "environment's picture")
    _doing = "environment"
    _patience_s = 150.0

    def _kind(self, request: ShowEnvironment) -> str | None:
        return self._workers.roster.environment_kind()

    def _able_workers(self) -> list[WorkerReport]:
        return [report for report in self._workers.roster.ready_reports() if report.views]

    def _send(self, request: ShowEnvironment, queue: str) -> None:
        self._dispatcher.send_environment(request, queue)

    def _is_size(self, size: int, request: ShowEnvironment) -> bool:
        return 0 < size <= MAX_BYTES

    def _no_worker_error(self) -> Unavailable:
        if self._workers.roster.best_kind() is not None:
            return Unavailable(
                Sentence(
                    "environment-workers-too-old",
                    "The workers are of an older release without environments. Update them, then upload it again.",
                )
            )
        return Unavailable(
            Sentence(
                "environment-needs-worker",
                "Checking an environment needs a worker, but none is ready. Start one, or resume a paused "
                "one, then upload it again.",
            )
        )

    def _failure(self, reason: str) -> FarmError:
        return Invalid(with_full_stop(reason.rstrip("."))) if reason else super()._failure(reason)
