"""Tests of rendering one frame with CPU slots and graphics cards of very different speeds: all finish at about the same time.

The scheduler is the real one; time and workers are simulated.
"""

from __future__ import annotations

import heapq
from collections import defaultdict, deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from types import SimpleNamespace
from typing import Any

from protocol.card import CardBatches, card_queue
from protocol.contract import RenderBatch, WorkerReport, render_queue
from protocol.terms import Offer
from renderer.sentences import Sentence
from renderer.settings import RenderSettings, View, tiles_of
from service.scheduling.dispatching.pacing import CARD_MESSAGE_S, BatchSizing
from service.scheduling.dispatching.scheduler import Scheduler
from service.scheduling.faults.bulkhead import Bulkheads
from service.scheduling.fleet.needs import Needs
from service.scheduling.fleet.workers import WorkerSnapshot
from service.scheduling.jobs.active_frame import FrameRow
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.plan import Range
from service.settings import Settings
from service.store.coverage import Coverage
from service.store.models import Job
from tests.grids import grid
from tests.service.scheduling.fake_clock import FakeClock

KIND = "kind"
RATE = 1e6  # samples per second of a slot of the CPU
FASTER = 200  # a card's rate over that
LAUNCH_S = 0.0005  # of a card, for each batch
FETCH_S = 0.01  # until a free slot has the next message of its queue
TRANSIT_S = 0.03  # of a result
STEP_S = 0.02  # of the engine
# Slots of the CPU, cards, samples of a pixel, size of the frame.
CASES: dict[str, tuple[int, int, int, tuple[int, int]]] = {
    "small": (8, 1, 4096, (640, 384)),
    "one of each": (1, 1, 2048, (960, 512)),
    "large": (8, 1, 1024, (1920, 1080)),
    "large, one of each": (1, 1, 1024, (1920, 1080)),
    "large, two cards": (16, 2, 1024, (1920, 1080)),
}


class MemoryFilm:
    """A substitute film that records how many samples each tile has, but no sums."""

    film_exponent = 24
    has_file = True

    def __init__(self, width: int, height: int, tile: int = 64) -> None:
        self.width, self.height = width, height
        self.tiles = tiles_of(width, height, tile)
        self.covered: defaultdict[tuple[int, int], Coverage] = defaultdict(Coverage)

    def coverage(self, frame: int, tile: int) -> Coverage:
        return self.covered[frame, tile]

    def bad_samples(self, frame: int) -> tuple[int, int]:
        return 0, 0

    def tile_planes(self, frame: int, tile: int, planes: Any) -> None:
        return None


@dataclass
class Slot:
    """A simulated slot: a processor core or a graphics card.

    queue: the queue from which it gets batches. rate: samples per second. busy: intervals in which it renders, in seconds.
    """

    worker: str
    queue: str
    rate: float
    is_card: bool = False
    busy: list[tuple[float, float]] = field(default_factory=list)

    def idle(self, begin: float, end: float) -> float:
        """Returns the fraction of the interval from `begin` to `end` in which the slot was idle."""
        used = sum(max(0.0, min(b, end) - max(a, begin)) for a, b in self.busy)
        return 1.0 - used / (end - begin)


class Queues:
    """A substitute for the dispatcher: the message queues of a simulated broker."""

    def __init__(self) -> None:
        self.messages: defaultdict[str, deque[list[RenderBatch]]] = defaultdict(deque)
        self.sizes: list[int] = []  # of messages for cards

    @contextmanager
    def send_together(self) -> Iterator[None]:
        yield

    def send_batch(self, batch: RenderBatch, queue: str) -> None:
        self.messages[queue].append([batch])

    def send_card(self, work: CardBatches, queue: str, message: str) -> None:
        assert message == work.batches[0].batch
        read = CardBatches.from_json(work.to_json())
        assert read == work
        self.sizes.append(len(read.batches))
        self.messages[queue].append(list(read.batches))


