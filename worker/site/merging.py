"""Merges results of consecutive samples. Integer sums are exact; the service's cost of a result depends little on its size."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any

from protocol.contract import Result
from protocol.sums import add_sums, merge_deep, merge_hits, pack_sums, unpack_sums
from renderer.settings import Tile

__all__ = ["batches_of_event", "merged_results"]

MAX_BAD_SAMPLES = 64
MAX_WARNINGS = 20  # that were warned of


def merged_results(results: Iterable[Result]) -> Iterator[Result]:
    """Yields the results. Successive results with consecutive samples of the same tile are merged into one."""
    run: list[Result] = []
    for result in results:
        if run and _end_key(run[-1]) != (*_tile_key(result), result.event["first"]):
            yield _merged_run(run)
            run = []
        run.append(result)
    if run:
        yield _merged_run(run)


def batches_of_event(event: dict[str, Any]) -> list[list[Any]]:
    """Returns the batches in a result's event. Each is a list: id, first sample, number of samples, seconds.

    A fifth item is the name of the worker that rendered the batch, if it is known.
    """
    if event["type"] == "batches":
        return [list(part) for part in event["parts"]]
    return [[event[key] for key in ("batch", "first", "count", "seconds")]]


def _merged_run(run: list[Result]) -> Result:
    if len(run) == 1:
        return run[0]
    first = run[0].event
    tile = Tile(*first["tile"])
    total = unpack_sums(run[0].sums or b"", tile)
    for result in run[1:]:
        add_sums(total, result.sums or b"", tile)
    events = [result.event for result in run]
    event: dict[str, Any] = {
        **{key: first[key] for key in ("job", "frame", "tile", "first", "worker", "run") if key in first},
        "type": "batches",
        "count": sum(event["count"] for event in events),
        "parts": [part for event in events for part in batches_of_event(event)],
        "bad": [bad for event in events for bad in event["bad"]][:MAX_BAD_SAMPLES],
        "bad_count": sum(event["bad_count"] for event in events),
    }
    beside = {
        "lines": [line for event in events for line in event.get("lines", ())][:MAX_WARNINGS],
        "took": dict(sum((Counter(event.get("took", {})) for event in events), Counter())),
        "traceparents": [place for event in events for place in event.get("traceparents", ())],
    }
    event |= {name: value for name, value in beside.items() if value}
    packed = [result.sums or b"" for result in run]
    return Result(event, pack_sums(total, hits=merge_hits(packed, tile), deep_pixels=merge_deep(packed, tile)))


def _tile_key(result: Result) -> tuple[Any, ...]:
    return tuple(result.event[key] for key in ("job", "frame", "tile"))


def _end_key(result: Result) -> tuple[Any, ...]:
    return *_tile_key(result), result.event["first"] + result.event["count"]
