"""Tests of joint batches: batches of one tile for several slots of one machine, which adds up their sums.

Each sample is in the film exactly once, even if sums are lost, duplicated, or arrive separately.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from protocol.contract import Result
from renderer.film import digest
from renderer.settings import Tile
from service.scheduling.incoming.messages import BatchDone, Unusable, parse_message
from service.scheduling.incoming.results import Entry
from tests.benchmarks.scale.slots import Slots, of_one_sample
from tests.service.conftest import TOKEN, Service
from tests.service.peer_worker import expected_sums

WIDTH, HEIGHT, TILE, SPP = 64, 48, 16, 3000
SUMS = of_one_sample(expected_sums(Tile(0, 0, TILE, TILE), 0, 4, 0))

Run = list[tuple[Any, float]]


class Machines(Slots):
    """Two simulated machines with 32 slots each, which record the number of batches in each result.

    A result is lost if `troubled` returns True for it.
    """

    def __init__(self, service: Service, adds: bool = True) -> None:
        super().__init__(service.options["redis_url"], service.url, TOKEN, 64, SUMS, 0.01, adds)
        self.runs: list[int] = []  # number of batches in each result
        self.troubled: Callable[[Any, Run], bool] = lambda machine, run: False

    def _send_sums(self, machine: Any, run: Run, of: Any = None) -> None:
        self.runs.append(len(run))
        if not self.troubled(machine, run):
            super()._send_sums(machine, run, of)


@pytest.fixture
def machines(service: Service) -> Iterator[Machines]:
    made = Machines(service)
    made.report()
    thread = threading.Thread(target=made.run, args=(200.0,))
    thread.start()
    yield made
    made.stop_running()
    thread.join(20)
    made.stop()


def finish(service: Service) -> None:
    job = service.submit(service.ready_scene(), width=WIDTH, height=HEIGHT, tile_size=TILE, spp=SPP)
    service.wait_for(job, "finished", 90)
    assert service.digest(job) == digest(np.tile(SUMS * SPP, (1, HEIGHT // TILE, WIDTH // TILE)))


@pytest.mark.long
@pytest.mark.timeout(200)
def test_joint_sums_arrive_as_one_result(service: Service, machines: Machines) -> None:
    finish(service)
    counts = service.farm.engine.snapshot.counts
    assert max(machines.runs) > 1
    assert counts["merged"] > counts["results"]
    assert counts["lost"] == counts.get("dropped", 0) == 0
    assert machines.samples == SPP * (WIDTH // TILE) * (HEIGHT // TILE), "each once"


@pytest.mark.timeout(200)
def test_lost_partial_and_duplicate_results_are_merged_once(service: Service, machines: Machines) -> None:
    seen: list[str] = []

    def trouble(machine: Any, run: Run) -> bool:
        if len(run) == 1 or len(seen) == 3:
            return False
        seen.append("lost" if not seen else "piece" if len(seen) == 1 else "twice")
        if seen[-1] == "piece":
            Slots._send_sums(machines, machine, run[:1])
        if seen[-1] == "twice":
            Slots._send_sums(machines, machine, run)
        return seen[-1] == "lost"

    machines.troubled = trouble
    finish(service)
    assert seen == ["lost", "piece", "twice"]
    counts = service.farm.engine.snapshot.counts
    assert counts["lost"] >= 2, "the batches whose sums were lost"
    assert counts["dropped"] >= 4, "sums that overlap what the film has"


JOINT: dict[str, Any] = {
    "type": "batches",
    "job": "j",
    "frame": 0,
    "tile": [0, 0, 8, 8],
    "first": 4,
    "count": 5,
    "worker": "w",
    "parts": [["a", 4, 2, 0.5], ["b", 6, 3, 0.25]],
}


def test_each_joint_batch_has_its_own_id() -> None:
    message = parse_message(Entry(b"1-0", Result(JOINT, b"sums")))
    assert isinstance(message, BatchDone)
    assert [tuple(piece) for piece in message.pieces] == [("a", 4, 2, 0.5, ""), ("b", 6, 3, 0.25, "")]


@pytest.mark.parametrize(
    "parts", [[], [["a", 4, 2, 0.5]], [["a", 4, 2, 0.5], ["b", 7, 2, 0.5]], [["a", 4, 5, -1]], [["", 4, 5, 1]], [["a", 4, 5]], 7]
)
def test_incomplete_joint_result_is_rejected(parts: Any) -> None:
    with pytest.raises(Unusable):
        parse_message(Entry(b"1-0", Result({**JOINT, "parts": parts}, b"sums")))
