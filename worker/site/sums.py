"""Unsent sums of a site's reducer. They are stored in a folder, so that after a crash the next reducer sends them.

SINCE-NUMBER/FIRST      a result, as result_bytes.py packs it; all of a folder belong to one run (protocol.joint.Run)
sending-SINCE-NUMBER/   results that are being sent: left unchanged, so that a second delivery equals the first
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import shutil
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from protocol.contract import Result
from protocol.joint import Run
from protocol.result_bytes import result_bytes, result_of
from protocol.sums import check_sums, check_weight
from renderer.settings import Tile
from worker.site.merging import batches_of_event, merged_results

__all__ = ["SiteSums", "SumsFullError"]

SENDING_PREFIX = "sending-"
STALE_S = 300.0  # what an earlier life left has long been handed out again
MAX_HOLD_S = 60.0
MAX_PARTS = 2048  # of a run
MAX_KNOWN_RUNS = 4096  # of which some was sent and some has not come

_Key = tuple[Any, ...]

log = logging.getLogger(__name__)


class SumsFullError(Exception):
    """Raised for sums that do not fit into the store until others are sent."""


@dataclass
class _Group:
    """The stored results of one run: consecutive samples of a tile that the site's machines render (protocol.joint.Run).

    since: time of the first result. missing: number of samples not received yet. size: bytes of the results. spans: number of
    samples of each result, by its first sample. batches: ids of the batches.
    """

    folder: Path
    run: Run
    since: float
    missing: int  # samples that the reducer has not seen yet
    size: int = 0
    spans: dict[int, int] = field(default_factory=dict)  # first -> count
    batches: list[str] = field(default_factory=list)


class SiteSums:
    """Sums that the reducer has not sent yet. Thread-safe, but only one thread may call `due_results`."""

    def __init__(self, folder: Path, most_bytes: int, clock: Callable[[], float] = time.monotonic) -> None:
        """Loads the sums that an earlier process left in the folder. Raises OSError.

        most_bytes: limit on the total size of stored sums.
        """
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        self._folder = folder
        self._most_bytes = most_bytes
        self._clock = clock
        self._lock = threading.Lock()
        self._numbers = itertools.count()
        self._groups: dict[_Key, _Group] = {}
        self._sending: dict[Path, _Group] = {}
        self._left: OrderedDict[_Key, int] = OrderedDict()  # samples that had not come when the others of their run were sent
        for left in sorted(folder.iterdir()):
            self._load_left_sums(left)

    @property
    def size(self) -> int:
        """Total size of the stored sums in bytes."""
        return sum(group.size for group in [*self._groups.values(), *self._sending.values()])

    def batches_in_hand(self) -> list[str]:
        """Returns the ids of the batches whose sums are stored."""
        with self._lock:
            return [batch for group in [*self._groups.values(), *self._sending.values()] for batch in group.batches]

    def store(self, result: Result) -> None:
        """Stores a result until its run is complete or has waited too long.

        Raises ValueError for a malformed result or one with samples already stored, SumsFullError if it does not fit, and
        OSError.
        """
        run, result = _parse_result(result)
        event = result.event
        data = result_bytes(result)
        with self._lock:
            if self.size + len(data) > self._most_bytes:
                raise SumsFullError
            key = (event["job"], event["frame"], *event["tile"], run)
            group = self._groups.get(key)
            ids = [part[0] for part in batches_of_event(event)]
            if group is not None:
                if set(ids) <= set(group.batches):
                    return  # it came twice
                if any(
                    first < event["first"] + event["count"] and event["first"] < first + n for first, n in group.spans.items()
                ):
                    raise ValueError("these samples were already received in another batch")
            else:
                group = self._begin_group(run, self._left.pop(key, run.count))
            try:
                written = group.folder / "new"
                written.write_bytes(data)
                written.rename(group.folder / f"{event['first']:012}")
            except OSError:  # on a full disk, the partial file is in the way
                with contextlib.suppress(OSError):
                    written.unlink(missing_ok=True)
                    if not group.spans:
                        group.folder.rmdir()
                if not group.spans:
                    self._left[key] = group.missing
                raise
            group.spans[event["first"]] = event["count"]
            group.missing -= event["count"]
            group.batches += ids
            group.size += len(data)
            self._groups[key] = group

    def due_results(self, at_once: bool = False) -> Iterator[list[Result]]:
        """Yields the results to send now, one list per run of samples (protocol.joint.Run), merged where possible.

        A run is due if all its samples are stored or it has waited for its `hold_s`. at_once: all runs are due. Advancing the
        iterator deletes the results that it yielded before.
        """
        with self._lock:
            for key, group in list(self._groups.items()):
                if at_once or group.missing <= 0 or self._clock() - group.since > group.run.hold_s:
                    del self._groups[key]
                    if group.missing > 0:
                        self._left[key] = group.missing
                        while len(self._left) > MAX_KNOWN_RUNS:
                            self._left.popitem(last=False)
                    folder = group.folder.with_name(SENDING_PREFIX + group.folder.name)
                    group.folder.rename(folder)
                    self._sending[folder] = replace(group, folder=folder)
        for folder in list(self._sending):
            if results := _results_in(folder):
                yield list(merged_results(results))
            shutil.rmtree(folder, ignore_errors=True)
            with self._lock:
                del self._sending[folder]

    def _begin_group(self, run: Run, missing: int) -> _Group:
        folder = self._folder / f"{time.time_ns():020}-{next(self._numbers)}"
        folder.mkdir(mode=0o700)
        return _Group(folder, run, self._clock(), missing)

    def _load_left_sums(self, left_folder: Path) -> None:
        """Loads the sums in a folder left by an earlier process, to be sent unchanged. Deletes folders that are too old."""
        name = left_folder.name.removeprefix(SENDING_PREFIX)
        try:
            is_stale = time.time() - int(name.partition("-")[0]) / 1e9 > STALE_S
        except ValueError:
            is_stale = True
        found = [] if is_stale else _results_in(left_folder)
        if not found:
            shutil.rmtree(left_folder, ignore_errors=True)
            return
        folder = left_folder.with_name(SENDING_PREFIX + name)
        left_folder.rename(folder)
        batches = [part[0] for result in found for part in batches_of_event(result.event)]
        size = sum(len(result.sums or b"") for result in found)
        self._sending[folder] = _Group(folder, Run("", 0, 0, 0.0), self._clock(), 0, size, {}, batches)


def _parse_result(result: Result) -> tuple[Run, Result]:
    """Validates a worker's result. Returns its run of samples, and the result with the worker's name added to each batch.

    Raises ValueError if the result is invalid.
    """
    try:
        event = {name: value for name, value in result.event.items() if name != "run"}
        run = Run.of(result.event["run"])
        first, count, worker = int(event["first"]), int(event["count"]), str(event["worker"])
        tile = Tile(*map(int, event["tile"]))
        parts: list[list[Any]] = [
            [str(batch), int(at), int(n), float(seconds), worker] for batch, at, n, seconds in batches_of_event(event)
        ]
        if run is None or event["type"] not in ("batch", "batches") or not 0 < len(parts) <= MAX_PARTS or not worker:
            raise ValueError("not sums of a run")
        if not (isinstance(event["job"], str) and isinstance(event["frame"], int) and isinstance(event["bad"], list)):
            raise ValueError("not sums of a job")
        if not (0 <= run.first <= first < first + count <= run.first + run.count and 0 < tile.w * tile.h <= 1 << 24):
            raise ValueError("these samples do not belong to their run")
        end = first
        for _, at, n, *_ in parts:
            if at != end or n < 1:
                raise ValueError("its batches are not contiguous")
            end += n
        if end != first + count:
            raise ValueError("its batches do not cover all of its samples")
        check_weight(result.sums or b"", tile, count)  # after the addition, the faulty sender could not be identified
        check_sums(result.sums or b"", tile)
        event |= {"type": "batches", "parts": parts, "bad_count": int(event["bad_count"])}
        event.pop("batch", None), event.pop("seconds", None)
    except (KeyError, TypeError, AttributeError, OverflowError) as error:
        raise ValueError(f"no sums: {error!r}") from None
    return run._replace(hold_s=min(run.hold_s, MAX_HOLD_S)), Result(event, result.sums)


def _results_in(folder: Path) -> list[Result]:
    """Returns the results stored in a folder; an empty list if it cannot be read, in which case they are rendered again."""
    try:
        return [found for path in sorted(folder.iterdir()) if (found := _read(path)) is not None]
    except OSError as error:
        log.warning("sums are lost, and will be rendered again: %s", error)
        return []


def _read(path: Path) -> Result | None:
    with contextlib.suppress(OSError, ValueError):
        if path.name != "new":  # incomplete, or never acknowledged
            return result_of(path.read_bytes())
    return None
