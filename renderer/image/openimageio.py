"""Decodes images with OpenImageIO: floats, 16 bits, layers, compressed blocks."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio  # noqa: N813 -- the name its own documentation uses

from renderer.errors import SceneError
from renderer.image.channels import Colour, colour_of
from renderer.image.unread import header_notes, primaries_notes, profile_notes
from renderer.sentences import Sentence

__all__ = ["Decoded", "Limits", "decode_with_openimageio", "unpremultiplied"]

_MOST_CHANNELS = 1024  # of all layers together
_BAND = 1 << 22  # pixels that are decoded at a time where an image is made smaller
_RESOLUTION = re.compile(rb"\n([-+])([XY])\s+\d+\s+([-+])([XY])\s+\d+\s*\n")
_LONGEST_HEADER = 1 << 20
_MAX_HALF = 65504.0  # replaces infinity: the greatest half
_FLOATS = (oiio.HALF, oiio.FLOAT, oiio.DOUBLE)
# Luminance weights of Rec. 709, by which OpenEXR's Y, RY and BY are made.
_YR, _YG, _YB = 0.2126, 0.7152, 0.0722


class Decoded(NamedTuple):
    """A decoded image: its pixels, rows from the top, and notes for the user on what was guessed or changed."""

    pixels: npt.NDArray[Any]
    notes: list[str]


class Limits(NamedTuple):
    """Limits on an image's number of pixels.

    most: larger images are refused. kept: larger images are scaled down to this number.
    """

    most: int
    kept: int

    def factor(self, name: str, width: int, height: int) -> int:
        """Returns the factor by which each side is divided to scale the image down to the limit.

        Raises SceneError if the image is too large or empty.
        """
        if width < 1 or height < 1 or width * height > self.most:
            raise SceneError(
                Sentence(
                    "image-too-large",
                    "{name} is {width} x {height} pixels; at most {million} million are allowed. Give a smaller image",
                    name=name,
                    width=width,
                    height=height,
                    million=self.most >> 20,
                )
            )
        factor = 1
        while -(-width // factor) * -(-height // factor) > self.kept:
            factor += 1
        return factor


def decode_with_openimageio(data: bytes, name: str, suffix: str, limits: Limits, straight: bool) -> Decoded:
    """Decodes an image with OpenImageIO. straight: divides premultiplied colours by alpha.

    Raises SceneError if the image is damaged or not supported.
    """
    # OpenImageIO's Python module reads named files only.
    with tempfile.TemporaryDirectory(prefix="rayfarm-") as folder:
        path = Path(folder) / f"image{suffix}"
        path.write_bytes(data)
        wish = oiio.ImageSpec()
        wish.attribute("oiio:UnassociatedAlpha", 1)
        source = oiio.ImageInput.open(str(path), wish)
        if source is None:
            raise SceneError(
                Sentence(
                    "image-damaged-or-misnamed",
                    "{name}: the image is damaged or of another format than its name says ({error}); export it again",
                    name=name,
                    error=_error(oiio, path),
                )
            )
        try:
            return _read(source, data, name, suffix, limits, straight, path)
        finally:
            source.close()


def _read(source: Any, data: bytes, name: str, suffix: str, limits: Limits, straight: bool, path: Path) -> Decoded:
    colour, spec = _select_part(source, name, suffix)
    notes: list[str] = []
    if colour.others:
        others = [f'"{other[:60]}"' for other in sorted(set(colour.others))[:8]]
        notes.append(
            Sentence(
                "image-several-layers",
                '{name}: has several layers; "{layer}" is shown, not {others}. Name one of them Combined, or remove the others',
                name=name,
                layer=colour.layer,
                others=others,
            )
        )
    width, height = spec.width, spec.height
    factor = limits.factor(name, width, height)
    if suffix == ".exr":
        factor = max(factor, limits.factor(name, spec.full_width, spec.full_height))
    numbers = [colour.channels[key] for key in colour.channels if key in ("r", "g", "b", "a", "y", "ry", "by")]
    first, last = min(numbers), max(numbers) + 1
    kind = oiio.FLOAT if spec.format.basetype in _FLOATS else oiio.UINT8 if spec.format.size() == 1 else oiio.UINT16
    pixels = _pixels(source, colour.part, spec, (first, last), kind, factor)
    if pixels is None:
        raise SceneError(
            Sentence(
                "image-damaged",
                "{name}: the image is damaged ({error}); export it again",
                name=name,
                error=_error(source, path),
            )
        )
    if factor > 1:
        notes.append(
            Sentence(
                "image-reduced",
                "{name}: its {width} x {height} pixels are reduced to {new_width} x {new_height}, as at "
                "most {million} million are kept; give it in that size to save time",
                name=name,
                width=width,
                height=height,
                new_width=pixels.shape[1],
                new_height=pixels.shape[0],
                million=limits.kept >> 20,
            )
        )
    planes = {key: pixels[..., number - first] for key, number in colour.channels.items() if first <= number < last}
    rgba = _rgba(planes, colour, suffix)
    if suffix == ".exr":
        rgba = _place_in_display_window(rgba, spec, factor)
    if suffix == ".hdr":
        rgba = _apply_orientation(rgba, data)
        notes += header_notes(data, name)
    notes += primaries_notes(spec.getattribute("chromaticities"), name) + profile_notes(spec.getattribute("ICCProfile"), name)
    if rgba.dtype == np.float32:
        if odd := int((~np.isfinite(rgba)).any(axis=-1).sum()):
            notes.append(
                Sentence(
                    "image-pixels-not-finite",
                    "{name}: {count} pixels are not finite; they are black, or as bright as possible",
                    name=name,
                    count=odd,
                )
            )
        rgba = np.nan_to_num(rgba, nan=0.0, posinf=_MAX_HALF, neginf=0.0)
    is_associated = suffix == ".exr" or (suffix in (".tif", ".tiff") and not spec.getattribute("oiio:UnassociatedAlpha"))
    if str(spec.getattribute("compression")) in ("DXT2", "DXT4"):
        is_associated = True
    return Decoded(unpremultiplied(rgba) if straight and is_associated else np.ascontiguousarray(rgba), notes)


def _select_part(source: Any, name: str, suffix: str) -> tuple[Colour, Any]:
    """Chooses the channels to read and the part of the file that contains them; selects that part in `source`.

    Returns the channels and the part's ImageSpec.
    """
    parts: list[tuple[str, list[str]]] = []
    count = 0
    while source.seek_subimage(len(parts), 0):
        spec = source.spec()
        count += spec.nchannels
        if spec.nchannels < 1 or count > _MOST_CHANNELS or spec.depth > 1:
            raise SceneError(
                Sentence(
                    "image-channels-unsupported",
                    "{name} has {count} channels; give a plain RGB, RGBA or grey image",
                    name=name,
                    count=count,
                )
            )
        title = str(spec.getattribute("name") or spec.getattribute("oiio:subimagename") or "") if suffix == ".exr" else ""
        parts.append((title, ["deep"] * spec.nchannels if spec.deep else list(spec.channelnames)))
        if suffix != ".exr":
            break
    colour = colour_of(parts)
    if colour is None or all(name == "deep" for name in parts[colour.part][1]):
        if not parts or suffix == ".exr":
            listed = ", ".join(channel for _, channels in parts for channel in channels)[:200]
            raise SceneError(
                Sentence(
                    "image-channels-unnamed",
                    "{name}: none of its channels ({channels}) is named R, G, B or Y; export it with these names",
                    name=name,
                    channels=listed,
                )
            )
        colour = Colour(0, "", *_channels_by_position(len(parts[0][1])), [])
    source.seek_subimage(colour.part, 0)
    return colour, source.spec()


def _channels_by_position(count: int) -> tuple[str, dict[str, int]]:
    """Returns the kind and the channels of an image by position, for formats that do not name channels."""
    if count < 3:
        return "y", {"y": 0, "a": 1} if count == 2 else {"y": 0}
    return "rgb", dict(zip("rgba", range(count), strict=False))


def _rgba(planes: dict[str, npt.NDArray[Any]], colour: Colour, suffix: str) -> npt.NDArray[Any]:
    """Returns the pixels (h, w, 4) from separate channels; (h, w, 3) for floats without alpha."""
    some = next(iter(planes.values()))
    if colour.kind == "y":
        rgb = [planes["y"]] * 3
    elif colour.kind == "chroma":
        y = planes["y"]
        red, blue = (planes["ry"] + 1) * y, (planes["by"] + 1) * y
        rgb = [red, (y - _YR * red - _YB * blue) / _YG, blue]
    else:
        rgb = [planes.get(key, np.zeros_like(some)) for key in "rgb"]
        if suffix == ".dds" and "b" not in planes:
            rgb = [some, some, some] if "g" not in planes else [*rgb[:2], _reconstruct_z(*rgb[:2])]
    if "a" in planes:
        rgb.append(planes["a"])
    elif some.dtype != np.float32:
        rgb.append(np.full_like(some, np.iinfo(some.dtype).max))
    return np.stack(rgb, axis=-1)


def _reconstruct_z(x: npt.NDArray[Any], y: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Returns the z coordinate, -1 ... 1, of unit normals that are stored as x and y in two-channel blocks (BC5)."""
    most = 1.0 if x.dtype == np.float32 else float(np.iinfo(x.dtype).max)
    squares = sum((2 * (each.astype(np.float32) / np.float32(most)) - 1) ** 2 for each in (x, y))
    z = 0.5 + 0.5 * np.sqrt(np.maximum(1 - squares, 0))
    return np.asarray(z if x.dtype == np.float32 else np.rint(z * most)).astype(x.dtype)


