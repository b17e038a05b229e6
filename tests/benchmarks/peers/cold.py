"""Row `cold` of the comparison: waiting times with an empty kernel cache, on a new farm and on a worker that joins. No peer.

The first time is measured from the start of a farm to the first tile of a job, the second from the start of `rayfarm worker
--join` with an empty cache, which fetches the kernels from the farm, until the farm reports the worker as ready.
"""

from __future__ import annotations

import os
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from renderer.kernel_file import is_name
from tests.benchmarks.bench_farm import first_tile
from tests.benchmarks.peers.measure import Line
from tests.benchmarks.peers.sizes import Sizes
from tests.helpers import ROOT, Farm, start_farm, stop_farm

__all__ = ["cold_lines"]

_PATIENCE_S = 240.0
_NAME = "joins"
_FIRST, _JOINS = "empty cache to the first tile", "a worker joins a farm that has compiled"


def cold_lines(sizes: Sizes, folder: Path) -> Iterator[Line]:
    """Measures both waiting times with empty kernel caches; yields a line for each.

    The first, on a new farm, is measured in few rounds, since each compiles the kernels.
    """
    cache = folder / "cache"
    if sizes.wants(_FIRST):
        first = []
        for number in range(min(sizes.rounds, 2)):
            cache = folder / f"cache-{number}"
            first.append(first_tile(folder / f"cold-{number}", 2, RAYFARM_CACHE=str(cache))[0])
        yield _line(_FIRST, first)
    if not sizes.wants(_JOINS):
        return

    farm = start_farm(folder / "compiled", 1, RAYFARM_CACHE=str(cache))
    try:
        _wait_until_uploaded(farm, cache)
        yield _line(_JOINS, [_join(farm, folder / f"joining-{i}") for i in range(sizes.rounds)])
    finally:
        stop_farm(farm)


def _line(name: str, seconds: list[float]) -> Line:
    return Line("cold", name, statistics.median(seconds), (min(seconds), max(seconds)), "s", tuple(seconds))


def _wait_until_uploaded(farm: Farm, cache: Path) -> None:
    """Waits until the farm's first worker has compiled all kernels and has uploaded them to the farm.

    cache: the worker's cache folder.
    """

    def is_at_rest() -> bool:
        handed_in = any(is_name(path.name) for path in (farm.data / "kernels").glob("*"))
        return handed_in and any(cache.glob("kernels/*/render_pool-full.done"))

    deadline = time.monotonic() + _PATIENCE_S
    while not is_at_rest():
        if time.monotonic() > deadline:
            raise RuntimeError(f"no kernels were handed in to the farm\n{farm.logs()}")
        time.sleep(0.1)


def _join(farm: Farm, cache: Path) -> float:
    """Starts a worker with an empty kernel cache, and ends it when it is ready; returns the seconds between."""
    command = [sys.executable, "-m", "rayfarm", "worker", "--join", farm.url, "--slots", "1", "--name", _NAME]
    environment = {**os.environ, "RAYFARM_TOKEN": farm.token, "RAYFARM_CACHE": str(cache)}
    begun = time.perf_counter()
    worker = subprocess.Popen(
        command, cwd=ROOT, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        with farm.client() as client:
            while not any(w.name == _NAME and w.state == "ready" for w in client.workers()):
                if time.perf_counter() - begun > _PATIENCE_S or worker.poll() is not None:
                    raise RuntimeError(f"the worker that joins is not ready\n{farm.logs()}")
                time.sleep(0.05)
            seconds = time.perf_counter() - begun
            worker.terminate()
            worker.wait(30)
            while any(w.name == _NAME for w in client.workers()):
                if time.perf_counter() - begun > _PATIENCE_S:
                    raise RuntimeError("the worker that left stays in the farm's list")
                time.sleep(0.1)
        return seconds
    finally:
        worker.kill()
        worker.wait()
        shutil.rmtree(cache, ignore_errors=True)
