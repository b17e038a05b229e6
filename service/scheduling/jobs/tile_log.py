"""Log of the latest batches of each tile: worker, samples, duration and warnings.

Held in memory for the latest jobs. Written by the engine's thread; any thread may read it, since entries are immutable.
"""

from __future__ import annotations

import time
from collections import OrderedDict
from datetime import UTC, datetime

__all__ = ["TileLogs", "tile_log_line"]

JOBS = 32
TILES = 4096  # tiles per job; the oldest are dropped
BATCHES = 16  # batches per tile
MIN_SHOWN_S = 0.05  # minimum duration of a step to be shown

Tile = tuple[int, int]  # frame key and tile index


class TileLogs:
    """Logs of tiles, by job, frame and tile."""

    def __init__(self) -> None:
        self._jobs: OrderedDict[str, OrderedDict[Tile, tuple[str, ...]]] = OrderedDict()

    def add_line(self, job: str, frame: int, tile: int, text: str) -> None:
        """Adds the line of a returned batch to a tile's log, with the current time."""
        tiles = self._jobs.get(job)
        if tiles is None:
            tiles = self._jobs[job] = OrderedDict()
            while len(self._jobs) > JOBS:
                self._jobs.popitem(last=False)
        when = datetime.fromtimestamp(time.time(), UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        tiles[frame, tile] = (*tiles.get((frame, tile), ())[1 - BATCHES :], f"{when} {text}")
        if len(tiles) > TILES:
            tiles.popitem(last=False)

    def text(self, job: str, frame: int, tile: int) -> str:
        """Returns the log of a tile, one line per batch; empty if there is no log."""
        tiles = self._jobs.get(job)
        lines = tiles.get((frame, tile), ()) if tiles is not None else ()
        return "".join(f"{line}\n" for line in lines)

    def remove_job(self, job: str) -> None:
        """Removes the logs of a deleted job."""
        self._jobs.pop(job, None)


def tile_log_line(worker: str, first: int, count: int, seconds: float, step_seconds: dict[str, float], lines: list[str]) -> str:
    """Returns the log line of a batch: `attic: samples 0 to 15 in 0.41 s (open scene 0.12 s); warning: ...`.

    first, count: first sample and number of samples. seconds: duration of the batch. step_seconds: duration of each step; short
    steps are omitted. lines: warnings.
    """
    steps = ", ".join(
        f"{name} {spent:.2f} s" for name, spent in step_seconds.items() if spent >= MIN_SHOWN_S and name != "trace paths"
    )
    warned = "".join(f"; {line}" for line in lines)
    samples = f"samples {first} to {first + count - 1}" if count > 1 else f"sample {first}"
    return f"{worker}: {samples} in {seconds:.2f} s{f' ({steps})' if steps else ''}{warned}"
