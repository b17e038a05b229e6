"""Order in which a worker reads its queues.

Live views come first, then pieces of joint batches that this worker has begun, then batches with requirements that only some
workers meet. The other queues are read in turn. After each message of a view, denoising comes first once, since the last picture
of a job would otherwise wait until all views are done; then preparation of scenes, since a view may wait for it, for instance
for a scene with other lighting. After VIEWS_A_BATCH messages of views, a batch comes first once, since a job would otherwise make
no progress while a view is turned. A batch takes about as long as five messages of views. The messages of graphics cards take up
to 2 s and always wait for views.
"""

from __future__ import annotations

from kombu.utils.scheduling import round_robin_cycle

from protocol.contract import denoise_queue, prepare_queue, render_queue
from protocol.joint import HELP_QUEUES
from protocol.terms import NEEDS
from protocol.view_parts import CARD_VIEW_QUEUES, VIEW_QUEUES

__all__ = ["STRATEGY", "ViewsFirstOrder"]

STRATEGY = "worker.process.queue_order:ViewsFirstOrder"  # as kombu names it
DENOISE_QUEUES, PREPARE_QUEUES = denoise_queue(""), prepare_queue("")
RENDER_QUEUES = render_queue("")
VIEWS = (CARD_VIEW_QUEUES, VIEW_QUEUES)
VIEWS_A_BATCH = 8


class ViewsFirstOrder(round_robin_cycle):
    """Kombu's round robin of queues, except that those of views, help messages and requirements come first most of the time."""

    _was_view = False
    _views = 0  # messages of views since the last batch

    def rotate(self, last_used: str) -> str:
        """Records that a queue was read."""
        self._was_view = last_used.startswith(VIEWS)
        if self._was_view:
            self._views += 1
        elif last_used.startswith(RENDER_QUEUES):
            self._views = 0
        super().rotate(last_used)
        return last_used

    def consume(self, n: int) -> list[str]:
        """Returns the queues in the order in which to read them."""
        others = (DENOISE_QUEUES, PREPARE_QUEUES) if self._was_view else ()
        batches = (RENDER_QUEUES,) if self._views >= VIEWS_A_BATCH else ()
        first = (*others, *batches, *VIEWS, HELP_QUEUES)
        return sorted(
            super().consume(n),
            key=lambda queue: next((i for i, name in enumerate(first) if queue.startswith(name)), 8 if NEEDS in queue else 9),
        )
