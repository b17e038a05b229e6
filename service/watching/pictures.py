"""Picture files of a frame: colour, denoised colour, one AOV, or colour and AOVs as layers.

With a transparent background, an EXR of the colour has associated alpha, a PNG straight alpha; others show it on black.

Files are written in bands of rows from the top, so that only a few rows of tiles are in memory. Two kinds of pictures must be
complete in memory first: display-encoded ones, and AOVs that are scaled to their range. `picture_memory` accounts for this.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from renderer import aovs, cryptomatte
from renderer.errors import SettingsError
from renderer.film import Gain, plane_count
from renderer.image import rgbe9995, tonemap
from renderer.image.darkness import darkness
from renderer.image.tonemap import Curve
from renderer.sentences import Sentence, with_full_stop
from renderer.settings import light_planes
from service.errors import Conflict, Invalid
from service.store.bands import bands
from service.store.films import Film
from service.watching.downscale import reduced_bands, square_side
from service.watching.picture_response import PictureBody

__all__ = ["MEDIA", "PictureRequest", "display_picture", "picture_file", "picture_memory", "plane_names"]

F32 = npt.NDArray[np.float32]
HEAT_MAP_PLANES = ("samples", "error")  # planes drawn as heat maps
HDR_STILLS = ("avif", "jxl")
HDR_STILL_BYTES = 140  # bytes per pixel: the signal, its planes, the encoder
ROWS = 64  # rows of a denoised picture per band
MEDIA = {
    "png": "image/png",
    "jpg": "image/jpeg",
    "avif": "image/avif",
    "jxl": "image/jxl",
    "exr": "image/x-exr",
    "hdr": "image/vnd.radiance",
    "rgb9e5": "application/octet-stream",
}


@dataclass(frozen=True)
class PictureRequest:
    """The picture file that a client requests.

    extension: the file format, such as exr. planes: names of AOVs; empty for colour. in_layers: write the planes as layers in
    addition to the colour, instead of one plane without the colour. exposure: in stops. curve: the tone curve. width:
    minimum width of a downscaled copy. denoised: function that opens the denoised colour, used in place of the film's; None:
    not denoised. lights: number of light groups whose light that file has, for a colour mixed from them by `gains`; 0: it has the
    colour. motion: function that opens motion vectors, which films do not contain; they are the last of the planes.
    names_of_ids: names of objects and materials, for Cryptomatte. visible: a colour that would look black is
    exposed by what it shows, in addition to `exposure`. gains: of the light groups, for a colour mixed from them (film.mixed).
    gain_map: whether a jpg has one, for displays of high dynamic range.
    """

    extension: str
    planes: tuple[str, ...] = ()
    in_layers: bool = False
    exposure: float = 0.0
    curve: Curve = "neutral"
    width: int | None = None
    denoised: Callable[[], BinaryIO] | None = None
    lights: int = 0
    motion: Callable[[], BinaryIO] | None = None
    visible: bool = False
    gains: tuple[Gain, ...] = ()
    gain_map: bool = False
    names_of_ids: Mapping[str, Sequence[str]] = field(default_factory=dict, compare=False)

    def check(self) -> None:
        """Raises Invalid for a combination that the file format does not support."""
        if any(map(aovs.is_matte, self.planes)) and (self.extension != "exr" or not self.in_layers or self.width is not None):
            raise Invalid(
                Sentence(
                    "aov-cryptomatte-layers",
                    "aov: cryptomatte is layers beside the colour; ask for image.exr with aov=color,cryptomatte, without width.",
                )
            )
        try:
            if self.extension in HDR_STILLS:
                tonemap.check_pq(self.curve)
            if self.gain_map:
                tonemap.check_standard_range(self.curve)
        except SettingsError as error:
            raise Invalid(with_full_stop(error)) from None
        if self.gain_map and (self.extension != "jpg" or not all(map(aovs.is_light, self.planes))):
            raise Invalid(Sentence("gain-map-jpg-only", "gain_map: only the colour as image.jpg can have one; leave it out."))
        if self.in_layers and self.extension != "exr":
            raise Invalid(
                Sentence(
                    "aov-one-plane-only",
                    "aov: a .{format} holds one channel; ask for one, or for image.exr.",
                    format=self.extension,
                )
            )
        if not all(map(aovs.is_light, self.planes)) and self.extension in HDR_STILLS:
            raise Invalid(
                Sentence(
                    "aov-still-colour-only",
                    "aov: a .{format} holds colour only; ask for image.exr or image.png.",
                    format=self.extension,
                )
            )
        if not all(map(aovs.is_light, self.planes)) and self.extension == "rgb9e5":
            raise Invalid(Sentence("aov-rgb9e5-colour-only", "aov: rgb9e5 holds colour only; ask for image.exr or image.png."))
        if aovs.MOTION in self.planes and self.width is not None:
            raise Invalid(
                Sentence("aov-motion-with-width", "width: motion vectors are in pixels of the whole picture; leave width out.")
            )
        if self.planes == (aovs.MOTION,) and self.extension == "hdr":
            raise Invalid(
                Sentence("aov-motion-not-hdr", "aov: motion has four values per pixel, but .hdr has three; ask for image.exr.")
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Returns the names of the channels to write, in order."""
        return ("color", *self.planes) if self.in_layers else self.planes or ("color",)


