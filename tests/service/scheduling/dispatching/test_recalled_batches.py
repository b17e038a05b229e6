"""Tests of recalled batches: only those that the service has recalled are returned at no fault of their worker."""

from __future__ import annotations

import copy
import time

import redis

from service.scheduling.dispatching.leases import Lease
from tests.service.scheduling.dispatching.test_cards import KIND, Farm


def test_only_recalled_batches_are_returned_without_fault() -> None:
    farm = Farm(slots=2, cards=0)
    scheduler, job = farm.scheduler, farm.job
    asked: list[set[str]] = []

    def fail(queue: str, messages: set[str]) -> set[str]:
        raise redis.ConnectionError

    farm.queues.withdraw, farm.queues.recall = fail, asked.append  # type: ignore[attr-defined]
    batch = job.next_batch(0.5, 2, KIND)
    assert batch is not None
    for is_recalled in (False, True):
        lease = Lease(job.id, KIND, batch, 30.0, is_long=True)
        scheduler.leases.add(lease)
        if is_recalled:
            scheduler._recall_long_messages(KIND)
            assert scheduler.leases.has_long(KIND), "Redis has failed, so the next step tries again"
            farm.queues.withdraw = lambda queue, messages: set()  # type: ignore[attr-defined]
            scheduler._recall_long_messages(KIND)
            assert (asked, scheduler.leases.has_long(KIND)) == ([{lease.message}], False)
        job.handed_back = None
        scheduler.outcomes.handle_recalled(job, lease.id, batch, "cpu", "returned")
        assert job.handed_back == (None if is_recalled else "returned"), "a worker that returns all of its work is faulty"
        assert scheduler.leases.get(lease.id) is None
        assert job.next_batch(0.5, 2, KIND) == batch, "the batch is dispatched again"


def test_only_jobs_that_may_be_dispatched_wait_for_slots() -> None:
    farm = Farm(slots=2, cards=0)
    scheduler, job = farm.scheduler, farm.job
    resting = copy.copy(job)
    resting.id, resting.rests_until = "resting", time.monotonic() + 60
    for turns in ({0: [job, resting]}, {0: [job], 1: [resting]}):
        assert not scheduler._has_job_without_slot(turns)
    resting.rests_until = 0.0
    for turns in ({0: [job, resting]}, {0: [job], 1: [resting]}):
        assert scheduler._has_job_without_slot(turns)
