"""Tests of movie files, decoded as by a player: colours, size, frame rate and colour tags."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image, ImageSequence

from renderer.errors import SettingsError
from service.watching.movie import MOVIES, is_movie, write_movie

COLORS = [(220, 30, 40), (20, 200, 60), (40, 60, 230), (255, 255, 255), (0, 0, 0), (128, 128, 128)]


def colour_bars(shift: int = 0, width: int = 97, height: int = 65) -> np.ndarray:
    """Returns a picture with vertical bars of plain colours; its sides may be odd."""
    picture = np.zeros((height, width, 3), np.uint8)
    for i in range(len(COLORS)):
        picture[:, i * width // len(COLORS) : (i + 1) * width // len(COLORS)] = COLORS[(i + shift) % len(COLORS)]
    return picture


def decode_movie(path: Path) -> list[np.ndarray]:
    """Returns the decoded frames. FFmpeg cannot decode animated WebP, so Pillow reads that."""
    if path.suffix == ".webp":
        with Image.open(path) as image:
            return [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(image)]
    with av.open(str(path)) as container:
        frames = list(container.decode(container.streams.video[0]))
        return [frame.reformat(format="rgb24").to_ndarray() for frame in frames]


@pytest.mark.parametrize("kind", MOVIES)
def test_movie_has_input_colours(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"out.{kind}"
    assert write_movie(path, (colour_bars(i) for i in range(6)), 12.0) == 6
    found = decode_movie(path)
    assert len(found) == 6
    for i, picture in enumerate(found):
        for bar in range(len(COLORS)):
            middle = picture[20:40, (2 * bar + 1) * 97 // 12].mean(axis=0)
            np.testing.assert_allclose(middle, COLORS[(bar + i) % len(COLORS)], atol=6)


@pytest.mark.parametrize("kind", MOVIES)
def test_small_movie_is_written(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"out.{kind}"
    write_movie(path, (colour_bars(i, 24, 16) for i in range(3)), 23.976)
    assert [picture.shape for picture in decode_movie(path)] == [(16, 24, 3)] * 3


@pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="Encoders become urgent where they run as root.")
def test_thread_priorities_are_restored(tmp_path: Path) -> None:
    def urgent() -> list[Path]:
        threads = Path("/proc/self/task").iterdir()
        return [thread for thread in threads if os.sched_getscheduler(int(thread.name)) != os.SCHED_OTHER]

    def pictures() -> Iterator[np.ndarray]:
        for i in range(6):
            during.extend(urgent())
            yield colour_bars(i)

    during: list[Path] = []
    write_movie(tmp_path / "out.webm", pictures(), 12.0)
    assert not during
    assert not urgent()


@pytest.mark.parametrize("kind", ["mp4", "webm"])
def test_movie_metadata_has_colour_tags_and_rate(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"out.{kind}"
    write_movie(path, (colour_bars(i) for i in range(24)), 24.0)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        frame = next(container.decode(stream))
        assert (frame.width, frame.height, frame.format.name) == (98, 66, "yuv420p")
        assert (int(frame.colorspace), int(frame.color_range)) == (1, 1), "BT.709, limited"
        assert (int(frame.color_primaries), int(frame.color_trc)) == (1, 1)
        assert stream.average_rate == 24
        assert stream.codec_context.name in ({"mp4": ("h264",), "webm": ("libdav1d", "av1", "libaom-av1")}[kind])


def test_unsupported_format_raises_error(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="no frame"):
        write_movie(tmp_path / "out.mp4", iter(()), 24.0)


def test_movies_are_recognized_by_suffix() -> None:
    assert is_movie("a.MP4")
    assert not is_movie("a.png")