class Farm:
    """The real scheduler, with simulated workers that render the single frame of a job."""

    def __init__(self, slots: int, cards: int, spp: int = 1024, size: tuple[int, int] = (1920, 1080)) -> None:
        self.reports = {"card": self.report("card", cards, has_card_queue=True)} if cards else {}
        self.reports |= {"cpu": self.report("cpu", slots)} if slots else {}
        self.workers = SimpleNamespace(roster=WorkerSnapshot(reports=self.reports))
        self.queues = Queues()
        self.pace = BatchSizing(0.5, 10.0, 1 << 28, clock=FakeClock())
        self.scheduler = Scheduler(Settings(), self.queues, self.workers, Bulkheads(), self.pace)  # type: ignore[arg-type]
        self.job = self.take(spp, size)
        self.slots = [Slot("cpu", render_queue(KIND), RATE) for _ in range(slots)]
        self.slots += [Slot("card", card_queue("card"), FASTER * RATE, True) for _ in range(cards)]
        self.free = list(self.slots)
        self.at_work: list[tuple[Slot, list[RenderBatch]]] = []
        self.now = 0.0
        self.refuses = False  # whether cards return all batches
        self._events: list[tuple[float, int, Any]] = []
        self._order = count()

    @staticmethod
    def report(name: str, slots: int, **more: Any) -> WorkerReport:
        return WorkerReport(name, "host", 1, slots, "cpu", KIND, "ready", 0.0, several=True, **more)

    def take(self, spp: int, size: tuple[int, int]) -> ActiveJob:
        settings = RenderSettings(*size, View((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)))
        row = Job(
            id="job", request={}, settings=settings.to_json(), spp=spp, state="running", priority=0, created=0.0, active_s=0.0
        )
        film: Any = MemoryFilm(*size)
        job = ActiveJob(row, film, {KIND: "compiled"}, set(), lambda frame: settings)
        job.add_frames([FrameRow(0, 0, 0, 0, "queued", None, None, None, None, False)])
        for _ in job.prepare_in_steps():
            pass
        self.scheduler.jobs[job.id] = job
        return job

    def run(self, until: float = 1e9) -> float:
        """Simulates until the job is done or the simulated time reaches `until` seconds. Returns the time of the last event."""
        last = self.now
        self._at(self.now, self._step)
        while self._events and not self.job.is_done and self._events[0][0] <= until:
            self.now, _, action = heapq.heappop(self._events)
            action()
            last = self.now
        self._events = [event for event in self._events if event[2] != self._step]
        return last

    def _at(self, time: float, action: Any) -> None:
        heapq.heappush(self._events, (time, next(self._order), action))

    def _step(self) -> None:
        self.scheduler.dispatch_work(lambda job, kind: True)
        for slot in list(self.free):
            if self.queues.messages[slot.queue]:
                self.free.remove(slot)
                self._render(slot, self.queues.messages[slot.queue].popleft(), self.now + FETCH_S)
        self._at(self.now + STEP_S, self._step)

    def _render(self, slot: Slot, message: list[RenderBatch], begin: float) -> None:
        self.at_work.append((slot, message))
        time = begin
        for batch in message:
            if slot.is_card and self.refuses:
                self._at(time + TRANSIT_S, partial(self._refuse, batch))
                continue
            seconds = batch.tile.w * batch.tile.h * batch.count / slot.rate + LAUNCH_S * slot.is_card
            time += seconds
            self._at(time + TRANSIT_S, partial(self._arrive, batch, seconds, slot.worker))
        slot.busy.append((begin, time))
        self._at(time, partial(self._rest, slot, message))

    def _rest(self, slot: Slot, message: list[RenderBatch]) -> None:
        self.at_work.remove((slot, message))
        queue = self.queues.messages[slot.queue]
        if queue:
            self._render(slot, queue.popleft(), self.now + FETCH_S)
        else:
            self.free.append(slot)

    def _arrive(self, batch: RenderBatch, seconds: float, worker: str) -> None:
        if worker not in self.reports:
            return
        film: Any = self.job.film
        found = Range(film.tiles.index(batch.tile), batch.first, batch.count)
        if self.job.needs_batch(found) and not film.coverage(0, found.tile).overlaps(batch.first, batch.count):
            film.covered[0, found.tile].add(batch.first, batch.count)
            self.scheduler.outcomes.end_batch(self.job, batch.batch, found, seconds, worker)
            self.job.update_from_film()

    def _refuse(self, batch: RenderBatch) -> None:
        film: Any = self.job.film
        found = Range(film.tiles.index(batch.tile), batch.first, batch.count)
        reason = Sentence("card-lacks-settings", "A graphics card does not render with these settings: the processor does.")
        self.scheduler.outcomes.handle_card_return(self.job, batch.batch, found, "card", reason)

    @property
    def work(self) -> float:
        """Number of samples that the frame needs, over all pixels."""
        return self.job.target_samples


@grid("case", CASES, ordinary=list(CASES)[:2])
def test_cards_and_cpus_finish_together(case: str) -> None:
    """Checks that each CPU slot and graphics card is idle for less than 6 % of the time, and busy almost until the end.

    "Almost" means 0.2 s before the end. The first 0.5 s, in which the costs of tiles are measured, are not counted.
    """
    farm = Farm(*CASES[case])
    end = farm.run()
    assert farm.job.is_done
    for slot in farm.slots:
        assert slot.idle(0.5, end) < 0.06
        assert slot.busy[-1][1] > end - 0.2