def _pixels(source: Any, part: int, spec: Any, channels: tuple[int, int], kind: Any, factor: int) -> npt.NDArray[Any] | None:
    """Returns the pixels (h, w, channels) of a part, scaled down by `factor`; None if the file is damaged."""
    if factor > 1:
        return _scaled_down(source, spec, channels, kind, factor)
    found = source.read_image(part, 0, *channels, kind)
    return None if found is None else np.asarray(found).reshape(spec.height, spec.width, -1)


def _scaled_down(source: Any, spec: Any, channels: tuple[int, int], kind: Any, factor: int) -> npt.NDArray[Any] | None:
    """Returns the image scaled down by averaging squares of pixels, read in bands of rows; None if the file is damaged."""
    tile = spec.tile_height or 1
    step = np.lcm(factor, tile)
    step = int(step * max(1, _BAND // (spec.width * step)))
    bands = []
    for top in range(0, spec.height, step):
        rows = min(step, spec.height - top)
        y, x = spec.y + top, spec.x
        if spec.tile_width:
            band = source.read_tiles(x, x + spec.width, y, y + rows, spec.z, spec.z + 1, *channels, kind)
        else:
            band = source.read_scanlines(y, y + rows, spec.z, *channels, kind)
        if band is None:
            return None
        bands.append(_block_means(np.asarray(band).reshape(rows, spec.width, -1), factor))
    return np.concatenate(bands)


def _block_means(pixels: npt.NDArray[Any], factor: int) -> npt.NDArray[Any]:
    """Returns the means of squares of `factor` x `factor` pixels, smaller at the right and lower edges."""
    rows, columns = (np.arange(0, length, factor) for length in pixels.shape[:2])
    total = np.add.reduceat(pixels.astype(np.float32), rows, axis=0)
    total = np.add.reduceat(total, columns, axis=1)
    counts = [np.diff(np.append(starts, length)) for starts, length in zip((rows, columns), pixels.shape[:2], strict=True)]
    total /= (counts[0][:, None] * counts[1])[..., None].astype(np.float32)
    return total if pixels.dtype == np.float32 else np.rint(total).astype(pixels.dtype)


def _place_in_display_window(pixels: npt.NDArray[Any], spec: Any, factor: int) -> npt.NDArray[Any]:
    """Returns the display window of an image with a different data window; black and transparent outside the data."""
    window = spec.full_x, spec.full_y, spec.full_width, spec.full_height
    if window == (spec.x, spec.y, spec.width, spec.height) or spec.full_width < 1 or spec.full_height < 1:
        return pixels
    left, top = ((a - b) // factor for a, b in ((spec.x, spec.full_x), (spec.y, spec.full_y)))
    height, width = -(-spec.full_height // factor), -(-spec.full_width // factor)
    shown = np.zeros((height, width, pixels.shape[2]), pixels.dtype)
    y0, x0 = max(top, 0), max(left, 0)
    y1, x1 = min(top + pixels.shape[0], height), min(left + pixels.shape[1], width)
    if y0 < y1 and x0 < x1:
        shown[y0:y1, x0:x1] = pixels[y0 - top : y1 - top, x0 - left : x1 - left]
    return shown


def _apply_orientation(pixels: npt.NDArray[Any], data: bytes) -> npt.NDArray[Any]:
    """Reorders the pixels of a Radiance file so that row 0 is the top and column 0 the left.

    Files have one of eight orientations. Source: "Radiance file formats", Picture File Format: the resolution string names the
    axis of scanlines first.
    """
    found = _RESOLUTION.search(data, 0, _LONGEST_HEADER)
    if found is None:
        return pixels
    signs = {found[2]: found[1], found[4]: found[3]}
    if found[2] == b"X":
        pixels = pixels.swapaxes(0, 1)
    flips = tuple(axis for axis, name, sign in ((0, b"Y", b"+"), (1, b"X", b"-")) if signs.get(name) == sign)
    return np.flip(pixels, flips)


def unpremultiplied(pixels: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Returns the pixels with premultiplied colours divided by alpha; unchanged where alpha is 0."""
    if pixels.shape[2] < 4:
        return np.ascontiguousarray(pixels)
    most = np.float32(1.0 if pixels.dtype == np.float32 else np.iinfo(pixels.dtype).max)
    alpha = pixels[..., 3:].astype(np.float32) / most
    partial = (alpha > 0) & (alpha < 1)
    if not partial.any():
        return np.ascontiguousarray(pixels)
    rgb = pixels[..., :3].astype(np.float32) / np.where(partial, alpha, np.float32(1))
    if pixels.dtype != np.float32:
        rgb = np.rint(np.minimum(rgb, most))
    return np.concatenate([rgb.astype(pixels.dtype), pixels[..., 3:]], axis=2)


def _error(source: Any, path: Path) -> str:
    lines = str(source.geterror()).replace(str(path), path.name).strip().splitlines()
    return lines[0] if lines else "no reason given"
