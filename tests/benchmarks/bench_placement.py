"""Measures placement: downloads of compiled scenes by machines that lack them, and how long slots wait for them.

    python3 farm.py bench placement [--scenes 3] [--machines 3] [--triangles 1000000] [--spp 64] [--size 960x544]

Machines are real workers with caches of their own, on a real service and Redis. Jobs of all scenes are submitted at the same
time, first with empty caches and then with full ones. Machines of one host share its processors, so processor time is reported
besides wall time. No line lies between the service and these machines: divide the bytes by the line's rate.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from renderer.child_processes import spawn_guard
from tests.benchmarks.bench_frames import relief
from tests.benchmarks.scale.measured import Served
from tests.helpers import ROOT, wait_until

LINES = {"1 Gbit/s": 125e6, "10 Gbit/s": 1.25e9}  # bytes per second


@dataclass
class Round:
    """Measurements of one round, in which a job of each scene is rendered.

    wall_s: from the first request until all jobs are finished. machines_s, service_s: processor seconds of all machines together,
    and of the service. opened: openings of compiled scenes, as placement/machine.py records them.
    """

    wall_s: float
    machines_s: float
    service_s: float
    opened: list[dict[str, Any]]

    @property
    def downloads(self) -> list[dict[str, Any]]:
        """The openings for which the machine had to download the scene."""
        return [each for each in self.opened if not each["was_here"]]


def main() -> None:
    """Prints the costs of both rounds, and their difference."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scenes", type=int, default=3)
    parser.add_argument("--machines", type=int, default=3)
    parser.add_argument("--slots", type=int, default=1, help="of each machine")
    parser.add_argument("--triangles", type=int, default=1_000_000, help="of each scene")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--size", default="960x544")
    options = parser.parse_args()
    width, height = map(int, options.size.split("x"))
    with tempfile.TemporaryDirectory(prefix="rayfarm-bench-") as name:
        folder = Path(name)
        with Served(folder) as served, machines_of(served, folder, options.machines, options.slots) as machines:
            begun = time.perf_counter()
            scenes = [ready_scene(served, scene_file(options.triangles, seed)) for seed in range(options.scenes)]
            print(f"{options.scenes} scenes uploaded and compiled in {time.perf_counter() - begun:.1f} s", flush=True)
            empty_caches(folder)
            request = {"width": width, "height": height, "spp": options.spp}
            rounds = [measure(served, machines, scenes, folder, {**request, "seed": seed}) for seed in (1, 2)]
            cached = sum(path.stat().st_size for path in (folder / "machine-0" / "blobs").glob("??/*")) / max(options.scenes, 1)
        report(rounds, cached, options.machines)


def report(rounds: list[Round], scene_bytes: float, machines: int) -> None:
    """Prints what was measured. scene_bytes: size of a compiled scene in a machine's cache."""
    lines = ", ".join(f"{scene_bytes / rate:.2f} s at {line}" for line, rate in LINES.items())
    print(f"compiled scene: {scene_bytes / 1e6:.0f} MB; {lines}")
    for title, each in zip(("empty caches", "full caches"), rounds, strict=True):
        waited, own = (sum(one[name] for one in each.opened) for name in ("wall_s", "processor_s"))
        print(
            f"{title}: {each.wall_s:.1f} s; processor {each.machines_s:.1f} s of machines, {each.service_s:.1f} s of the service"
        )
        print(f"    {len(each.downloads)} downloads; slots waited {waited:.2f} s for scenes, {own:.2f} s of a processor")
    empty, full = rounds
    many = max(len(empty.downloads), 1)
    wall_s, own_s = (sum(each[name] for each in empty.downloads) for name in ("wall_s", "processor_s"))
    service_s = empty.service_s - full.service_s
    cost = f"{own_s / many:.2f} s of the machine, {service_s / many:.2f} s of the service"
    print(f"a download: {wall_s / many:.2f} s; processor {cost}")
    share = 100 * wall_s / (machines * empty.wall_s)
    print(f"{many / machines:.1f} downloads per machine, {share:.1f} % of the slots' time")


