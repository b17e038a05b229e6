"""Overhead of the farm: samples per second compared with the same frame in one process, and the time to the first tile.

    python3 farm.py bench farm [--cold] [--https]

Targets: at least 0.9 of the speed without a farm; a first tile within 40 s from an empty kernel cache (--cold), within 5 s from a
warm one; with --https, 0.95 of the rate of a worker over Redis for one over HTTPS alone. Each run measures both sides, and only
their ratio is compared with a target.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil

from rayfarm.client import Client
from tests.helpers import ROOT, Farm, start_farm, stop_farm

SCENE = ROOT / "scenes" / "cornell-box.yaml"
REQUEST = {"width": 512, "height": 512, "max_depth": 8}


def main() -> None:
    """Prints speed with and without a farm, and the times to the first tile."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--slots", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--cold", action="store_true", help="also from an empty kernel cache (half a minute of compiling)")
    parser.add_argument("--https", action="store_true", help="compare workers over HTTPS and over Redis, and nothing else")
    options = parser.parse_args()
    if options.https:
        compare_transports(options.slots, options.spp, options.rounds)
        return
    with tempfile.TemporaryDirectory(prefix="rayfarm-bench-") as name:
        folder = Path(name)
        if options.cold:
            seconds, _, _ = first_tile(folder / "cold", options.slots, RAYFARM_CACHE=str(folder / "cache"))
            print(f"start to first tile, empty kernel cache   {seconds:6.2f} s   (target < 40)")
        render_without_farm(folder, options.slots, 1)  # fills the kernel cache
        seconds, after_submit, parts = first_tile(folder / "warm", options.slots)
        print(f"start to first tile, warm                 {seconds:6.2f} s   (target < 5)")
        each = ", ".join(f"{name} {spent:.2f} s" for name, spent in parts.items())
        print(f"    processor: {sum(parts.values()):.2f} s; {each}")
        print(f"submit to first tile on a running farm    {after_submit:6.2f} s   (target < 2)")
        farm = start_farm(folder / "data", options.slots)
        try:
            walls, processors, slots = [], [], []
            for _ in range(options.rounds):
                wall, processor = render_without_farm(folder, options.slots, options.spp)
                farm_wall, parts = render_on_farm(farm, options.spp)
                walls.append(wall / farm_wall)
                processors.append(processor / sum(parts.values()))
                slots.append(processor / parts["slots"])
                rate = REQUEST["width"] * REQUEST["height"] * options.spp / 1e6
                print(f"without a farm {rate / wall:.2f}, with one {rate / farm_wall:.2f} M samples/s, ratio {walls[-1]:.3f}")
                each = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in parts.items())
                print(f"    processor: without a farm {processor:.2f} s; {each}", flush=True)
            print(f"median ratio                              {statistics.median(walls):6.3f}     (target >= 0.9)")
            print(f"the same by processor time                {statistics.median(processors):6.3f}     (on a busy machine)")
            print(
                f"of the slots alone                        {statistics.median(slots):6.3f}     (what the kernels lose in a slot)"
            )
        finally:
            stop_farm(farm)


def render_without_farm(folder: Path, threads: int, spp: int) -> tuple[float, float]:
    """Returns wall and processor seconds of `rayfarm render` without a farm, excluding reading and compiling the scene."""
    command = [sys.executable, "-m", "rayfarm", "render", str(SCENE), "-o", str(folder / "alone.exr"), f"--spp={spp}"]
    command += [f"--threads={threads}", "--size=512x512", "--max-depth=8", f"--stats={folder / 'stats.json'}"]
    subprocess.run(command, cwd=ROOT, check=True, stderr=subprocess.DEVNULL)
    stats = json.loads((folder / "stats.json").read_text())
    return stats["render_s"], stats["render_cpu_s"]


def render_on_farm(farm: Farm, spp: int) -> tuple[float, dict[str, float]]:
    """Renders a job on the farm, and returns the time that it takes.

    The time is (wall seconds from the request to the finished job, processor seconds by part of the farm).
    """
    with farm.client() as client:
        scene = client.wait_for_scene(client.upload([SCENE]).id)
        before = _processor(farm)
        job = client.submit(scene.id, spp=spp, fresh=True, **REQUEST).id
        while client.job(job).state != "finished":
            time.sleep(1.0)  # a request takes the service 5 ms, so ten per second would use 1/40 of two cores
        after = _processor(farm)
        found = client.call("GET", f"/api/jobs/{job}")
        return found["finished"] - found["created"], {name: after[name] - before.get(name, 0.0) for name in after}


