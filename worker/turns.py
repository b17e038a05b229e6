"""From which queue a worker takes next: views that somebody looks at come first, and the others have their turn."""

from __future__ import annotations

from kombu.utils.scheduling import round_robin_cycle

from worker.view_parts import VIEW_QUEUES

__all__ = ["STRATEGY", "ViewsFirst"]

STRATEGY = "worker.turns:ViewsFirst"  # as kombu names it


class ViewsFirst(round_robin_cycle):
    """Kombu's round robin, with the queues of views before the others whoever had the last turn."""

    def consume(self, n: int) -> list[str]:
        """The queues in the order in which they are looked into."""
        return sorted(super().consume(n), key=lambda queue: not queue.startswith(VIEW_QUEUES))
