"""Tests of the detection of lost and late batches. Batches of a merely overloaded machine are neither."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from protocol.contract import WorkerReport
from protocol.site import SiteReport
from renderer.settings import Tile
from service.scheduling.dispatching.leases import Lease, Leases
from service.scheduling.dispatching.lost_batches import STRAGGLER_S, LossVerdict, LostLeaseFinder
from service.scheduling.fleet.workers import WorkerSnapshot
from service.scheduling.incoming.results import Position
from service.scheduling.jobs.plan import Range
from tests.service.scheduling.fake_clock import FakeClock

PATIENCE_S = 30.0


class World(FakeClock):
    """A simulated farm without Redis and workers: queues, workers' reports, results and clock."""

    def __init__(self) -> None:
        super().__init__()
        self.messages: set[str] = set()
        self.reports: dict[str, WorkerReport] = {}
        self.sites: dict[str, SiteReport] = {}
        self.living: set[str] = set()  # workers that Redis reports as alive
        self.late = False
        self.read = True
        self.roster = WorkerSnapshot()
        self.leases = Leases()
        self.missing = LostLeaseFinder(self.leases, self, self, self)
        job: Any = SimpleNamespace(id="job", film=SimpleNamespace(tiles=[Tile(0, 0, 8, 8)]))
        self.jobs = {"job": job}

    def waiting_messages(self, queue: str) -> set[str]:
        return self.messages

    def silent_workers(self) -> set[str]:
        return self.living - self.reports.keys()

    def has_late_report(self) -> bool:
        return self.late

    def latest_position(self) -> Position:
        return 1, 0

    def has_read(self, position: Position) -> bool:
        return self.read

    def lease(self, expected_s: float = 0.1) -> Lease:
        lease = Lease("job", "kind", Range(0, 0, 1), PATIENCE_S, expected_s, issued=self.now, queue="q")
        self.leases.add(lease)
        return lease

    def works(self, worker: str, *leases: Lease) -> None:
        hand = [lease.message for lease in leases]
        self.reports[worker] = WorkerReport(worker, "host", 1, 2, "cpu", "kind", "ready", 0.0, in_hand=hand)

    def look(self, seconds: float = 1.0, transit_s: float = 0.0) -> dict[str, LossVerdict]:
        self.now += seconds
        self.roster = WorkerSnapshot(dict(self.reports), sites=self.sites)
        return {lease.id: fate for lease, fate in self.missing.find_lost(self.jobs, self, transit_s)}


@pytest.fixture
def world() -> World:
    return World()


def test_fetched_batch_is_not_overdue_after_long_wait(world: World) -> None:
    lease = world.lease()
    world.messages = {lease.message}
    assert not world.look(10 * PATIENCE_S)
    world.messages = set()
    assert not world.look(), "somebody has taken it, and has not said so yet"
    world.works("slow", lease)
    assert not world.look()
    assert not world.look(STRAGGLER_S - 1)
    assert world.look(2.0) == {lease.id: LossVerdict.LATE}
    lease.doubled = True
    assert not world.look(3.5 * PATIENCE_S)
    assert world.look(PATIENCE_S) == {lease.id: LossVerdict.OVERDUE}


def test_silent_but_connected_worker_keeps_batches(world: World) -> None:
    mine, others = world.lease(), world.lease()
    world.works("starved", mine)
    world.works("other", others)
    world.look()
    assert world.leases.occupied_slots("kind") == 2
    del world.reports["starved"]
    world.living = {"starved"}
    assert world.look() == {mine.id: LossVerdict.LATE}, "for slots that have nothing else to do"
    assert world.leases.occupied_slots("kind") == world.leases.slots_by_job()["job"] == 1, (
        "others are given what it would have been given"
    )
    mine.doubled = others.doubled = True
    taken = world.lease()
    for _ in range(int(PATIENCE_S)):
        assert not world.look(), "what it took before it could say so it may have too"
    world.leases.end(taken.id)
    world.works("starved", mine)
    assert not world.look()
    assert (mine.is_away, world.leases.occupied_slots("kind")) == (False, 2)
    del world.reports["starved"]
    assert not world.look()
    assert world.leases.occupied_slots("kind") == 1
    world.living = set()
    assert world.look() == {mine.id: LossVerdict.DEAD}, "its connection has ended"
    world.leases.end(mine.id)
    world.leases.end(others.id)
    assert not world.leases.occupied_slots("kind")
    assert not world.leases.slots_by_job()


