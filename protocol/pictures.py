"""Packets with pictures for viewers: a tile of a job, a job's whole frame, a picture or draft of a live view. Little-endian.

Blender's add-on contains copies of this module and of the modules that it imports (protocol/generate.py), so keep the imports
few.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from typing import Annotated, NamedTuple

import numpy as np
import numpy.typing as npt

from protocol.coarse import coarse, count_hues, radiance
from protocol.layout import F32 as FLOAT
from protocol.layout import U16, U32, Layout
from renderer.image import rgbe9995

__all__ = [
    "ALPHA",
    "DRAFT",
    "EXACT",
    "FILM",
    "TILE",
    "VIEW",
    "VIEW_TILE",
    "DraftHead",
    "FilmHead",
    "FilmPicture",
    "TileHead",
    "TilePicture",
    "ViewHead",
    "ViewPicture",
    "ViewTile",
    "ViewTileHead",
    "Words",
    "decode_film",
    "decode_tile",
    "decode_view",
    "encode_draft",
    "encode_film",
    "encode_tile",
    "encode_view",
    "planes_of",
    "words_of_planes",
]

Words = npt.NDArray[np.uint32]
F32 = npt.NDArray[np.float32]
Planes = npt.NDArray[np.uint8]
Rect = tuple[int, int, int, int]  # x, y, width, height; from the upper left corner

FRAMES = 1 << 16  # numbers of frames are sent modulo this
NUMBERS = 1 << 32
EXACT = 1 << 31
ALPHA = 1 << 30
RAW = -15  # zlib's wbits for raw DEFLATE
LEVEL = 1  # noise: higher levels take longer and save nothing


class TileHead(NamedTuple):
    """The head of a live tile. w * h RGB9E5 words follow, rows from the top."""

    frame: Annotated[int, U16, "integer part of the frame's number, modulo 65536"]
    seq: Annotated[int, U32, "number that the client acknowledges, modulo 2**32"]
    x: Annotated[int, U16, "left edge in the picture"]
    y: Annotated[int, U16, "upper edge in the picture"]
    w: Annotated[int, U16, "width"]
    h: Annotated[int, U16, "height"]
    spp: Annotated[int, U32, "samples per pixel"]


class FilmHead(NamedTuple):
    """The head of the packet of a whole frame.

    A u32 with the samples per pixel of every tile follows, tiles row by row; then w * h RGB9E5 words, rows from the top, as
    four byte planes, lowest byte first. Byte planes compress better: neighbouring exponents are similar, while mantissas are
    noise.
    """

    frame: Annotated[int, U16, "integer part of the frame's number, modulo 65536"]
    w: Annotated[int, U16, "width"]
    h: Annotated[int, U16, "height"]
    side: Annotated[int, U32, "size of a tile"]


class ViewHead(NamedTuple):
    """The head of a live view's picture. A ViewTileHead for every tile follows, then raw DEFLATE data.

    The data begins with all tiles that are not exact, one after another, rows from the top: differences of brightness codes
    (coarse.py) in zigzag encoding (0, -1, 1, -2 ... as 0, 1, 2, 3 ...), first all low bytes, then all high bytes; then the
    differences of the fractions of red, and of green, modulo 256. Then come all exact tiles as RGB9E5 words in four byte
    planes, lowest byte first. Last, if the tiles have alpha, come the coverages of all of them, a byte per pixel.
    """

    tiles: Annotated[int, U16, "number of tiles"]
    id: Annotated[int, U32, "the client's number of the view, modulo 2**32"]
    seq: Annotated[int, U32, "number that the client acknowledges, modulo 2**32"]
    w: Annotated[int, U16, "width of this picture"]
    h: Annotated[int, U16, "height of this picture"]
    whole_w: Annotated[int, U16, "width of the whole view"]
    whole_h: Annotated[int, U16, "height of the whole view"]


class ViewTileHead(NamedTuple):
    """The head of a tile of a live view's picture."""

    x: Annotated[int, U16, "left edge in the picture"]
    y: Annotated[int, U16, "upper edge in the picture"]
    w: Annotated[int, U16, "width"]
    h: Annotated[int, U16, "height"]
    samples: Annotated[int, U32, "samples per pixel; the highest bit marks an exact tile, the next one a tile with alpha"]


