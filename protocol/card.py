"""Messages to workers whose slots render with graphics cards.

service --- Celery task RENDER_ON_CARD > worker    CardBatches: batches of one job, in the worker's own queue
worker ---- stream RESULTS ------------> service   a Result for each batch, of type `batch` as soon as its sums are known, or
                                                   `batch-returned` with `for_cpu` if the card cannot render it

A graphics card renders some hundred times as many samples as a CPU slot in the same time, so a message has enough batches for a
few seconds. A worker with graphics cards does not serve `render_queue`. It renders messages of another type in its own queue
with the CPU.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

from protocol.contract import RenderBatch
from renderer.settings import Tile

__all__ = ["CARD_QUEUES", "RENDER_ON_CARD", "CardBatches", "card_queue"]

RENDER_ON_CARD = "rayfarm.render_on_card"
CARD_QUEUES = "rayfarm.card."


def card_queue(worker: str) -> str:
    """Returns the Celery queue that only the worker of this name serves, whose slots render with graphics cards."""
    return f"{CARD_QUEUES}{worker}"


@dataclass(frozen=True)
class CardBatches:
    """The batches in one message to a worker; one graphics card renders them, in any order."""

    batches: tuple[RenderBatch, ...]

    def to_json(self) -> dict[str, Any]:
        """Returns the batches as JSON data for the Celery message. Fields that the batches of a frame share are included once."""
        frames = []
        for _, group in groupby(self.batches, key=lambda batch: batch.frame):
            batches = list(group)
            parts = [[batch.batch, *batch.tile, batch.first, batch.count] for batch in batches]
            frames.append({"first": batches[0].to_json(), "parts": parts})
        return {"frames": frames}

    @classmethod
    def from_json(cls, data: Any) -> CardBatches:
        """Parses the JSON data from `to_json`. Raises ValueError, TypeError, KeyError or SettingsError if it is malformed."""
        if not isinstance(data, Mapping):
            raise ValueError("batches for a card must be an object")
        found = []
        for frame in data["frames"]:
            first = RenderBatch.from_json(frame["first"])
            for batch, x, y, w, h, begin, count in frame["parts"]:
                tile = Tile(*map(int, (x, y, w, h)))
                found.append(replace(first, batch=str(batch), tile=tile, first=int(begin), count=int(count)))
        if not found:
            raise ValueError("a message for a card has batches")
        return cls(tuple(found))
