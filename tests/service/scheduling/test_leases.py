"""When a batch that nobody has in hand is lost: not before all that may be its answer was read."""

from __future__ import annotations

from service.scheduling.leases import UNSEEN_ALLOWED, Lease
from service.scheduling.plan import Range


def test_an_answer_may_have_come_at_the_last_of_the_looks() -> None:
    """A slot that has just taken a batch has not said so, and may have answered by the next look: only the end then counts."""
    lease = Lease("job", "kind", Range(0, 0, 1), 30.0)
    for look in range(1, UNSEEN_ALLOWED + 1):
        lease.seen(False, lambda look=look: (look, 0))  # type: ignore[misc]
        assert (lease.unseen, lease.answered_by) == (look, (look, 0))
    lease.seen(False, lambda: (99, 0))
    assert lease.answered_by == (UNSEEN_ALLOWED, 0), "else what comes faster than it is read would hide it for ever"
    lease.seen(True, lambda: (100, 0))
    assert (lease.unseen, lease.answered_by) == (0, None)