def test_batches_of_dead_worker_are_lost_at_once(world: World) -> None:
    mine = world.lease()
    world.works("killed", mine)
    world.look()
    del world.reports["killed"]
    world.read = False
    assert not world.look(), "its answer may be among those that were not read"
    world.read = True
    assert world.look() == {mine.id: LossVerdict.DEAD}


def test_batch_missing_after_reconnection_is_lost(world: World) -> None:
    mine = world.lease()
    world.works("again", mine)
    world.look()
    del world.reports["again"]
    world.living = {"again"}
    world.look()
    world.works("again")
    mine.doubled = True
    assert mine.id not in world.look(0.1)
    assert world.look(0.1) == {mine.id: LossVerdict.UNSEEN}
    assert world.leases.occupied_slots("kind") == 1


@pytest.mark.parametrize("late", [False, True])
def test_unreported_batch_is_lost_unless_reports_are_late(world: World, late: bool) -> None:
    lease = world.lease()
    world.late = late
    found = [world.look() for _ in range(4)]
    assert found == ([{}] * 4 if late else [{}, {}, {lease.id: LossVerdict.UNSEEN}, {lease.id: LossVerdict.UNSEEN}])


def test_rendered_joint_batch_occupies_no_slot(world: World) -> None:
    """Checks that rendered batches whose sums wait for those of other batches do not count as occupying slots.

    Otherwise the machine would get too few new batches, and be idle meanwhile.
    """
    first, second = (
        Lease("job", "kind", Range(0, n, 1), PATIENCE_S, 10.0, issued=world.now, queue="q", is_joint=True) for n in range(2)
    )
    second.message = first.message
    for lease in (first, second):
        world.leases.add(lease)

    def work_on(*leases: Lease) -> None:
        doing = [{"message": lease.message, "batch": lease.id} for lease in leases]
        known = {"in_hand": [first.message], "current": doing}
        world.reports["m"] = WorkerReport("m", "host", 1, 2, "cpu", "kind", "ready", 0.0, **known)
        assert not world.look()

    work_on()
    assert world.leases.occupied_slots("kind") == 2, "none of them is begun"
    work_on(first)
    work_on(second)
    assert (first.is_rendered, second.is_rendered, world.leases.occupied_slots("kind")) == (True, False, 1)
    work_on(first, second)
    assert world.leases.occupied_slots("kind") == 2, "it was begun again, whatever was there of it"
    work_on()
    assert world.leases.occupied_slots("kind") == 0
    world.leases.mark_answered(first)
    assert world.leases.occupied_slots("kind") == 0


def test_batch_waiting_at_site_occupies_no_slot(world: World) -> None:
    lease = Lease("job", "kind", Range(0, 0, 1), PATIENCE_S, 10.0, issued=world.now, queue="q", is_joint=True)
    world.leases.add(lease)
    world.works("m", lease)
    assert not world.look()
    assert world.leases.occupied_slots("kind") == 1
    world.works("m")
    world.sites = {"attic": SiteReport("attic", "host", 1, "127.0.0.1", 8010, 0.0, in_hand=[lease.id])}
    assert not world.look()
    assert world.leases.occupied_slots("kind") == 0


def test_long_transit_extends_poll_limit(world: World) -> None:
    lease = world.lease()
    found = [bool(world.look(transit_s=6.0)) for _ in range(10)]
    assert found == [False] * 8 + [True] * 2
    world.leases.end(lease.id)
