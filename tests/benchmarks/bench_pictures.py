"""Many clients request a large picture at once: latency of /healthz during these requests, and memory of the service.

    python3 farm.py bench pictures

A job of 3840x2160 pixels gets 300 simultaneous requests: 50 for whole pictures in every format (PNG, JPEG, EXR, HDR, RGB9E5;
planes, layers and smaller copies), the others small: jobs, pixels, thumbnails, lists. All pictures differ, so that no result is
shared. A client that receives 503 retries after its Retry-After.
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import os
import statistics
import tempfile
import time
import urllib.request
from collections import Counter
from multiprocessing.synchronize import Event
from pathlib import Path

import httpx
import psutil

from tests.helpers import ROOT, Farm, start_farm, stop_farm

SCENE = ROOT / "scenes" / "cornell-box.yaml"
MIB = 1 << 20
EVERY_S = 0.05
WHOLE = [
    "image.png?exposure={x}",
    "image.jpg?exposure={x}",
    "image.exr?width={w}",
    "image.hdr?exposure={x}",
    "image.exr?aov=normal&exposure={x}",
    "image.exr?aov=all&exposure={x}",
    "image.png?aov=depth&exposure={x}",
    "image.png?aov=error&exposure={x}",
    "image.rgb9e5?exposure={x}",
    "image.png?width={w}&exposure={x}",
    "image.exr?exposure={x}",
]
SMALL = ["", "/frames/0/pixel?x={n}&y=7", "/frames/0/pixel?x=7&y={n}"]


def main() -> None:
    """Measures and prints the results."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--size", default="3840x2160")
    parser.add_argument("--requests", type=int, default=300)
    parser.add_argument("--pictures", type=int, default=50, help="of the requests")
    parser.add_argument("--rounds", type=int, default=2, help="of the same: what a second one adds to what is kept")
    options = parser.parse_args()
    width, height = (int(part) for part in options.size.split("x"))
    with tempfile.TemporaryDirectory(prefix="rayfarm-bench-") as name:
        farm = start_farm(Path(name) / "data", 2)
        try:
            job, scene = rendered(farm, width, height)
            for i in range(options.rounds):
                print(f"round {i + 1}")
                load(farm, addresses(job, scene, width, options.requests, options.pictures, i))
        finally:
            stop_farm(farm)


def rendered(farm: Farm, width: int, height: int) -> tuple[str, str]:
    """Renders a job with pictures of width x height; returns (job id, scene id)."""
    with farm.client() as client:
        scene = client.wait_for_scene(client.upload([SCENE]).id).id
        job = client.submit(scene, width=width, height=height, spp=2, max_depth=3).id
        client.wait(job)
    return job, scene


def addresses(job: str, scene: str, width: int, requests: int, pictures: int, seed: int) -> list[str]:
    """Returns `requests` URL paths, among which `pictures` paths of whole pictures are evenly distributed."""
    whole = [
        f"/api/jobs/{job}/frames/0/" + WHOLE[i % len(WHOLE)].format(x=(seed * 1000 + i) / 4096, w=width // 2 - i - 64 * seed)
        for i in range(pictures)
    ]
    others = ["/api/jobs", "/api/scenes", f"/api/scenes/{scene}/thumbnail.png", "/api/workers", "/api/info", "/metrics"]
    small = [f"/api/jobs/{job}" + path for path in SMALL] + others
    few = [small[i % len(small)].format(n=i) for i in range(requests - pictures)]
    every = max(requests // max(pictures, 1), 1)
    for i, address in enumerate(whole):
        few.insert(i * every, address)
    return few


def load(farm: Farm, asked: list[str]) -> None:
    """Sends requests for all paths at once; prints their latencies, those of /healthz meanwhile, and the service's memory."""
    service = psutil.Process(farm.pids()["service"])
    before = resident(service)
    with multiprocessing.get_context("spawn").Pool(1) as pool, multiprocessing.Manager() as manager:
        over = manager.Event()
        watching = pool.apply_async(watch, (farm.url, service.pid, over))
        time.sleep(1)  # the watcher's process has started; its first measurements are of an idle service
        used, begun = sum(service.cpu_times()[:2]), time.perf_counter()
        answers = asyncio.run(ask(farm.url, asked))
        took, used = time.perf_counter() - begun, sum(service.cpu_times()[:2]) - used
        over.set()
        health, most = watching.get()
    print(f"  answers: {dict(Counter(status for _, status, _ in answers))}, turned away {sum(n for _, _, n in answers)} times")
    print(f"  all {len(asked)} answered after {took:.1f} s; processor time of the service {used:.1f} s")
    good = [(path, seconds) for path, (seconds, status, _) in zip(asked, answers, strict=True) if status == 200]
    small = [seconds for path, seconds in good if "/image." not in path]
    large = [seconds for path, seconds in good if "/image." in path]
    print(f"  small requests: median {statistics.median(small):.2f} s, longest {max(small):.2f} s")
    print(f"  pictures: median {statistics.median(large):.1f} s, longest {max(large):.1f} s")
    print(f"  /healthz, {len(health)} times: median {statistics.median(health) * 1000:.0f} ms, longest {max(health):.2f} s")
    print(f"  memory of the service: before {before:.0f} MiB, most {most:.0f}, at the end {resident(service):.0f}", flush=True)
    for wait, since in ((10, 10), (20, 30)):
        time.sleep(wait)
        print(f"    {since} s later {resident(service):.0f} MiB", flush=True)


async def ask(url: str, paths: list[str]) -> list[tuple[float, int, int]]:
    """Returns for every path: seconds until the complete answer, its status, and the number of earlier 503 answers."""
    limits = httpx.Limits(max_connections=None, max_keepalive_connections=0)
    async with httpx.AsyncClient(base_url=url, timeout=600, limits=limits) as http:
        return await asyncio.gather(*(_ask(http, path) for path in paths))


async def _ask(http: httpx.AsyncClient, path: str) -> tuple[float, int, int]:
    begun, away = time.perf_counter(), 0
    while True:
        try:
            async with http.stream("GET", path) as answer:
                async for _ in answer.aiter_raw(1 << 20):
                    pass
        except httpx.HTTPError as error:
            print(f"  {path}: {type(error).__name__}")
            return time.perf_counter() - begun, 0, away
        if answer.status_code != 503:
            return time.perf_counter() - begun, answer.status_code, away
        away += 1
        await asyncio.sleep(float(answer.headers["retry-after"]))


def watch(url: str, pid: int, over: Event) -> tuple[list[float], float]:
    """Returns the latencies of /healthz until `over` is set, each over a new connection, and the peak memory in MiB."""
    process, latencies, most = psutil.Process(pid), [], 0.0
    while not over.is_set():
        begun = time.perf_counter()
        with urllib.request.urlopen(f"{url}/healthz", timeout=600) as answer:
            answer.read()
        latencies.append(time.perf_counter() - begun)
        most = max(most, resident(process))
        time.sleep(EVERY_S)
    return latencies, most


def resident(process: psutil.Process) -> float:
    """Returns the process' resident memory in MiB."""
    return float(process.memory_info().rss) / MIB


if __name__ == "__main__":
    os.chdir(ROOT)
    main()
