"""Which rows of a tile become one: reading many costs more than reading one, and they take more room."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence

from service.store.coverage import Coverage
from service.store.film_file import Head, head_spans
from service.store.senders import senders_of, senders_text

__all__ = ["FOLD_AT", "MOST_APART", "folded", "to_fold"]

FOLD_AT = 8  # rows of a tile, or where they are kept apart of a worker
MOST_APART = 64  # rows of a tile: with more workers than that they are folded all the same


def to_fold(rows: Sequence[Head], keeps_apart: bool, is_one_run: bool) -> list[Sequence[Head]]:
    """Those of a tile that are to become one row, each of these lists: all of them once they are one run of samples, or those of
    one worker.

    keeps_apart: what each worker has sent. is_one_run: whether the tile's samples follow each other without a gap.
    """
    if len(rows) < FOLD_AT:
        return []
    if keeps_apart and len(rows) < MOST_APART:
        of_each = ([head for head in rows if head.workers == worker] for worker in {head.workers for head in rows})
        return [own for own in of_each if len(own) >= FOLD_AT]
    return [rows] if keeps_apart or is_one_run else []


def folded(heads: Collection[Head]) -> Head:
    """The row that has what these have. Raises FilmLost."""
    frame, tile = next(iter(heads))[:2]
    runs = Coverage(span for head in heads for span in head_spans(head)).ranges
    ranges = json.dumps([[start, end - start] for start, end in runs]) if len(runs) > 1 else None
    workers = senders_text({worker for head in heads for worker in senders_of(head.workers)})
    total, bad = sum(head.count for head in heads), sum(head.bad for head in heads)
    return Head(frame, tile, runs[0][0], total, bad, workers, ranges)
