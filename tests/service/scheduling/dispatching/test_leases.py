"""Tests of leases of batches. A batch that no worker reports is lost only once its result can no longer arrive.

Until then, the service reads all results that may belong to the batch.
"""

from __future__ import annotations

import random

from service.scheduling.dispatching.leases import MAX_UNSEEN_POLLS, Lease, Leases
from service.scheduling.jobs.plan import Range


def test_batch_is_lost_only_after_results_at_last_poll_are_read() -> None:
    """Checks that a batch is lost only after all results that the stream had at the last allowed poll were read.

    A slot may fetch a batch and answer it between two polls.
    """
    lease = Lease("job", "kind", Range(0, 0, 1), 30.0)
    for look in range(1, MAX_UNSEEN_POLLS + 1):
        lease.record_poll(False, lambda look=look: (look, 0))  # type: ignore[misc]
        assert (lease.unseen, lease.answered_by) == (look, (look, 0))
    lease.record_poll(False, lambda: (99, 0))
    assert lease.answered_by == (MAX_UNSEEN_POLLS, 0), "else what comes faster than it is read would hide it for ever"
    lease.record_poll(True, lambda: (100, 0))
    assert (lease.unseen, lease.answered_by) == (0, None)


def test_incremental_slot_counts_equal_recount() -> None:
    chance = random.Random(7)
    leases, there = Leases(), list[Lease]()
    for _ in range(400):
        deed = chance.random()
        if deed < 0.5:
            batch = Range(0, 0, 1) if deed < 0.45 else None
            new = Lease(chance.choice("ab"), chance.choice("kl"), batch, 30.0, is_joint=chance.random() < 0.5)
            mates = [lease for lease in there if (lease.owner, lease.is_joint, lease.kind) == (new.owner, new.is_joint, new.kind)]
            if mates and chance.random() < 0.7:
                new.message = chance.choice(mates).message
            new.queue = new.kind
            leases.add(new)
            there.append(new)
        elif there and deed < 0.65:
            leases.mark_answered(chance.choice(there))
        elif there and deed < 0.75:
            leases.update_state(chance.choice(there), chance.random() < 0.5, chance.random() < 0.5)
        elif there:
            gone = there.pop(chance.randrange(len(there)))
            assert leases.end(gone.id) is gone
            assert leases.end(gone.id) is None
        out = [lease for lease in there if lease.takes_a_slot]
        for owner in "ab":
            assert leases.slots_by_job()[owner] == len({lease.slot_unit for lease in out if lease.owner == owner})
            assert leases.leases_of(owner) == [lease for lease in there if lease.owner == owner]
            assert leases.has_any(owner) == any(lease.owner == owner for lease in there)
        for kind in "kl":
            assert (
                leases.occupied_slots(kind)
                == leases.slots_waiting_in(kind)
                == len({lease.slot_unit for lease in out if lease.kind == kind})
            )
        assert len(leases) == len(there)


def test_long_messages_are_recalled_once() -> None:
    leases = Leases()
    long, other, ended = (Lease("job", kind, Range(0, 0, 1), 30.0, is_long=True) for kind in "klk")
    for lease in (long, other, ended, Lease("job", "k", Range(0, 1, 1), 30.0)):
        leases.add(lease)
    leases.end(ended.id)
    assert leases.long_leases("k") == [long]
    leases.forget_long("k")
    assert (leases.has_long("k"), leases.has_long("l"), len(leases)) == (False, True, 3)
    leases.end(long.id)


def test_transit_time_is_measured_from_reported_batch() -> None:
    alone, joint = (Lease("job", "kind", Range(0, 0, 1), 30.0, is_joint=is_joint) for is_joint in (False, True))
    assert alone.transit_s(0.5, 100.0) == 0.0, "it came before anybody was seen with it"
    alone.held_since = joint.held_since = 101.0
    assert (alone.transit_s(2.0, 108.0), alone.transit_s(9.0, 108.0), joint.transit_s(2.0, 108.0)) == (5.0, 0.0, 0.0)
