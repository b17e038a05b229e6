"""Messages about joint batches: the slots of one worker render pieces of a tile, and the worker sends the sum.

service --- Celery task RENDER_JOINTLY > worker    JointBatch: samples of one tile, in pieces
worker ---- Celery task HELP ----------> itself    empty: render a waiting piece of this worker, and send sums that are due
worker ---- stream RESULTS ------------> service   Result of type `batches`: sums of consecutive pieces

`batches` has the fields job, frame, tile, first, count, worker, bad, bad_count, and parts: [[batch, first, count, seconds],
...]. The parts cover the samples first ... first + count - 1, in order. Only workers that report `WorkerReport.adds` get joint
batches. If a site's reducer has added the results of several workers (protocol/site.py), each part ends with the name of the
worker that rendered it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from protocol.contract import RenderBatch

__all__ = ["HELP", "HELP_QUEUES", "RENDER_JOINTLY", "JointBatch", "Piece", "Run", "help_queue"]

RENDER_JOINTLY = "rayfarm.render_jointly"
HELP = "rayfarm.help"
HELP_QUEUES = "rayfarm.help."


def help_queue(worker: str) -> str:
    """Returns the Celery queue by which the slots of a worker ask each other to render pieces of a joint batch.

    Its messages contain no work, so losing one is harmless.
    """
    return f"{HELP_QUEUES}{worker}"


class Piece(NamedTuple):
    """The part of a joint batch that one slot renders: a batch id of its own, and a range of samples."""

    batch: str
    first: int
    count: int  # type: ignore[assignment]  # hides tuple.count, which is unused


class Run(NamedTuple):
    """Consecutive samples of a tile that the machines of one site render. The service sends them in several messages.

    The site's reducer adds up the sums of all samples first to first + count - 1.
    """

    site: str
    first: int
    count: int  # type: ignore[assignment]
    hold_s: float  # seconds for which sums may wait there for the rest

    @classmethod
    def of(cls, data: Any) -> Run | None:
        """Parses the run in a message. Returns None if it is malformed; results then go to the service without a reducer."""
        try:
            site, first, count, hold_s = data
            run = cls(str(site), int(first), int(count), float(hold_s))
        except (TypeError, ValueError, OverflowError):
            return None
        return None if math.isnan(run.hold_s) else run  # NaN compares false with every time


@dataclass(frozen=True)
class JointBatch:
    """Samples of a tile that the slots of one worker render, one piece per slot.

    The worker adds up the sums of the pieces before it sends them.
    """

    whole: RenderBatch  # the samples of all pieces; its `batch` is the message's id
    pieces: tuple[Piece, ...]
    hold_s: float  # seconds for which a piece's sums may wait for the others
    queue: str = ""  # its queue if not the default one; surplus pieces go back there
    run: Run | None = None  # the run that it belongs to

    def to_json(self) -> dict[str, Any]:
        """Returns the batch as JSON data for the Celery message."""
        said = {"whole": self.whole.to_json(), "pieces": [list(piece) for piece in self.pieces], "hold_s": self.hold_s}
        return said | {"queue": self.queue, "run": None if self.run is None else list(self.run)}

    @classmethod
    def from_json(cls, data: Any) -> JointBatch:
        """Parses the JSON data from `to_json`. Raises ValueError, TypeError, KeyError or SettingsError if it is malformed."""
        if not isinstance(data, Mapping):
            raise ValueError("a joint batch must be an object")
        pieces = tuple(Piece(str(batch), int(first), int(count)) for batch, first, count in data["pieces"])
        if not pieces:
            raise ValueError("a joint batch has pieces")
        queue, run = str(data.get("queue") or ""), Run.of(data.get("run"))
        return cls(RenderBatch.from_json(data["whole"]), pieces, float(data["hold_s"]), queue, run)

    def batch(self, number: int) -> RenderBatch:
        """Returns the piece with this index as a batch of its own."""
        piece = self.pieces[number]
        return replace(self.whole, batch=piece.batch, first=piece.first, count=piece.count)
