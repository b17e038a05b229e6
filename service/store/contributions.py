"""Contributions of batches to a film: sums of a tile's samples, and the workers that sent them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from protocol.sums import add_sums, check_sums, merge_deep, merge_hits, pack_sums, unpack_sums
from renderer.film import BadSample, Sums
from renderer.settings import Tile
from service.store.senders import added_shares

__all__ = ["Contribution", "joined_contributions"]


@dataclass(frozen=True)
class Contribution:
    """The sums of samples first to first + count - 1 of a tile, to be merged into a film.

    frame: frame key. tile: index of the tile. sums: packed by protocol.sums. bad, bad_count: samples that were NaN or infinite.
    """

    frame: int
    tile: int
    first: int
    count: int
    sums: bytes
    bad: list[BadSample] = field(default_factory=list)
    bad_count: int = 0
    workers: Mapping[str, int] = field(default_factory=dict)  # samples per pixel by the worker that rendered them


def joined_contributions(
    contributions: list[Contribution], tiles: list[Tile], separates_senders: bool
) -> list[tuple[Contribution, Sums | None]]:
    """Joins contributions with contiguous samples of the same tile, since each stored row is costly.

    Returns each resulting contribution with its unpacked sums, or with None if it was not joined. tiles: tiles of the film.
    separates_senders: whether contributions of different workers stay separate. Raises ValueError if sums are damaged.
    """
    runs: list[list[Contribution]] = []
    for contribution in sorted(contributions, key=lambda p: (p.frame, p.tile, p.first)):
        last = runs[-1][-1] if runs else None
        follows = last and (last.frame, last.tile, last.first + last.count) == (
            contribution.frame,
            contribution.tile,
            contribution.first,
        )
        if last and follows and (last.workers.keys() == contribution.workers.keys() or not separates_senders):
            runs[-1].append(contribution)
        else:
            runs.append([contribution])
    return [_joined_run(run, tiles[run[0].tile]) for run in runs]


def _joined_run(run: list[Contribution], tile: Tile) -> tuple[Contribution, Sums | None]:
    if len(run) == 1:
        check_sums(run[0].sums, tile)
        return run[0], None
    sums = unpack_sums(run[0].sums, tile)
    for contribution in run[1:]:
        add_sums(sums, contribution.sums, tile)
    count, bad_count = sum(p.count for p in run), sum(p.bad_count for p in run)
    workers = added_shares(contribution.workers for contribution in run)
    packed = [each.sums for each in run]
    return replace(
        run[0],
        count=count,
        sums=pack_sums(sums, hits=merge_hits(packed, tile), deep_pixels=merge_deep(packed, tile)),
        bad_count=bad_count,
        workers=workers,
    ), sums
