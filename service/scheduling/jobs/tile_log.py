"""What happened to each tile lately: which worker rendered which samples, how long that took, and its warnings.

Kept in memory, for the latest jobs. The engine's thread writes, any thread may read: nothing written is ever changed.
"""

from __future__ import annotations

import time
from collections import OrderedDict
from datetime import UTC, datetime

__all__ = ["TileLogs", "words_of"]

JOBS = 32
TILES = 4096  # of a job; a shot has more, and the oldest go
BATCHES = 16  # of a tile
NOTEWORTHY_S = 0.05  # of a step: opening a scene that is open takes nothing

Tile = tuple[int, int]  # frame and number


class TileLogs:
    """By job, frame and tile."""

    def __init__(self) -> None:
        self._jobs: OrderedDict[str, OrderedDict[Tile, tuple[str, ...]]] = OrderedDict()

    def note(self, job: str, frame: int, tile: int, text: str) -> None:
        """A batch of a tile came back."""
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
        """What came of a tile, a line a batch; nothing where nothing is known."""
        tiles = self._jobs.get(job)
        lines = tiles.get((frame, tile), ()) if tiles is not None else ()
        return "".join(f"{line}\n" for line in lines)

    def forget(self, job: str) -> None:
        """The job is deleted."""
        self._jobs.pop(job, None)


def words_of(worker: str, first: int, count: int, seconds: float, took: dict[str, float], lines: list[str]) -> str:
    """One line: `attic: samples 0 to 15 in 0.41 s (open scene 0.12 s); warning: ...`."""
    steps = ", ".join(f"{name} {spent:.2f} s" for name, spent in took.items() if spent >= NOTEWORTHY_S and name != "trace paths")
    warned = "".join(f"; {line}" for line in lines)
    samples = f"samples {first} to {first + count - 1}" if count > 1 else f"sample {first}"
    return f"{worker}: {samples} in {seconds:.2f} s{f' ({steps})' if steps else ''}{warned}"