def test_sums_arrive_during_message() -> None:
    farm = Farm(2, 1, 8192, (640, 384))
    for moment in (2.0, 3.0, 4.0):
        farm.run(until=moment)
        samples = farm.job.samples
        farm.run(until=moment + 0.4)
        assert farm.job.samples - samples > 0.25 * FASTER * RATE
    spans = [end - begin for slot in farm.slots if slot.is_card for begin, end in slot.busy]
    assert max(spans) < 1.5 * CARD_MESSAGE_S


def test_messages_are_short_while_a_view_is_open() -> None:
    farm = Farm(2, 1, 8192, (640, 384))
    farm.pace.is_pressed = lambda: True
    farm.run(until=2.0)
    spans = [end - begin for slot in farm.slots if slot.is_card for begin, end in slot.busy]
    assert len(spans) > 2
    assert max(spans) < 0.4 * CARD_MESSAGE_S


def test_card_alone_renders_frame() -> None:
    farm = Farm(0, 1, 2048, (640, 384))
    end = farm.run()
    assert farm.job.is_done
    assert end < 1.1 * farm.work / (FASTER * RATE) + 0.5
    assert not farm.job.knows_cost


def test_lost_card_loses_only_its_batches() -> None:
    farm = Farm(8, 1, 2048, (640, 384))
    farm.run(until=1.5)
    out = {lease.id for lease in farm.scheduler.leases if lease.is_of_card}
    others = {lease.id for lease in farm.scheduler.leases} - out
    assert out
    assert others
    samples = farm.job.samples
    del farm.reports["card"]
    farm.queues.messages[card_queue("card")].clear()
    for lease in [lease for lease in farm.scheduler.leases if lease.id in out]:  # as the check of lost leases finds them
        assert lease.batch is not None
        farm.scheduler.leases.end(lease.id)
        farm.job.requeue(lease.batch)
    assert others <= {lease.id for lease in farm.scheduler.leases}
    assert farm.job.samples == samples
    farm.run()
    assert farm.job.is_done
    assert all(lease.only == "" for lease in farm.scheduler.leases)


def test_batches_unsupported_by_card_go_to_cpus() -> None:
    farm = Farm(8, 1, spp=4, size=(256, 128))
    farm.refuses = True
    farm.run()
    assert farm.job.is_done
    assert farm.job.card_refusals == {"card"}
    assert len(farm.queues.sizes) <= 2
    assert "does not render with these settings" in farm.job.history.log.drain()


def test_without_cpu_slots_card_worker_uses_its_cpu() -> None:
    farm = Farm(0, 1, spp=4, size=(256, 128))
    farm.refuses = True
    card = farm.slots[0]
    farm.scheduler.dispatch_work(lambda job, kind: True)
    farm.run(until=1.0)
    assert farm.job.card_refusals == {"card"}
    card.is_card, card.rate = False, RATE
    farm.run()
    assert farm.job.is_done
    assert farm.job.knows_cost


def test_requirements_apply_to_cards() -> None:
    farm = Farm(1, 1, spp=4, size=(256, 128))
    farm.job.needs = Needs(("gpu",))
    farm.scheduler.dispatch_work(lambda job, kind: True)
    assert not farm.queues.sizes
    offers = {"card": Offer(("gpu",), 1 << 30, 1, "terms")}
    farm.workers.roster = WorkerSnapshot(reports=farm.reports, offers=offers)
    farm.scheduler.dispatch_work(lambda job, kind: True)
    assert farm.queues.sizes


def test_card_worker_uses_its_cpu_if_no_cpu_slot_meets_requirements() -> None:
    farm = Farm(1, 1, spp=4, size=(256, 128))
    farm.job.needs = Needs(("gpu",))
    farm.job.card_refusals.add("card")
    offers = {"card": Offer(("gpu",), 1 << 30, 1, "terms", queues=(farm.job.needs.queue(KIND),))}
    farm.workers.roster = WorkerSnapshot(reports=farm.reports, offers=offers)
    farm.slots[1].is_card, farm.slots[1].rate = False, RATE
    farm.run()
    assert farm.job.is_done
    assert not farm.slots[0].busy


def test_verified_job_is_rendered_by_cpus_only() -> None:
    farm = Farm(1, 1, spp=4, size=(256, 128))
    farm.job.verify = 0.5
    farm.scheduler.dispatch_work(lambda job, kind: True)
    assert not farm.queues.sizes
    assert farm.queues.messages[render_queue(KIND)]
