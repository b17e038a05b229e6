"""Denoised frames: made by a worker on request, and stored until the film changes."""

from __future__ import annotations

from protocol.contract import DenoiseFrame, WorkerReport, denoise_queue
from renderer.sentences import Sentence
from service.errors import Unavailable
from service.scheduling.artifacts.artifact_task import ArtifactTask

__all__ = ["Denoising"]

_GUIDE_S = 60.0  # seconds to render the guide, of a worker that may have to fetch the scene and its kernel
_MOMENT_S = 600.0  # if the frame is compiled again


class Denoising(ArtifactTask[DenoiseFrame]):
    """Requests for denoised frames. The result is valid for one version of the film."""

    _name = Sentence("artifact-denoised-picture", "denoised picture")
    _doing = "denoise"

    def _kind(self) -> str | None:
        return self._workers.roster.denoising_kind()

    def _able_workers(self) -> list[WorkerReport]:
        return [report for report in self._workers.roster.ready_reports() if report.denoises]

    def _queue(self, kind: str) -> str:
        return denoise_queue(kind)

    def _send(self, request: DenoiseFrame, queue: str) -> None:
        self._dispatcher.send_denoise(request, queue)

    def _patience(self, request: DenoiseFrame) -> float:
        guide = request.guide
        more = 0.0 if guide is None else _GUIDE_S if guide.moment is None else _MOMENT_S
        return super()._patience(request) * max(1, len(request.frames)) + more

    def _is_size(self, size: int, request: DenoiseFrame) -> bool:
        return size == 3 * 4 * request.width * request.height

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
