"""Tests of a worker's denoising of a job's frame."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from protocol.contract import ROUGH_PREVIEW_SAMPLES, DenoiseFrame
from protocol.view_parts import CLEAN_GUIDE_SAMPLES
from worker.work import denoise


@pytest.mark.parametrize(
    ("lights", "samples", "is_clean"),
    [
        ((), ROUGH_PREVIEW_SAMPLES - 1, False),  # in a quarter of the time, so that it is renewed more often
        ((), ROUGH_PREVIEW_SAMPLES, True),
        (("lamp", "rest"), CLEAN_GUIDE_SAMPLES - 1, False),
        (("lamp", "rest"), CLEAN_GUIDE_SAMPLES, True),  # the picture that a mix shows in the end
    ],
)
def test_guides_of_a_preview_are_clean_from_a_number_of_samples_on(
    lights: tuple[str, ...], samples: int, is_clean: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    jobs: list[partial[Any]] = []
    stored = SimpleNamespace(sha256="a" * 64)
    monkeypatch.setattr(denoise.ReaderFolder, "run", lambda self, job, *_, **__: jobs.append(job))
    monkeypatch.setattr(denoise.ReaderFolder, "result", lambda *_: Path("denoised"))
    link = SimpleNamespace(fetch_means=lambda *_: ("v", samples * 4 * 3), store=lambda path: stored)
    worker: Any = SimpleNamespace(link=link)
    made = denoise.denoise_frame(worker, DenoiseFrame("w", "j", 0, 4, 3, is_preview=True, lights=lights))
    assert (made["sha256"], made["samples"]) == (stored.sha256, samples * 12)
    assert [(job.keywords["has_clean_guides"], job.keywords["threads"]) for job in jobs] == [(is_clean, 1)]
    assert [job.keywords.get("is_rough", False) for job in jobs] == [not (is_clean or lights)]
