"""Denoised previews of frames that are being rendered, made while clients ask for them."""

from __future__ import annotations

import time
from concurrent.futures import Future

from protocol.contract import (
    PREVIEW_GROWTH,
    ROUGH_PREVIEW_GROWTH,
    ROUGH_PREVIEW_SAMPLES,
    UNRESTED_PREVIEW_GROWTH,
    DenoiseFrame,
)
from service.scheduling.artifacts.artifact_result import ArtifactResult
from service.scheduling.artifacts.denoising import Denoising

__all__ = ["DenoisedPreviews"]

SHARE = 1 / 20  # of the time of the slots that can denoise, at most, for previews that are renewed
ROUGH_SHARE = 1 / 3  # the same for rough ones
MOST_SECONDS = 60.0  # limit of the duration that a worker reports for a preview


class DenoisedPreviews(Denoising):
    """Denoised previews, renewed as samples come.

    A frame's first preview is made at once; it is renewed when its samples have grown by PREVIEW_GROWTH, a rough one by
    ROUGH_PREVIEW_GROWTH, since users watch the first minute of a picture. A preview of fewer than
    ROUGH_PREVIEW_SAMPLES samples per pixel is rough. All renewals together take at most a twentieth of the time of the slots that
    can denoise, those of rough ones at most a third. A rough one is renewed without this limit once its frame has
    UNRESTED_PREVIEW_GROWTH times the samples.
    """

    _rests_until = 0.0

    def latest(self, request: DenoiseFrame, samples: int, *, is_final: bool = False) -> Future[ArtifactResult]:
        """Returns a future of the frame's latest preview, which is made first if it is due.

        samples: of the film now, over all pixels. is_final: whether no more will come: then it is due as soon as the samples have
        grown enough. Raises Unavailable if one is due and no worker can denoise.
        """
        made = self._made.get((request.job, request.frame))
        if made is None or not self._is_recent(made, samples, request.width * request.height, is_final):
            return self.request(request)
        return self.request(request, made.version)  # that one, if its blob is still there

    def rest_s(self, job: str, frame: int, samples: int, pixels: int) -> float:
        """Returns the seconds until a frame's preview may be renewed; 0 if it may now, or if its samples have not grown enough.

        samples: of the film now, over all pixels.
        """
        made = self._made.get((job, frame))
        if made is None or not self._rests(made, samples, pixels) or samples < _due_samples(made, pixels):
            return 0.0
        return max(self._rests_until - time.monotonic(), 0.0)

    def _is_recent(self, made: ArtifactResult, samples: int, pixels: int, is_final: bool = False) -> bool:
        """Returns True if the preview is not to be renewed now. A film that was lost and begun again has fewer samples."""
        rests = not is_final and self._rests(made, samples, pixels)
        return made.samples <= samples and (samples < _due_samples(made, pixels) or rests)

    def _rests(self, made: ArtifactResult, samples: int, pixels: int) -> bool:
        has_grown = _is_rough(made, pixels) and samples >= UNRESTED_PREVIEW_GROWTH * made.samples
        return not has_grown and time.monotonic() < self._rests_until

    def _record_made(self, result: ArtifactResult, request: DenoiseFrame) -> None:
        slots = sum(report.slots for report in self._able_workers())
        seconds = min(result.seconds, MOST_SECONDS)
        share = ROUGH_SHARE if _is_rough(result, request.width * request.height) else SHARE
        # It occupied one of the slots: with the rest it takes this share of all.
        self._rests_until = time.monotonic() + seconds * max(1 / (share * max(slots, 1)) - 1, 0.0)


def _is_rough(made: ArtifactResult, pixels: int) -> bool:
    return made.samples < ROUGH_PREVIEW_SAMPLES * pixels


def _due_samples(made: ArtifactResult, pixels: int) -> float:
    """Returns the number of samples over all pixels with which a preview is renewed."""
    return made.samples * (ROUGH_PREVIEW_GROWTH if _is_rough(made, pixels) else PREVIEW_GROWTH)
