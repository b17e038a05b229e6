"""More slots than the service can take results from: it hands out less and longer work, and none twice."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import pytest

from renderer.film import digest
from renderer.settings import Tile
from service.store.film_file import FilmFile
from tests.benchmarks.scale.slots import Slots
from tests.service.conftest import TOKEN, Service
from tests.service.peer_worker import expected_sums

WIDTH, HEIGHT, TILE, SPP = 64, 48, 16, 1500
SLOTS = 200


@pytest.mark.long
@pytest.mark.timeout(300)
def test_nothing_is_rendered_twice_while_results_pile_up(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    """A slow disk, and slots whose results lie in the stream for longer than the looks after which a batch is lost."""
    add = FilmFile.add

    def slowly(*arguments: Any) -> None:
        time.sleep(1.0)
        add(*arguments)

    monkeypatch.setattr(FilmFile, "add", slowly)
    sums = expected_sums(Tile(0, 0, TILE, TILE), 0, 4, 0)
    slots = Slots(service.options["redis_url"], service.url, TOKEN, SLOTS, sums, 0.05)
    thread = threading.Thread(target=slots.run, args=(280.0,))
    thread.start()
    try:
        job = service.submit(service.ready_scene(), width=WIDTH, height=HEIGHT, tile_size=TILE, spp=SPP)
        service.wait_for(job, "finished", 240)
    finally:
        slots.stop_running()
        thread.join(20)
        slots.stop()
    tiles = (WIDTH // TILE) * (HEIGHT // TILE)
    assert service.digest(job) == digest(np.tile(sums * SPP, (1, HEIGHT // TILE, WIDTH // TILE)))
    assert service.farm.engine.snapshot.counts["lost"] == 0
    assert slots.samples == tiles * SPP, "each once"
