"""Divides a view into pieces to render: first a small picture or a draft, then the whole view with more and more samples.

A piece is a range of samples of one tile. The first picture is as large as the farm can render in FIRST_PICTURE_S seconds at
the measured cost of a sample. If the whole view takes much longer, a picture of medium size follows. The whole view is then
rendered with 1, 2, 4, 8 ... samples per pixel. All samples of a piece are in one half (renderer.film.in_half), so that the
noise can be estimated from the sums of the halves. After GUIDES_AFTER samples of a denoised view, the first hits alone of
the samples up to FIRST_GUIDES are rendered, which cost less than a third of whole paths: the denoiser's guides are then smooth
before the colour is. A piece takes about PIECE_TARGET_S seconds, so that slots soon become free for a new view. A message to
a worker has several pieces, so that its round trip is short compared with its rendering.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from protocol.view_parts import CLEAN_GUIDE_SAMPLES
from renderer.settings import Tile, tiles_of

__all__ = [
    "FIRST_GUIDES",
    "FIRST_PICTURE_S",
    "GUIDES_AFTER",
    "DraftSize",
    "Level",
    "Passes",
    "Piece",
    "draft_size",
    "has_guides",
    "levels_of",
]

FIRST_PICTURE_S = 0.035
PIECE_TARGET_S = 0.03
MESSAGE_TARGET_S = 0.1
CARD_MESSAGE_TARGET_S = 0.06  # in one launch, after which a card is free for a new view
MIN_PIXELS = 32 * 32  # pixels
UNMEASURED_PIECES, MAX_CARD_PIECES = 16, 256  # of a message to a graphics card whose speed is unknown, and to any
DRAFT_S = 0.02  # in which a card renders a draft
DRAFT_SAMPLES = 4
DRAFT_STEPS = 8  # sizes of drafts are multiples of the view's size divided by this, so that they seldom change
GUIDES_AFTER = 1  # samples per pixel that are rendered before the first hits of further ones
# Samples per pixel whose albedo and normal guide the first denoised picture. With the guides of 16 its error is the same
# (docs/performance.md); later pictures have those of CLEAN_GUIDE_SAMPLES, which come with their samples.
FIRST_GUIDES = 4
GUIDE_COST = 0.3  # cost of a first hit, relative to a whole sample; 0.3 to 0.35 measured
MAX_LEVEL_RATIO = 32.0  # largest ratio of pixels between two levels: a sample of the larger one takes about a second


@dataclass(frozen=True)
class Piece:
    """A unit of work: the samples first ... first + count - 1 of one tile of one resolution level.

    level, tile: indices. is_guide: whether only the first hits of the samples are rendered, to guide the denoiser.
    """

    level: int
    tile: int
    first: int
    count: int
    is_guide: bool = False


@dataclass(frozen=True)
class Level:
    """One resolution at which a view is rendered.

    samples: samples per pixel. tiles: ordered from the centre outwards.
    """

    width: int
    height: int
    samples: int
    tiles: list[Tile]


class DraftSize(NamedTuple):
    """Size of a draft. samples: per pixel."""

    width: int
    height: int
    samples: int


def draft_size(width: int, height: int, samples: int, cost_s: float) -> DraftSize:
    """Returns the size of a view's draft: that of the view with up to DRAFT_SAMPLES samples, or less if the card is too slow.

    width, height, samples: of the view. cost_s: seconds per sample of a pixel on the card.
    """
    affordable = DRAFT_S / (cost_s * width * height)  # samples per pixel of the view
    scale = min(1.0, max(1, int(DRAFT_STEPS * math.sqrt(affordable))) / DRAFT_STEPS)
    most = min(samples, DRAFT_SAMPLES)
    return DraftSize(math.ceil(width * scale), math.ceil(height * scale), min(max(1, int(affordable)), most))


def levels_of(width: int, height: int, samples: int, cost_s: float, slots: int, card_rate: float = 0.0) -> list[Level]:
    """Returns one to three resolution levels for a view, ordered by size; the last has the view's full size.

    samples: samples per pixel of the last level. cost_s: seconds per sample of a pixel on one slot. slots: number of slots that
    render. card_rate: samples of a pixel per second of graphics cards that render, too.
    """
    whole = width * height
    first = max(MIN_PIXELS, (slots / cost_s + card_rate) * FIRST_PICTURE_S)
    sizes = []
    if whole > 1.5 * first:
        sizes.append(first)
        if whole > MAX_LEVEL_RATIO * first:
            sizes.append(math.sqrt(first * whole))
    levels = []
    for number, pixels in enumerate(sizes):
        scale = math.sqrt(pixels / whole)
        w, h = max(1, round(width * scale)), max(1, round(height * scale))
        levels.append(Level(w, h, 1, _tiles(w, h, cost_s, 2 * slots if number == 0 else slots)))
    return [*levels, Level(width, height, samples, _tiles(width, height, cost_s, 2 * slots))]


class Passes:
    """The order in which the pieces of a view are rendered.

    cost_s: seconds per sample of a pixel on one slot. has_guides: whether the view is denoised.
    """

    def __init__(self, levels: list[Level], cost_s: float, *, has_guides: bool = False) -> None:
        self.levels = levels
        self._cost_s = cost_s
        self._has_guides = has_guides
        self._pieces = self._all_pieces()
        self._lost: deque[Piece] = deque()
        self._held: Piece | None = None
        self._ended: set[tuple[int, int]] = set()

    def next_message(self) -> list[Piece]:
        """Returns the pieces of the next message, all of one level and one kind; an empty list if no pieces remain."""
        chosen: list[Piece] = []
        expected = 0.0
        while (piece := self._next_piece()) is not None:
            if chosen and (not self._is_alike(piece, chosen[0]) or expected >= self._message_target_s(piece.level)):
                self._held = piece
                break
            chosen.append(piece)
            expected += self.expected_s(piece)
        return chosen

    def next_card_message(self, cost_s: float | None) -> list[Piece]:
        """Returns the pieces of the next message to a graphics card, all of one level and kind; an empty list if none remain.

        cost_s: seconds per sample of a pixel on the card; None if unknown. Of a small first picture it gets all that remains.
        """
        chosen: list[Piece] = []
        expected = 0.0
        most = MAX_CARD_PIECES if cost_s else UNMEASURED_PIECES
        while (piece := self._next_piece()) is not None:
            if chosen and (not self._is_alike(piece, chosen[0]) or expected >= CARD_MESSAGE_TARGET_S or len(chosen) >= most):
                self._held = piece
                break
            chosen.append(piece)
            expected += self.expected_s(piece) / self._cost_s * (cost_s or 0.0)
        return chosen

    def requeue(self, pieces: list[Piece]) -> None:
        """Adds pieces that were lost, which precede those not rendered yet."""
        self._lost.extend(pieces)

    def complete_tile(self, level: int, tile: int) -> None:
        """Removes the remaining pieces of a tile that needs no more samples. level, tile: indices."""
        self._ended.add((level, tile))

    def expected_s(self, piece: Piece) -> float:
        """Returns the expected time to render a piece on one slot, in seconds."""
        tile = self.levels[piece.level].tiles[piece.tile]
        return self._cost_s * tile.w * tile.h * piece.count * (GUIDE_COST if piece.is_guide else 1.0)

    def _is_alike(self, a: Piece, b: Piece) -> bool:
        """Returns True if one message may have both pieces: it has one size, one set of settings and one set of planes."""
        return (a.level, a.is_guide) == (b.level, b.is_guide) and (not self._has_guides or has_guides(a) == has_guides(b))

    def _message_target_s(self, level: int) -> float:
        return 0.0 if level == 0 and len(self.levels) > 1 else MESSAGE_TARGET_S

    def _next_piece(self) -> Piece | None:
        if self._held is not None:
            piece, self._held = self._held, None
            return piece
        while self._lost:
            piece = self._lost.popleft()
            if (piece.level, piece.tile) not in self._ended:
                return piece
        return next((piece for piece in self._pieces if (piece.level, piece.tile) not in self._ended), None)

    def _all_pieces(self) -> Iterator[Piece]:
        for number, level in enumerate(self.levels):
            first = 0
            while first < level.samples:
                count = min(max(first, 1), level.samples - first)
                middle = first + (first + 1) // 2  # first sample number of the second half
                for tile, rect in enumerate(level.tiles):
                    at_once = max(1, int(PIECE_TARGET_S * 1.5 / (self._cost_s * rect.w * rect.h)))
                    for begin, end in ((first, min(middle, first + count)), (middle, first + count)):
                        for at in range(begin, end, at_once):
                            yield Piece(number, tile, at, min(at_once, end - at))
                first += count
                if self._has_guides and first == GUIDES_AFTER < level.samples and number == len(self.levels) - 1:
                    yield from self._guide_pieces(number)

    def _guide_pieces(self, number: int) -> Iterator[Piece]:
        for tile, rect in enumerate(self.levels[number].tiles):
            at_once = max(1, int(PIECE_TARGET_S / (GUIDE_COST * self._cost_s * rect.w * rect.h)))
            for at in range(GUIDES_AFTER, FIRST_GUIDES, at_once):
                yield Piece(number, tile, at, min(at_once, FIRST_GUIDES - at), is_guide=True)


def has_guides(piece: Piece) -> bool:
    """Returns True if albedo and normal of a piece guide the denoiser. Those of each sample are added once."""
    return piece.is_guide or piece.first < GUIDES_AFTER or FIRST_GUIDES <= piece.first < CLEAN_GUIDE_SAMPLES


def _tiles(width: int, height: int, cost_s: float, at_least: int) -> list[Tile]:
    """Divides a level into tiles that take about PIECE_TARGET_S seconds per sample.

    cost_s: seconds per sample of a pixel. at_least: minimum number of tiles, unless the picture is tiny.
    """
    pixels = min(PIECE_TARGET_S / cost_s, width * height / at_least)
    side = min(256, max(16, 4 * round(math.sqrt(pixels) / 4)))
    middle = (width / 2, height / 2)

    def from_the_middle(tile: Tile) -> float:
        return (tile.x + tile.w / 2 - middle[0]) ** 2 + (tile.y + tile.h / 2 - middle[1]) ** 2

    return sorted(tiles_of(width, height, side), key=from_the_middle)
