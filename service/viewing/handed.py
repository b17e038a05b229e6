"""A message that was handed out and is not finished yet."""

from __future__ import annotations

import time
import uuid
from dataclasses import dataclass, field

from service.viewing.passes import Piece
from service.viewing.watch import Watch

__all__ = ["Handed"]


@dataclass
class Handed:
    """Pieces of a view, or what lies under a pixel of it, or the frame that it shows."""

    watch: Watch
    view: int
    kind: str
    pieces: dict[int, Piece] = field(default_factory=dict)  # those that are not answered
    pick: tuple[int, int] | None = None  # not answered
    is_frame: bool = False
    id: str = field(default_factory=lambda: uuid.uuid4().hex)
    heard: float = field(default_factory=time.monotonic)  # when there was a sign of it last
    has_begun: bool = False

    def lose(self) -> None:
        """What was not answered is to be handed out again, where the view is still looked at."""
        if self.pieces and self.watch.passes is not None and self.view == self.watch.view:
            self.watch.passes.lose(list(self.pieces.values()))
        if not self.watch.is_closed:
            self.watch.pick = self.watch.pick or self.pick