def picture_file(film: Film, frame: int, request: PictureRequest, folder: Path) -> PictureBody:
    """Returns the requested picture file of a frame.

    frame: key of the frame: 2 * frame number, since frame numbers are multiples of 0.5. folder: for temporary files.
    """
    from renderer.image.encode import RGB, encode_shown, write_bands  # imported only if needed: OpenImageIO is large

    side = square_side(request.width, film.width, film.height)
    width, height = film.width // side, film.height // side
    if request.extension in ("exr", "hdr"):
        if request.in_layers or _has_alpha(film, request):
            names = (*RGB, *(channel for name in _names(film, request)[1:] for channel in aovs.channels(name)))
        else:
            names = aovs.channels(aovs.MOTION) if request.planes == (aovs.MOTION,) else RGB
        parts = (_grey_to_rgb(band) for band in reduced_bands(_values(film, frame, request), side))
        has_mattes = any(map(aovs.is_matte, request.planes))
        header = cryptomatte.header(request.names_of_ids) if has_mattes else None
        return PictureBody.from_writer(
            lambda path: write_bands(path, parts, width, height, names, header), folder, f".{request.extension}"
        )
    if request.extension in HDR_STILLS or request.gain_map:
        return PictureBody.from_bytes(_hdr_still(film, frame, request, side), folder)
    if request.extension == "rgb9e5":
        words = _filled_from_top(
            np.empty((height, width), "<u4"), map(rgbe9995.pack, reduced_bands(_values(film, frame, request), side))
        )
        return PictureBody.from_bytes(words.tobytes(), folder)
    if all(map(aovs.is_light, request.planes)):
        return PictureBody.from_bytes(encode_shown(display_picture(film, frame, request), request.extension), folder)
    (name,) = request.planes
    values = _whole_plane(film, frame, request)
    between = aovs.span(name, values)
    shown_rows = (aovs.visible(name, values[y : y + ROWS], between) for y in range(0, film.height, ROWS))
    plane = _filled_from_top(np.empty((height, width, 3), np.uint8), reduced_bands(shown_rows, side))
    made = PictureBody.from_bytes(encode_shown(plane, request.extension), folder)
    if between is not None and name in HEAT_MAP_PLANES:
        made.span = float(between[0]), float(between[1])
    return made


def display_picture(film: Film, frame: int, request: PictureRequest) -> npt.NDArray[np.uint8]:
    """Returns the tone-mapped, display-encoded colour of a frame, or of one of its light groups, shape (h, w, 3) uint8.

    Of a PNG with a transparent background, it has straight alpha as a fourth channel.
    """
    side = square_side(request.width, film.width, film.height)
    shape = film.height // side, film.width // side, 4 if _has_alpha(film, request) else 3
    return _filled_from_top(np.empty(shape, np.uint8), _tone_mapped(film, frame, request, side))


def _has_alpha(film: Film, request: PictureRequest) -> bool:
    """Returns True if the picture is of the film's colour, and has its alpha as a fourth channel."""
    is_color = request.in_layers or not request.planes
    return film.is_transparent and is_color and request.extension in ("exr", "png")


def _names(film: Film, request: PictureRequest) -> tuple[str, ...]:
    """Returns the names of the channels to write, in order; the alpha follows the colour."""
    if not _has_alpha(film, request):
        return request.names
    return "color", aovs.ALPHA, *(name for name in request.planes if name != aovs.ALPHA)


def plane_names(asked: Iterable[str], settings: Mapping[str, Any]) -> tuple[str, ...]:
    """Returns the AOVs in a request's list of names, without the colour; motion is the last. Raises Invalid for an unknown one.

    settings: those of the job, as JSON data.
    """
    wanted = (name for name in asked if name not in ("color", ""))
    groups = light_planes(settings.get("light_groups", ""), settings.get("light_paths", "off"))
    is_transparent = settings.get("background") == "transparent"
    try:
        names = aovs.parse_names(wanted, groups, settings.get("cryptomatte", 0), is_transparent)
    except SettingsError as error:
        raise Invalid(with_full_stop(error)) from None
    return tuple(sorted(dict.fromkeys(names), key=aovs.MOTION.__eq__))


def picture_memory(film: Film, request: PictureRequest) -> int:
    """Returns the estimated peak memory of `picture_file`, in bytes."""
    side = square_side(request.width, film.width, film.height)
    channels = sum(map(aovs.size, _names(film, request)))
    tile = film.tiles[0]
    of_bands = 5 * film.width * tile.h * 4 * max(channels, 3) + 3 * _planes(film) * tile.w * tile.h * 8
    of_bands += 2 * 12 * request.lights * film.width * max(tile.h, ROWS)  # a band, and the one before it
    if request.extension in ("exr", "hdr"):
        return of_bands
    if request.extension == "rgb9e5":
        return of_bands + 8 * film.width * film.height // side**2
    if request.extension in HDR_STILLS or request.gain_map:
        return of_bands + HDR_STILL_BYTES * film.width * film.height // side**2
    of_shown = (
        (64 if request.visible else 10) * film.width * film.height // side**2
    )  # rows, the encoder's copy, the file; its light
    return of_bands + of_shown + (8 * channels * film.width * film.height if request.planes else 0)


