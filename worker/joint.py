"""What the service and a worker say to each other of a tile that a machine's slots render together.

    service --- Celery task RENDER_JOINTLY > worker    JointBatch: samples of one tile, in parts
    worker ---- Celery task HELP ----------> itself    no words: take a part that waits on this machine, or send what is ripe
    worker ---- stream RESULTS ------------> service   Result of type `batches`: sums of parts that follow each other

`batches`: job, frame, tile, first, count, worker, parts: [[batch, first, count, seconds], ...], bad, bad_count. The parts are all
of first ... first + count - 1, in order. Only for workers that say they add (WorkerReport.adds).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from worker.contract import RenderBatch

__all__ = ["HELP", "HELP_QUEUES", "RENDER_JOINTLY", "JointBatch", "Piece", "help_queue"]

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


@dataclass(frozen=True)
class JointBatch:
    """Samples of a tile for the slots of one machine, a piece each; their sums come back added up."""

    whole: RenderBatch  # all pieces' samples; its `batch` is the message's id
    pieces: tuple[Piece, ...]
    hold_s: float  # how long the sums of a piece may wait for those of the others

    def to_json(self) -> dict[str, Any]:
        """A JSON-ready dict for the Celery message."""
        return {"whole": self.whole.to_json(), "pieces": [list(piece) for piece in self.pieces], "hold_s": self.hold_s}

    @classmethod
    def from_json(cls, data: Any) -> JointBatch:
        """The batch that `to_json` wrote. Raises ValueError, TypeError, KeyError or SettingsError where it is none."""
        if not isinstance(data, Mapping):
            raise ValueError("a joint batch is an object")
        pieces = tuple(Piece(str(batch), int(first), int(count)) for batch, first, count in data["pieces"])
        if not pieces:
            raise ValueError("a joint batch has pieces")
        return cls(RenderBatch.from_json(data["whole"]), pieces, float(data["hold_s"]))

    def batch(self, number: int) -> RenderBatch:
        """A piece as a batch of its own."""
        piece = self.pieces[number]
        return replace(self.whole, batch=piece.batch, first=piece.first, count=piece.count)
