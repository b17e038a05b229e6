"""Movie files: H.264 in MP4, AV1 in WebM, or animated WebP.

MP4 and WebM use 4:2:0 chroma subsampling, limited range and BT.709, and their metadata says so. Odd sizes are padded by
repeating the last row or column.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from renderer.encoder_priority import restored_priorities
from renderer.errors import SettingsError
from renderer.sentences import Sentence

if TYPE_CHECKING:
    import av

__all__ = ["MOVIES", "MOVIE_MEDIA", "is_movie", "write_movie"]

U8 = npt.NDArray[np.uint8]
MOVIE_MEDIA = {"mp4": "video/mp4", "webm": "video/webm", "webp": "image/webp"}
MOVIES = tuple(MOVIE_MEDIA)

BT709 = 1  # code of primaries, transfer and matrix (ITU-T H.273)
LIMITED_RANGE = 1  # AVCOL_RANGE_MPEG
THREADS = 2  # per encoder: workers need the other cores
SVT_OPTIONS = {"crf": "24", "preset": "8", "svtav1-params": f"lp={THREADS}"}
# Encoders in order of preference, with options: visually lossless, and fast enough for a few cores.
_CODECS: dict[str, tuple[tuple[str, dict[str, str]], ...]] = {
    "mp4": (("libx264", {"crf": "17", "preset": "medium"}), ("libsvtav1", SVT_OPTIONS)),
    "webm": (("libsvtav1", SVT_OPTIONS), ("libvpx-vp9", {"crf": "24", "b:v": "0", "cpu-used": "4"})),
    "webp": (("libwebp_anim", {"quality": "90", "loop": "0"}),),
}


def is_movie(name: str | Path) -> bool:
    """Returns True if a file name has the suffix of a movie."""
    return Path(name).suffix.lower().lstrip(".") in MOVIES


def write_movie(path: Path, pictures: Iterable[U8], fps: float) -> int:
    """Writes sRGB pictures of equal size (h, w, 3) as a movie, and returns their number.

    path: its suffix, .mp4, .webm or .webp, selects the format. Raises SettingsError if there are no pictures or FFmpeg on this
    machine cannot write the format.
    """
    import av

    kind = path.suffix.lower().lstrip(".")
    count = 0
    options = {"movflags": "+faststart"} if kind == "mp4" else {}
    try:
        with av.open(str(path), "w", options=options) as container, restored_priorities() as restore:
            stream: Any = None
            for picture in pictures:
                if stream is None:
                    stream = _stream(container, kind, picture.shape, Fraction(fps).limit_denominator(1001))
                    stream.codec_context.open()
                    restore()
                frame = _frame(np.ascontiguousarray(picture), kind)
                frame.pts = count
                container.mux(stream.encode(frame))
                restore()
                count += 1
            if stream is not None:
                container.mux(stream.encode(None))
    except av.FFmpegError as error:
        raise SettingsError(
            Sentence("video-not-writable", "{name}: the movie cannot be written ({error})", name=path.name, error=error)
        ) from error
    if not count:
        raise SettingsError(Sentence("video-without-frames", "{name}: there are no frames to encode", name=path.name))
    return count


def _stream(container: Any, kind: str, shape: tuple[int, ...], fps: Fraction) -> Any:
    import av

    for name, options in _CODECS[kind]:
        if name == "libsvtav1" and min(shape[:2]) < 64:
            continue  # the encoder refuses smaller sizes
        try:
            stream = container.add_stream(name, rate=fps, options=options)
        except (av.FFmpegError, ValueError):
            continue
        stream.time_base = 1 / fps
        stream.thread_count = THREADS
        height, width = shape[:2]
        if kind == "webp":
            stream.width, stream.height, stream.pix_fmt = width, height, "bgra"
            return stream
        stream.width, stream.height, stream.pix_fmt = width + width % 2, height + height % 2, "yuv420p"
        context = stream.codec_context
        context.color_primaries = context.color_trc = context.colorspace = BT709
        context.color_range = LIMITED_RANGE
        return stream
    raise SettingsError(
        Sentence(
            "video-codec-missing",
            ".{kind}: the FFmpeg of this machine supports none of {codecs}",
            kind=kind,
            codecs=[name for name, _ in _CODECS[kind]],
        )
    )


def _frame(picture: U8, kind: str) -> av.VideoFrame:
    import av
    from av.video.reformatter import ColorRange, Colorspace

    if kind == "webp":
        return av.VideoFrame.from_ndarray(picture, "rgb24").reformat(format="bgra")
    height, width = picture.shape[:2]
    even = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    frame = av.VideoFrame.from_ndarray(even, "rgb24").reformat(
        format="yuv420p",
        dst_colorspace=Colorspace.ITU709,
        src_color_range=ColorRange.JPEG,
        dst_color_range=ColorRange.MPEG,
        interpolation="AREA",
    )
    frame.color_primaries = frame.color_trc = BT709
    return frame
