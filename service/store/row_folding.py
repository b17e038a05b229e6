"""Selects rows of a tile to fold (add up) into one, since many rows take more space and are slower to read."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence

from service.store.coverage import Coverage
from service.store.film_file import RowHead, head_sample_ranges
from service.store.senders import added_shares, senders_of, senders_text, shares_of

__all__ = ["MAX_ROWS_APART", "MAX_ROWS_UNFOLDED", "folded_head", "rows_to_fold"]

MAX_ROWS_UNFOLDED = 8  # rows of a tile, or of one worker if rows of different workers are kept apart
MAX_ROWS_APART = 64  # rows of a tile above which rows of different workers are folded too


def rows_to_fold(rows: Sequence[RowHead], separates_senders: bool, is_contiguous: bool) -> list[Sequence[RowHead]]:
    """Returns lists of a tile's rows, each of which is to be folded into one row. Empty if the tile has few rows.

    is_contiguous: whether the tile's sample numbers are contiguous; then one list has all rows. separates_senders: whether rows
    of different workers stay separate. Then there is one list for each worker that has many rows, or one list with all rows if
    there are MAX_ROWS_APART or more.
    """
    if len(rows) < MAX_ROWS_UNFOLDED:
        return []
    if separates_senders and len(rows) < MAX_ROWS_APART:
        names = [senders_of(head.workers) for head in rows]
        of_each = ([head for head, own in zip(rows, names, strict=True) if own == each] for each in set(names))
        return [own for own in of_each if len(own) >= MAX_ROWS_UNFOLDED]
    return [rows] if separates_senders or is_contiguous else []


def folded_head(heads: Collection[RowHead]) -> RowHead:
    """Returns the head (sample range and counts) of the row into which the rows with these heads are merged.

    Raises FilmLost if their sample ranges are invalid.
    """
    frame, tile = next(iter(heads))[:2]
    runs = Coverage(span for head in heads for span in head_sample_ranges(head)).ranges
    ranges = json.dumps([[start, end - start] for start, end in runs]) if len(runs) > 1 else None
    workers = senders_text(added_shares(shares_of(head.workers, head.count) or {"": head.count} for head in heads))
    total, bad = sum(head.count for head in heads), sum(head.bad for head in heads)
    return RowHead(frame, tile, runs[0][0], total, bad, workers, ranges)
