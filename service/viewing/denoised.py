"""The denoised pictures of a live view: when the next one is due, and the latest that has come."""

from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt

from renderer.image import rgbe9995

__all__ = ["DENOISING_FAILURES_ALLOWED", "DenoisedView"]

F32 = npt.NDArray[np.float32]
LOST_S = 1.0  # until the next is tried after one was lost
DENOISING_FAILURES_ALLOWED = 3  # in succession, after which a view is not denoised: one may be due to a busy machine
REST, EARLY_REST = 3.0, 1.0  # times the duration of the last denoising until the next begins; and after one of few samples
EARLY_SAMPLES = 8.0  # samples per pixel below which a denoised picture is rough


class DenoisedView:
    """State of a view's denoising. Not thread-safe.

    The small pictures of a new view are denoised once each, so that the view is soon clean. The whole one is denoised at `first`
    samples per pixel, whenever they have doubled, and at the end, one at a time, and for at most a quarter of the time, or half
    of it while it has fewer than EARLY_SAMPLES. Once one was shown, or a draft, pictures with noise are not, so that the view
    does not flicker.
    """

    def __init__(self, first: float = 1.0, *, keeps: bool = False) -> None:
        """Creates the state of a new view.

        first: mean samples per pixel at which the whole picture is denoised first. keeps: whether the latest picture of the whole
        view is kept after it was shown.
        """
        self._first = first
        self._keeps = keeps
        self.kept: tuple[npt.NDArray[np.uint32], float] | None = None  # RGB9E5 words (h, w), and mean samples per pixel
        self.means: bytes | None = None  # of the picture that is being denoised: colour, albedo, normal
        self.has_shown = False
        self.shown_samples = 0.0  # mean samples per pixel of the picture shown last; 0: a small one
        self.level = -1  # resolution level of the latest picture, or of the one that is being denoised
        self._samples = 0.0  # mean samples per pixel of the latest denoised picture
        self._asked = 0.0  # those of the picture that is being denoised
        self._began = 0.0
        self._rests_until = 0.0
        self._lost_until = 0.0
        self.failures = 0  # lost pictures since the latest one that came
        self._picture: F32 | None = None  # not shown yet

    def is_due(self, least: int, mean: float, is_complete: bool) -> bool:
        """Returns True if the next picture is to be denoised now.

        least, mean: samples per pixel of the tile with the fewest, and on average. is_complete: whether no more will come.
        """
        now = time.monotonic()
        if self.means is not None or least == 0 or now < self._lost_until or (now < self._rests_until and not is_complete):
            return False
        return mean >= max(self._first, 2 * self._samples) or (is_complete and mean > self._samples)

    def is_small_due(self, level: int, is_complete: bool) -> bool:
        """Returns True if the picture of a level below the whole view's is to be denoised now. is_complete: as above."""
        return self.means is None and level > self.level and is_complete and time.monotonic() >= self._lost_until

    def begin(self, color: F32, albedo: F32, normal: F32, mean: float, level: int = 0, *, is_whole: bool = True) -> None:
        """Stores the picture to denoise, (h, w, 3) each, with its mean samples per pixel and resolution level.

        is_whole: whether the level has the view's full size.
        """
        self.means = b"".join(each.astype("<f4").tobytes() for each in (color, albedo, normal))
        self._asked, self._began, self.level = mean if is_whole else 0.0, time.monotonic(), level

    def end(self, words: npt.NDArray[np.uint32] | None) -> None:
        """Stores the denoised picture, RGB9E5 words (h, w); None: it was lost, and the next is tried after a while."""
        now = time.monotonic()
        if self._asked:  # a small picture takes hardly any time
            rest = EARLY_REST if self._asked < EARLY_SAMPLES else REST
            self._rests_until = now + rest * (now - self._began)
        self.means = None
        if words is None:
            self.failures += 1
            self._lost_until = now + LOST_S
        else:
            self.failures = 0
            self._picture, self._samples = rgbe9995.unpack(words), self._asked
            if self._keeps and self._asked:
                self.kept = words, self._asked

    @property
    def asked(self) -> float:
        """Mean samples per pixel of the picture that is being denoised; 0 if none is, or a small one."""
        return self._asked if self.means is not None else 0.0

    @property
    def is_first(self) -> bool:
        """Returns True if the first picture of the whole view is being denoised."""
        return self.asked > 0 and self._samples == 0

    @property
    def has_picture(self) -> bool:
        """Returns True if a denoised picture has come that was not taken yet."""
        return self._picture is not None

    def take(self) -> tuple[F32, float]:
        """Returns the latest picture, (3, h, w), and its mean samples per pixel (0: a small one), and counts it as shown."""
        assert self._picture is not None
        picture, self._picture, self.has_shown = self._picture, None, True
        self.shown_samples = self._samples
        return np.ascontiguousarray(np.moveaxis(picture, -1, 0)), self._samples