class DraftHead(NamedTuple):
    """The head of a draft, a picture of a live view whose camera moves. A JPEG follows, which has no color profile.

    Its red, green and blue are round(255 log2(1 + 255 x) / 12), where x is the radiance times 2**exposure
    (renderer/kernel/draft.py). The viewer applies exposure and tone curve.
    """

    id: Annotated[int, U32, "the client's number of the view, modulo 2**32"]
    seq: Annotated[int, U32, "number that the client acknowledges, modulo 2**32"]
    w: Annotated[int, U16, "width of this picture"]
    h: Annotated[int, U16, "height of this picture"]
    whole_w: Annotated[int, U16, "width of the whole view"]
    whole_h: Annotated[int, U16, "height of the whole view"]
    samples: Annotated[int, U32, "samples per pixel"]
    exposure: Annotated[float, FLOAT, "exposure of the JPEG's scale, in stops"]


TILE = Layout("tile", TileHead, version=1, kind=1)
FILM = Layout("film", FilmHead, version=1, kind=2)
VIEW = Layout("view", ViewHead, version=2, kind=3)
VIEW_TILE = Layout("view's tile", ViewTileHead)
DRAFT = Layout("draft", DraftHead, version=1, kind=6)


class TilePicture(NamedTuple):
    """A decoded packet of a tile. words: RGB9E5, shape (h, w)."""

    head: TileHead
    words: Words


class FilmPicture(NamedTuple):
    """A decoded packet of a whole frame. words: RGB9E5, shape (h, w).

    samples: samples per pixel of each tile, tiles row by row.
    """

    head: FilmHead
    samples: Words
    words: Words


class ViewTile(NamedTuple):
    """A tile of a live view's picture. mean: radiance, shape (3, h, w). is_exact: whether it is encoded as RGB9E5 words.

    alpha: coverage before a transparent background, (h, w), 0 ... 255; all tiles of a picture have one, or none.
    """

    rect: Rect
    mean: F32
    samples: int
    is_exact: bool
    alpha: Planes | None = None

    @property
    def flagged_samples(self) -> int:
        """Returns the samples per pixel with the flags of the tile's head."""
        return self.samples | EXACT * self.is_exact | ALPHA * (self.alpha is not None)


class ViewPicture(NamedTuple):
    """A decoded picture of a live view. It has only the tiles that have changed."""

    head: ViewHead
    tiles: list[ViewTile]


def encode_tile(frame: int, seq: int, rect: Rect, spp: int, words: bytes) -> bytes:
    """Encodes a tile of a job's frame.

    frame: integer part of the frame number. seq: number that the client acknowledges. rect: x, y, width and height. spp:
    samples per pixel. words: RGB9E5, little-endian.
    """
    return TILE.pack(TileHead(frame % FRAMES, seq % NUMBERS, *rect, spp)) + words


def decode_tile(packet: bytes) -> TilePicture:
    """Decodes the packet of a tile. Raises ValueError if it is malformed."""
    head = TILE.unpack(packet)
    if len(packet) != TILE.size + 4 * head.w * head.h:
        raise ValueError(f"a tile of {head.w} x {head.h} pixels has {len(packet)} bytes")
    return TilePicture(head, np.frombuffer(packet, "<u4", head.w * head.h, TILE.size).reshape(head.h, head.w))


def encode_film(frame: int, size: tuple[int, int], side: int, samples: Sequence[int] | Words, planes: Planes) -> list[memoryview]:
    """Encodes a whole frame as a list of buffers, which can be sent without joining them.

    frame: integer part of the frame number. size: width and height. side: of a tile. samples: samples per pixel of each tile.
    planes: byte planes of the RGB9E5 words, (4, h, w).
    """
    head = FILM.pack(FilmHead(frame % FRAMES, *size, side)) + np.asarray(samples, "<u4").tobytes()
    return [memoryview(head), planes.reshape(-1).data]