@contextlib.contextmanager
def machines_of(served: Served, folder: Path, count: int, slots: int) -> Iterator[list[psutil.Process]]:
    """Runs the machines during the `with` block."""
    running = []
    try:
        for number in range(count):
            own = folder / f"machine-{number}"
            own.mkdir()
            command = [sys.executable, "-m", "tests.benchmarks.placement.machine", f"--service={served.url}", f"--slots={slots}"]
            command += [f"--token={served.token}", f"--name=machine-{number}", f"--cache={own / 'blobs'}", "--opened"]
            with (own / "log").open("ab") as log:
                running.append(
                    subprocess.Popen([*command, str(own / "opened")], cwd=ROOT, stdout=log, stderr=log, preexec_fn=spawn_guard())
                )
        wait_until(lambda: ready_slots(served) == count * slots, 300, "all machines are ready")
        yield [psutil.Process(each.pid) for each in running]
    finally:
        for each in running:
            each.terminate()
        for each in running:
            try:
                each.wait(20)
            except subprocess.TimeoutExpired:
                each.kill()
                each.wait()


def ready_slots(served: Served) -> int:
    """Returns the number of slots of the ready workers."""
    found = served.http.get("/api/workers").raise_for_status().json()
    workers = found["workers"] if isinstance(found, dict) else found
    return sum(each["slots"] for each in workers if each["state"] == "ready")


def scene_file(triangles: int, seed: int) -> bytes:
    """Returns a scene of that many triangles as a PLY file; scenes of different seeds have different geometry."""
    points, _, corners = relief(triangles, float(seed))
    head = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {corners.size // 3}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.zeros(corners.size // 3, dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, corners.reshape(-1, 3)
    return head.encode() + points.astype("<f4").tobytes() + faces.tobytes()


def ready_scene(served: Served, content: bytes) -> str:
    """Uploads a scene, waits until it is compiled, and returns its id."""
    answer = served.http.post("/api/scenes", files={"files": ("scene.ply", content)}, timeout=120)
    id = str(answer.raise_for_status().json()["id"])

    def is_ready() -> bool:
        return bool(served.http.get(f"/api/scenes/{id}").raise_for_status().json()["status"] == "ready")

    wait_until(is_ready, 300, "the scene is compiled")
    return id


def empty_caches(folder: Path) -> None:
    """Deletes what the machines have cached, since those that compiled a scene keep a copy."""
    for path in folder.glob("machine-*/blobs/??/*"):
        if path.parent.parent.name == "blobs" and len(path.name) == 64:
            path.unlink()


def measure(served: Served, machines: list[psutil.Process], scenes: list[str], folder: Path, request: dict[str, Any]) -> Round:
    """Renders a job of each scene at the same time, and returns what that took."""
    for path in folder.glob("machine-*/opened"):
        path.unlink()
    before, service_before = processor_s(machines), served.processor_s()[0]
    begun = time.perf_counter()
    jobs = [served.http.post("/api/jobs", json={"scene": scene, **request}).raise_for_status().json()["id"] for scene in scenes]
    wait_until(lambda: all(is_finished(served, job) for job in jobs), 600, "all jobs are finished")
    wall_s = time.perf_counter() - begun
    opened = [json.loads(line) for path in folder.glob("machine-*/opened") for line in path.read_text().splitlines()]
    return Round(wall_s, processor_s(machines) - before, served.processor_s()[0] - service_before, opened)


def is_finished(served: Served, job: str) -> bool:
    """Returns whether a job is finished."""
    time.sleep(0.1)
    return bool(served.http.get(f"/api/jobs/{job}").raise_for_status().json()["state"] == "finished")


def processor_s(machines: list[psutil.Process]) -> float:
    """Returns the processor seconds of these processes and their children so far."""
    family = [each for machine in machines for each in (machine, *machine.children(recursive=True))]
    return sum(sum(each.cpu_times()[:2]) for each in family)


if __name__ == "__main__":
    os.chdir(ROOT)
    main()
