"""What the service and a worker say to each other of a tile that a machine's slots render together.

    service --- Celery task RENDER_JOINTLY > worker    JointBatch: samples of one tile, in parts
    worker ---- Celery task HELP ----------> itself    no words: take a part that waits on this machine, or send what is ripe
    worker ---- stream RESULTS ------------> service   Result of type `batches`: sums of parts that follow each other

`batches`: job, frame, tile, first, count, worker, parts: [[batch, first, count, seconds], ...], bad, bad_count. The parts are all
of first ... first + count - 1, in order. Only for workers that say they add (WorkerReport.adds). Where machines of a site have
added up theirs (worker/protocol/site.py), each part ends with the name of the worker that rendered it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from worker.protocol.contract import RenderBatch

__all__ = ["HELP", "HELP_QUEUES", "RENDER_JOINTLY", "JointBatch", "Piece", "Run", "help_queue"]

RENDER_JOINTLY = "rayfarm.render_jointly"
HELP = "rayfarm.help"
HELP_QUEUES = "rayfarm.help."


def help_queue(worker: str) -> str:
    """The Celery queue in which a worker's slots ask each other for help. It holds no work: what is lost with it is nothing."""
    return f"{HELP_QUEUES}{worker}"


class Piece(NamedTuple):
    """A part of a joint batch: what it is handed out as, and its samples."""

    batch: str
    first: int
    count: int  # type: ignore[assignment]  # hides tuple.count, which nobody needs


class Run(NamedTuple):
    """Samples of a tile that the machines of one site render, in some messages; its reducer adds up their sums."""

    site: str
    first: int
    count: int  # type: ignore[assignment]
    hold_s: float  # how long what came of them may wait there for the rest

    @classmethod
    def of(cls, data: Any) -> Run | None:
        """What a message has for one; None where that makes no sense: then nobody adds up more than a machine's sums."""
        try:
            site, first, count, hold_s = data
            run = cls(str(site), int(first), int(count), float(hold_s))
        except (TypeError, ValueError, OverflowError):
            return None
        return None if math.isnan(run.hold_s) else run  # which no time is longer than


@dataclass(frozen=True)
class JointBatch:
    """Samples of a tile for the slots of one machine, a piece each; their sums come back added up."""

    whole: RenderBatch  # all pieces' samples; its `batch` is the message's id
    pieces: tuple[Piece, ...]
    hold_s: float  # how long the sums of a piece may wait for those of the others
    queue: str = ""  # in which it waited, if not in that of all batches: what a machine cannot take goes back there
    run: Run | None = None  # that it is a part of

    def to_json(self) -> dict[str, Any]:
        """A JSON-ready dict for the Celery message."""
        said = {"whole": self.whole.to_json(), "pieces": [list(piece) for piece in self.pieces], "hold_s": self.hold_s}
        return said | {"queue": self.queue, "run": None if self.run is None else list(self.run)}

    @classmethod
    def from_json(cls, data: Any) -> JointBatch:
        """The batch that `to_json` wrote. Raises ValueError, TypeError, KeyError or SettingsError where it is none."""
        if not isinstance(data, Mapping):
            raise ValueError("a joint batch is an object")
        pieces = tuple(Piece(str(batch), int(first), int(count)) for batch, first, count in data["pieces"])
        if not pieces:
            raise ValueError("a joint batch has pieces")
        queue, run = str(data.get("queue") or ""), Run.of(data.get("run"))
        return cls(RenderBatch.from_json(data["whole"]), pieces, float(data["hold_s"]), queue, run)

    def batch(self, number: int) -> RenderBatch:
        """A piece as a batch of its own."""
        piece = self.pieces[number]
        return replace(self.whole, batch=piece.batch, first=piece.first, count=piece.count)