def decode_film(packet: bytes) -> FilmPicture:
    """Decodes the packet of a whole frame. Raises ValueError if it is malformed."""
    head = FILM.unpack(packet)
    if not head.side:
        raise ValueError("a film has tiles of size 0")
    tiles, pixels = -(-head.w // head.side) * -(-head.h // head.side), head.w * head.h
    if len(packet) != FILM.size + 4 * tiles + 4 * pixels:
        raise ValueError(f"a film of {head.w} x {head.h} pixels has {len(packet)} bytes")
    planes = np.frombuffer(packet, np.uint8, 4 * pixels, FILM.size + 4 * tiles)
    return FilmPicture(head, np.frombuffer(packet, "<u4", tiles, FILM.size), words_of_planes(planes).reshape(head.h, head.w))


def planes_of(words: Words) -> Planes:
    """Splits words into four byte planes, lowest byte first. Their shape is (4, *words.shape)."""
    return np.ascontiguousarray(np.moveaxis(words.astype("<u4")[..., None].view(np.uint8), -1, 0))


def words_of_planes(planes: Planes) -> Words:
    """Joins byte planes to words; returns them as a flat array."""
    return np.ascontiguousarray(planes.reshape(4, -1).T).view("<u4").reshape(-1)


def encode_view(tiles: Sequence[ViewTile], size: tuple[int, int], view_size: tuple[int, int], id: int, seq: int) -> bytes:
    """Encodes a picture of a live view.

    size: this picture's (width, height). view_size: the view's full size. id: the client's number of the view. seq: number that
    the client acknowledges.
    """
    head = [
        VIEW.pack(ViewHead(len(tiles), id % NUMBERS, seq % NUMBERS, *size, *view_size)),
        *(VIEW_TILE.pack(ViewTileHead(*tile.rect, tile.flagged_samples)) for tile in tiles),
    ]
    packer = zlib.compressobj(LEVEL, zlib.DEFLATED, RAW)
    body = [packer.compress(plane.data) for plane in _body(tiles)]
    return b"".join([*head, *body, packer.flush()])


def _body(tiles: Sequence[ViewTile]) -> Iterator[Planes]:
    rough = [coarse(tile.mean) for tile in tiles if not tile.is_exact]
    if rough:
        codes: npt.NDArray[np.int16] = np.concatenate([codes.ravel() for codes, _ in rough])
        more = np.empty_like(codes)
        more[0] = codes[0]
        np.subtract(codes[1:], codes[:-1], out=more[1:])
        folded = (more << 1 ^ more >> 15).astype(np.uint16)
        yield folded.astype(np.uint8)
        yield (folded >> 8).astype(np.uint8)
        for i in (0, 1):
            yield np.diff(np.concatenate([hue[i].ravel() for _, hue in rough]), prepend=np.uint8(0))
    exact = [rgbe9995.pack(np.moveaxis(tile.mean, 0, -1)).ravel() for tile in tiles if tile.is_exact]
    if exact:
        yield from planes_of(np.concatenate(exact))
    yield from (np.ascontiguousarray(tile.alpha) for tile in tiles if tile.alpha is not None)


def encode_draft(head: DraftHead, jpeg: bytes) -> bytes:
    """Encodes a draft of a live view."""
    return DRAFT.pack(head._replace(id=head.id % NUMBERS, seq=head.seq % NUMBERS)) + jpeg


def decode_view(packet: bytes) -> ViewPicture:
    """Decodes a picture of a live view. Raises ValueError if it is malformed."""
    head = VIEW.unpack(packet)
    tiles = VIEW_TILE.unpack_all(packet, VIEW.size, head.tiles)
    try:
        body = zlib.decompress(packet[VIEW.size + head.tiles * VIEW_TILE.size :], RAW)
    except zlib.error as error:
        raise ValueError(f"a view's tiles are damaged: {error}") from None
    rough = [tile for tile in tiles if not tile.samples & EXACT]
    pixels = sum(tile.w * tile.h for tile in rough)
    hues = sum(count_hues(tile.w, tile.h) for tile in rough)
    exact = sum(tile.w * tile.h for tile in tiles) - pixels
    covered = sum(tile.w * tile.h for tile in tiles if tile.samples & ALPHA)
    if len(body) != 2 * pixels + 2 * hues + 4 * exact + covered:
        raise ValueError(f"a view's tiles have {len(body)} bytes")
    planes = np.frombuffer(body, np.uint8)
    folded = planes[:pixels].astype(np.int32) | planes[pixels : 2 * pixels].astype(np.int32) << 8
    codes = np.cumsum(folded >> 1 ^ -(folded & 1), dtype=np.int32)
    hue = np.cumsum(planes[2 * pixels :][: 2 * hues].reshape(2, hues), axis=1, dtype=np.uint8)
    words = words_of_planes(planes[2 * pixels + 2 * hues :][: 4 * exact])
    found, at, at_hue, at_word, at_alpha = [], 0, 0, 0, len(body) - covered
    for x, y, w, h, samples in tiles:
        if samples & EXACT:
            light = rgbe9995.unpack(words[at_word : at_word + w * h].reshape(h, w))
            mean = np.ascontiguousarray(np.moveaxis(light, -1, 0))
            at_word += w * h
        else:
            count = count_hues(w, h)
            mean = radiance(codes[at : at + w * h].reshape(h, w), hue[:, at_hue : at_hue + count])
            at, at_hue = at + w * h, at_hue + count
        alpha = planes[at_alpha : at_alpha + w * h].reshape(h, w) if samples & ALPHA else None
        at_alpha += w * h if samples & ALPHA else 0
        found.append(ViewTile((x, y, w, h), mean, samples & ~(EXACT | ALPHA), bool(samples & EXACT), alpha))
    return ViewPicture(head, found)