def _planes(film: Film) -> int:
    return plane_count(len(film.groups), film.is_transparent)


def _hdr_still(film: Film, frame: int, request: PictureRequest, side: int) -> bytes:
    """Returns an avif, jxl, or jpg with a gain map."""
    from renderer.image.gain_map import encode_jpeg_with_gain_map  # imported only if needed: OpenImageIO is large
    from renderer.image.hdr_still import encode_still, pq_picture

    empty = np.empty((film.height // side, film.width // side, 3), np.float32)
    if request.gain_map:
        radiance = _filled_from_top(empty, reduced_bands(_values(film, frame, request), side))
        return encode_jpeg_with_gain_map(radiance, request.exposure, request.curve)
    parts = (pq_picture(band, request.exposure, request.curve) for band in reduced_bands(_values(film, frame, request), side))
    signal = _filled_from_top(empty, parts)
    try:
        return encode_still(signal, request.extension)
    except SettingsError as error:
        raise Conflict(with_full_stop(error)) from None


def _values(film: Film, frame: int, request: PictureRequest) -> Iterator[F32]:
    """Yields the picture's values in bands of shape (rows, width, channels), from the top, before downscaling."""
    if request.motion is not None:
        yield from _with_motion(film, frame, request)
        return
    if request.denoised is None:
        yield from bands(film, frame, _names(film, request), request.names_of_ids, request.gains)
        return
    if _has_alpha(film, request):
        yield from _denoised_with_alpha(film, frame, request)
        return
    with request.denoised() as file:
        for y in range(0, film.height, ROWS):
            yield _denoised_rows(file, min(ROWS, film.height - y), film.width, request)


def _denoised_with_alpha(film: Film, frame: int, request: PictureRequest) -> Iterator[F32]:
    """Yields bands of the denoised colour, with the film's alpha as a fourth channel."""
    assert request.denoised is not None
    with request.denoised() as file:
        for alpha in bands(film, frame, [aovs.ALPHA]):
            yield np.concatenate([_denoised_rows(file, alpha.shape[0], film.width, request), alpha], axis=2)


def _denoised_rows(file: BinaryIO, rows: int, width: int, request: PictureRequest) -> F32:
    """Returns the next rows of a denoised colour, or of denoised light groups as a mixed colour, shape (rows, width, 3)."""
    groups = max(1, request.lights)
    values = np.frombuffer(file.read(12 * rows * groups * width), "<f4").reshape(rows, groups, width, 3)
    return np.einsum("rgwc,gc->rwc", values, np.asarray(request.gains, "<f4")) if request.lights else values[:, 0]


def _with_motion(film: Film, frame: int, request: PictureRequest) -> Iterator[F32]:
    """Yields bands of the film's channels with the motion vectors appended as channels."""
    assert request.motion is not None
    names = [name for name in _names(film, request) if name != aovs.MOTION]
    with request.motion() as file:
        for band in bands(film, frame, names or ["samples"], request.names_of_ids):
            size = aovs.size(aovs.MOTION)
            vectors = np.frombuffer(file.read(4 * size * band.shape[0] * film.width), "<f4").reshape(-1, film.width, size)
            yield np.concatenate([band, vectors], axis=2) if names else vectors


def _tone_mapped(film: Film, frame: int, request: PictureRequest, side: int) -> Iterator[npt.NDArray[np.uint8]]:
    parts: Iterable[F32] = reduced_bands(_values(film, frame, request), side)
    exposure = request.exposure
    if request.visible:
        parts = [*parts]
        dark = darkness(np.concatenate(parts)[..., :3] * np.float32(2.0**exposure))
        exposure += dark.exposure if dark else 0.0
    for band in parts:
        if _has_alpha(film, request):
            yield tonemap.apply_straight(band[..., :3], band[..., 3], exposure, request.curve)
        else:
            yield tonemap.apply(band, exposure, request.curve)


def _whole_plane(film: Film, frame: int, request: PictureRequest) -> F32:
    """Returns the requested AOV of the whole frame, for AOVs that are scaled to their minimum and maximum."""
    (name,) = request.planes
    size = aovs.size(name)
    plane = _filled_from_top(np.empty((film.height, film.width, size), np.float32), _values(film, frame, request))
    return plane if size > 1 else plane[..., 0]


def _grey_to_rgb(band: F32) -> F32:
    """Returns a band of shape (rows, width, 1) with its channel repeated three times; other bands unchanged."""
    return np.repeat(band, 3, axis=2) if band.shape[2] == 1 else band


def _filled_from_top(out: npt.NDArray[Any], parts: Iterator[npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """Copies consecutive bands of rows into `out` from the top, and returns `out`."""
    y = 0
    for part in parts:
        out[y : y + len(part)] = part
        y += len(part)
    return out