def _processor(farm: Farm) -> dict[str, float]:
    """Returns the farm's processor seconds so far: of all slots together, of each other part, and of the remaining processes."""
    pids = {pid: name for name, pid in farm.pids().items()}
    workers = {pid for pid, name in pids.items() if name == "worker"}
    found: dict[str, float] = {}
    for process in farm.family():
        with contextlib.suppress(psutil.Error):
            name = "slots" if process.ppid() in workers else pids.get(process.pid, "others")
            found[name] = found.get(name, 0.0) + sum(process.cpu_times()[:2])
    return found


def compare_transports(slots: int, spp: int, rounds: int) -> None:
    """Prints the rate of a worker over HTTPS beside one over Redis: of wall time, and of the processor time of all processes."""
    with tempfile.TemporaryDirectory(prefix="rayfarm-bench-") as name:
        farm = start_farm(Path(name) / "data", 0, until=b"is up at")
        found: dict[str, list[tuple[float, float]]] = {"redis": [], "https": []}
        try:
            for round in range(rounds + 1):
                for transport, taken in found.items():
                    with joined_worker(farm, transport, slots, Path(name)) as worker:
                        render_on_farm(farm, 8)  # the scene is fetched, and the kernels are loaded
                        before = _seconds_of(worker)
                        wall, parts = render_on_farm(farm, spp)
                        if round:  # the first round fills the caches
                            taken.append((wall, sum(parts.values()) + _seconds_of(worker) - before))
                            print(f"{transport}   {wall:6.2f} s, processor {taken[-1][1]:6.2f} s", flush=True)
        finally:
            stop_farm(farm)
        wall, processor = (statistics.median(a[k] / b[k] for a, b in zip(*found.values(), strict=True)) for k in (0, 1))
        print(f"rate over HTTPS beside that over Redis    {wall:6.3f}     (target >= 0.95)")
        print(f"the same by processor time                {processor:6.3f}     (on a busy machine)")


@contextlib.contextmanager
def joined_worker(farm: Farm, transport: str, slots: int, folder: Path) -> Iterator[psutil.Process]:
    """Starts a worker that joins the farm from outside by a transport, waits until it is ready, and stops it at the end."""
    command = [sys.executable, "-m", "rayfarm", "worker", "--join", farm.url, "--transport", transport, f"--slots={slots}"]
    environment = {**os.environ, "RAYFARM_TOKEN": farm.token}
    with (folder / "worker.log").open("ab") as log:
        worker = subprocess.Popen([*command, "--name", transport], cwd=ROOT, env=environment, stdout=log, stderr=log)
    try:
        with farm.client() as client:
            while not any(each["name"].startswith(transport) and each["state"] == "ready" for each in _workers(client)):
                if worker.poll() is not None:
                    raise SystemExit((folder / "worker.log").read_text()[-2000:])
                time.sleep(0.5)
        yield psutil.Process(worker.pid)
    finally:
        worker.terminate()
        worker.wait(60)


def _workers(client: Client) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = client.call("GET", "/api/workers")
    return found


def _seconds_of(worker: psutil.Process) -> float:
    """Returns the processor seconds of a worker and its processes so far."""
    seconds = 0.0
    for process in (worker, *worker.children(recursive=True)):
        with contextlib.suppress(psutil.Error):
            seconds += sum(process.cpu_times()[:2])
    return seconds


def first_tile(data: Path, slots: int, **environment: str) -> tuple[float, float, dict[str, float]]:
    """Starts a farm, and measures the time to the first samples of two jobs in sequence.

    Returns (seconds from the farm's start to the first job's samples, seconds from the second job's request to its samples,
    processor seconds by part of the farm up to the first job's samples).
    """
    begun = time.perf_counter()
    farm = start_farm(data, slots, until=b"is up at", **environment)
    try:
        with farm.client() as client:
            scene = client.upload([SCENE]).id
            from_start = _samples_of(client, client.submit(scene, spp=64, **REQUEST).id) - begun
            parts = _processor(farm)
            again = time.perf_counter()
            from_submit = _samples_of(client, client.submit(scene, spp=64, seed=1, **REQUEST).id) - again
        return from_start, from_submit, parts
    finally:
        stop_farm(farm)


def _samples_of(client: Client, job: str) -> float:
    """Waits until a job has samples, then cancels the job; returns the time at which the samples arrived (time.perf_counter)."""
    while not client.job(job).samples:
        time.sleep(0.05)  # more frequent requests would use part of the measured time
    now = time.perf_counter()
    client.change(job, state="cancelled")
    return now


if __name__ == "__main__":
    os.chdir(ROOT)
    main()
