"""Jobs from the request to the finished film, through a real Redis and the real contract."""

from __future__ import annotations

import numpy as np

from renderer import film as film_math
from renderer.settings import Tile
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_sums


def expected_digest(width: int, height: int, spp: int, seed: int = 0) -> str:
    return film_math.digest(expected_sums(Tile(0, 0, width, height), 0, spp, seed))


def test_a_job_comes_to_the_very_sums_that_its_samples_have(service: Service, worker: PeerWorker) -> None:
    job = service.submit(service.ready_scene(), seed=5)
    done = service.wait_for(job, "finished")
    assert done["progress"] == 1.0
    assert done["samples"] == 64 * 48 * 8
    assert service.digest(job) == expected_digest(64, 48, 8, seed=5)
    pixel = service.http.get(f"/api/jobs/{job}/frames/0/pixel", params={"x": 20, "y": 30}).json()
    sums = expected_sums(Tile(20, 30, 1, 1), 0, 8, 5)
    assert pixel["samples"] == 8
    np.testing.assert_array_equal(np.float32(pixel["color"]), film_math.mean(sums, 24)[0, 0])
