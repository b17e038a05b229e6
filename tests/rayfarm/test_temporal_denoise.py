"""Tests that a denoised frame waits until its neighbours are rendered, and no longer."""

from __future__ import annotations

import numpy as np

from rayfarm.temporal_denoise import TemporalDenoiser
from tests.renderer.test_temporal_denoise import frame as made


def denoise_sequence(
    frames: list[float], missing: list[float], fails: tuple[float, ...] = ()
) -> tuple[list[float], list[str], dict]:
    """Denoises a sequence; returns (planned frames, log, denoised picture by frame).

    The log has "N" for each rendered frame N, and "wN" when frame N is written. missing: the frames to write. fails: frames that
    cannot be rendered.
    """
    steadying, log, pictures = TemporalDenoiser(frames, missing), [], {}
    for frame in steadying.plan:
        if frame not in fails:
            log.append(f"{frame:g}")
            if steadying.has_neighbours(frame):
                steadying.add_frame(frame, STILLS[frame], lambda picture, frame=frame: pictures.update({frame: picture}))
        for number, write in steadying.mark_done(frame):
            write()
            log.append(f"w{number:g}")
        assert len(steadying._held) <= 5
    assert not steadying._held and not steadying._waiting
    return steadying.plan, log, pictures


STILLS = {n: made() for n in range(20)}


def test_frame_is_written_after_its_neighbours() -> None:
    _, log, pictures = denoise_sequence([0, 1, 2, 3, 4, 5], [0, 1, 2, 3, 4, 5])
    assert log == ["0", "1", "2", "w0", "3", "w1", "4", "w2", "5", "w3", "w4", "w5"]
    assert set(pictures) == {0, 1, 2, 3, 4, 5}


def test_existing_files_do_not_change_results() -> None:
    whole = denoise_sequence(list(range(10)), list(range(10)))[2]
    plan, _, again = denoise_sequence(list(range(10)), [4, 9])
    assert plan == [2, 3, 4, 5, 6, 7, 8, 9]
    assert set(again) == {4, 9}
    for number in again:
        np.testing.assert_array_equal(again[number], whole[number])
    assert denoise_sequence([3, 2, 1, 0], [0, 1, 2, 3])[0] == [0, 1, 2, 3]


def test_failed_frame_separates_neighbours() -> None:
    _, log, _ = denoise_sequence([0, 1, 2, 3, 4], [0, 1, 2, 3, 4], fails=(2,))
    assert log == ["0", "1", "w0", "3", "w1", "4", "w3", "w4"]
    assert not TemporalDenoiser([0, 5, 10], [0, 5, 10]).has_neighbours(5)
