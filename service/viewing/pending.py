"""Messages of live views that were sent to workers and are not completely answered."""

from __future__ import annotations

import time
import uuid
from dataclasses import dataclass, field

from service.viewing.passes import DraftSize, Piece
from service.viewing.session import ViewSession

__all__ = ["PendingMessage"]


@dataclass
class PendingMessage:
    """A message sent to a worker: pieces of a view, a draft, a pixel to pick, a picture to denoise, or a frame to prepare.

    view: number of the view for which it was sent. kind: the worker kind (renderer.jit.kind) that may answer it.
    """

    session: ViewSession
    view: int
    kind: str
    pieces: dict[int, Piece] = field(default_factory=dict)  # unanswered
    pick: tuple[int, int] | None = None  # unanswered
    is_frame: bool = False
    denoises: bool = False
    draft: DraftSize | None = None  # of the draft that is to answer it
    queue: str = ""  # where it was sent
    card: str = ""  # name of the worker whose graphics card is to answer it
    id: str = field(default_factory=lambda: uuid.uuid4().hex)
    last_seen: float = field(default_factory=time.monotonic)  # time of the latest report
    has_started: bool = False
    is_declined: bool = False  # whether the card loads the scene instead of rendering the pieces

    def requeue(self) -> None:
        """Gives the unanswered pieces back to the session, which sends them again if it still shows the same view.

        Also gives back a pixel whose pick is unanswered, and ends a denoising without a picture, and a view's drafts.
        """
        if self.draft is not None and self.view == self.session.view:
            self.session.stop_drafts()
        self.draft = None
        if self.denoises and self.view == self.session.view:
            self.session.end_denoising(None)
        if self.pieces and self.session.passes is not None and self.view == self.session.view:
            self.session.passes.requeue(list(self.pieces.values()))
        if not self.session.is_closed:
            self.session.pick = self.session.pick or self.pick
