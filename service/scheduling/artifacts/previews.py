"""Denoised previews of frames that are being rendered, made while clients ask for them."""

from __future__ import annotations

import time
from concurrent.futures import Future

from protocol.contract import DenoiseFrame
from service.scheduling.artifacts.artifact_task import ArtifactResult
from service.scheduling.artifacts.denoising import Denoising

__all__ = ["DenoisedPreviews"]

REST = 19.0  # times the slot-seconds of the last preview until the farm makes another: previews take a twentieth of its time


class DenoisedPreviews(Denoising):
    """Denoised previews, renewed as samples come.

    A frame's first preview is made at once; it is renewed when its samples have doubled. All renewals together take at most a
    twentieth of the time of the slots that can denoise.
    """

    _rests_until = 0.0

    def latest(self, request: DenoiseFrame, samples: int) -> Future[ArtifactResult]:
        """Returns a future of the frame's latest preview, which is made first if it is due.

        samples: of the film now, over all pixels. Raises Unavailable if one is due and no worker can denoise.
        """
        made = self._made.get((request.job, request.frame))
        if made is None or not self._is_recent(made, samples):
            return self.request(request)
        return self.request(request, made.version)  # that one, if its blob is still there

    def _is_recent(self, made: ArtifactResult, samples: int) -> bool:
        """Returns True if the preview is not to be renewed now. A film that was lost and begun again has fewer samples."""
        return made.samples <= samples and (samples < 2 * made.samples or time.monotonic() < self._rests_until)

    def _record_made(self, result: ArtifactResult) -> None:
        slots = sum(report.slots for report in self._able_workers())
        self._rests_until = time.monotonic() + REST * result.seconds / max(slots, 1)
