"""Denoised previews of frames that are being rendered, made while clients ask for them."""

from __future__ import annotations

import time
from concurrent.futures import Future

from protocol.contract import DenoiseFrame
from service.scheduling.artifacts.artifact_result import ArtifactResult
from service.scheduling.artifacts.denoising import Denoising

__all__ = ["DenoisedPreviews"]

REST = 19.0  # times the slot-seconds of the last preview until the farm makes another: previews take a twentieth of its time
EARLY_REST = 4.0  # the same after a rough preview, of fewer samples per pixel than EARLY_SAMPLES: a fifth
EARLY_SAMPLES = 64
EARLY_GROWTH = 4  # growth of the samples after which a rough preview is renewed without a rest: at about 1, 4, 16 and 64 samples
MOST_SECONDS = 60.0  # that a preview counts, whatever its worker reports


class DenoisedPreviews(Denoising):
    """Denoised previews, renewed as samples come.

    A frame's first preview is made at once; it is renewed when its samples have doubled. All renewals together take at most a
    twentieth of the time of the slots that can denoise, below EARLY_SAMPLES samples per pixel at most a fifth. There a preview is
    renewed without this limit once its frame has EARLY_GROWTH times the samples, since users watch the first minute of a picture.
    """

    _rests_until = 0.0

    def latest(self, request: DenoiseFrame, samples: int, *, is_final: bool = False) -> Future[ArtifactResult]:
        """Returns a future of the frame's latest preview, which is made first if it is due.

        samples: of the film now, over all pixels. is_final: whether no more will come: then it is due as soon as the samples have
        doubled. Raises Unavailable if one is due and no worker can denoise.
        """
        made = self._made.get((request.job, request.frame))
        if made is None or not self._is_recent(made, samples, request.width * request.height, is_final):
            return self.request(request)
        return self.request(request, made.version)  # that one, if its blob is still there

    def _is_recent(self, made: ArtifactResult, samples: int, pixels: int, is_final: bool = False) -> bool:
        """Returns True if the preview is not to be renewed now. A film that was lost and begun again has fewer samples."""
        has_grown = made.samples < EARLY_SAMPLES * pixels and samples >= EARLY_GROWTH * made.samples
        rests = not is_final and not has_grown and time.monotonic() < self._rests_until
        return made.samples <= samples and (samples < 2 * made.samples or rests)

    def _record_made(self, result: ArtifactResult, request: DenoiseFrame) -> None:
        slots = sum(report.slots for report in self._able_workers())
        seconds = min(result.seconds, MOST_SECONDS)
        is_early = result.samples < EARLY_SAMPLES * request.width * request.height
        self._rests_until = time.monotonic() + (EARLY_REST if is_early else REST) * seconds / max(slots, 1)
