"""Live views of a scene: latency of a new camera, and speed of convergence.

    python3 farm.py bench view [--scene spheres] [--slots 2] [--views 60] [--size 960x540] [--rest 256] [--busy]

A farm with that many slots has one viewer. First each camera is sent when the previous picture is complete: the time until its
first picture arrives. Then 30 cameras per second are sent, as while dragging: the age of the camera that each picture shows.
Finally the time to 1, 4, 16 and 64 samples per pixel, and the traffic until the view is done: pictures, bytes, and the service's
processor seconds. --busy: while a job renders, whose batches delay the views. Target: a new view within 150 ms.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil
from websockets.sync.client import ClientConnection, connect

from protocol.pictures import DRAFT, VIEW
from tests.helpers import ROOT, Farm, start_farm, stop_farm


class Viewer:
    """A viewer that acknowledges packets at once, and checks that each received picture is of a view that it requested."""

    def __init__(self, socket: ClientConnection, view: dict[str, Any], size: tuple[int, int], **more: Any) -> None:
        """more: further fields of each request."""
        self.socket, self.view, self.size, self.more = socket, view, size, more
        self.id = 0
        self.sent: dict[int, float] = {}
        self.bytes = self.pictures = 0

    def send(self, angle: float) -> int:
        """Requests a view: the scene's camera, rotated by an angle. Returns the view's id."""
        (ex, ey, ez), (tx, _, tz) = self.view["eye"], self.view["target"]
        x, z = ex - tx, ez - tz
        c, s = math.cos(angle), math.sin(angle)
        view = {**self.view, "eye": [tx + c * x - s * z, ey, tz + s * x + c * z]}
        self.id += 1
        self.sent[self.id] = time.perf_counter()
        self.socket.send(json.dumps({"id": self.id, "view": view, "width": self.size[0], "height": self.size[1], **self.more}))
        return self.id

    def picture(self, timeout: float = 240.0) -> tuple[int, tuple[int, int]] | None:
        """Returns the view id and size of the next picture; None after the timeout."""
        message = self.packet(timeout)
        if message is None:
            return None
        head = VIEW.unpack(message)
        return head.id, (head.w, head.h)

    def packet(self, timeout: float) -> bytes | None:
        """Returns the next picture or draft; None after the timeout."""
        until = time.perf_counter() + timeout
        while (left := until - time.perf_counter()) > 0:
            try:
                message = self.socket.recv(timeout=left)
            except TimeoutError:
                return None
            if isinstance(message, bytes):
                self._take(message)
                return message
            said = json.loads(message)
            assert said["type"] != "error", said
            self.state = said
        return None

    def until_samples(self, wanted: int) -> float:
        """Waits until the latest view has that many samples per pixel, and returns the time at which it had."""
        while True:
            message = self.socket.recv(timeout=240)
            if isinstance(message, bytes):
                self._take(message)
                continue
            said = json.loads(message)
            if said["type"] == "state" and said["id"] == self.id and said["samples"] >= wanted:
                return time.perf_counter()

    def until_denoised(self) -> float:
        """Waits for the first picture of the latest view after its draft, a denoised one; returns when it came."""
        while True:
            message = self.packet(240.0)
            if message is not None and message[1] == VIEW.kind and VIEW.unpack(message).id == self.id:
                return time.perf_counter()

    def _take(self, message: bytes) -> None:
        layout = DRAFT if message[1] == DRAFT.kind else VIEW
        self.socket.send(json.dumps({"ack": layout.unpack(message).seq}))
        self.bytes += len(message)
        self.pictures += 1


def main() -> None:
    """Measures and prints the results."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scene", default="spheres")
    parser.add_argument("--slots", type=int, default=2)
    parser.add_argument("--views", type=int, default=60)
    parser.add_argument("--size", default="960x540")
    parser.add_argument("--rest", type=int, default=256, help="samples a pixel at which the view is taken for done")
    parser.add_argument("--busy", action="store_true")
    options = parser.parse_args()
    size = tuple(map(int, options.size.split("x")))
    with tempfile.TemporaryDirectory(prefix="rayfarm-bench-") as name:
        farm = start_farm(Path(name) / "farm", options.slots)
        try:
            measure(farm, options.scene, (size[0], size[1]), options.views, options.busy, options.rest)
        finally:
            stop_farm(farm)


def measure(farm: Farm, name: str, size: tuple[int, int], views: int, is_busy: bool, rest: int) -> None:
    """Prints the latencies, ages and convergence times of one scene. rest: samples per pixel of a finished view."""
    with farm.client() as client:
        scene = httpx.post(f"{farm.url}/api/examples/{name}", verify=False).raise_for_status().json()["id"]
        client.wait_for_scene(scene)
        view = httpx.get(f"{farm.url}/api/scenes/{scene}", verify=False).json()["cameras"][0]["view"]
        job = client.submit(scene, width=1920, height=1080, spp=1 << 16, name="bench").id if is_busy else ""
    with connect(f"ws{farm.url[4:]}/api/scenes/{scene}/viewport", proxy=None, max_size=None) as socket:
        viewer = Viewer(socket, view, size)
        viewer.send(0.0)
        viewer.until_samples(4)  # the kernel is loaded, and the scene's speed is known
        firsts = []
        for number in range(views):
            id = viewer.send(0.05 * (number + 1))
            while (picture := viewer.picture()) is None or picture[0] != id:
                pass
            firsts.append(time.perf_counter() - viewer.sent[id])
            viewer.picture(0.15)
        print(
            f"{name} at {size[0]}x{size[1]}, first pictures of {picture[1][0]}x{picture[1][1]}{', while a job renders' * is_busy}"
        )
        print(f"  a new view shows after      {format_percentiles(firsts)}   (target < 150)")
        print(f"  while the hand moves        {format_percentiles(moving(viewer, views))}   old, of what is shown")
        service = psutil.Process(farm.pids()["service"])
        begun, viewer.bytes, viewer.pictures, taken = time.perf_counter(), 0, 0, service.cpu_times()
        viewer.send(9.0)
        times = [f"{samples}: {viewer.until_samples(samples) - begun:.2f} s" for samples in (1, 4, 16, 64)]
        print(f"  samples a pixel after       {', '.join(times)}   ({viewer.bytes / 1e6:.1f} MB)")
        rested, spent = viewer.until_samples(rest) - begun, service.cpu_times()
        seconds = spent.user + spent.system - taken.user - taken.system
        print(
            f"  {rest} samples a pixel after  {rested:.1f} s: {viewer.pictures} pictures, {viewer.bytes / 1e6:.1f} MB,"
            f" {seconds:.1f} s of the service's processor"
        )
    if job:
        httpx.delete(f"{farm.url}/api/jobs/{job}", verify=False)


def moving(viewer: Viewer, views: int) -> list[float]:
    """Sends 30 cameras per second, `views` in all; returns, for each picture on its arrival, the age in seconds of its camera."""
    ages, begun = [], time.perf_counter()
    for number in range(views):
        viewer.send(0.02 * number)
        while (left := begun + (number + 1) / 30 - time.perf_counter()) > 0:
            picture = viewer.picture(left)
            if picture is not None:
                ages.append(time.perf_counter() - viewer.sent[picture[0]])
    return ages


def format_percentiles(seconds: list[float]) -> str:
    """Returns the median and the 95th percentile of times (seconds) as text in milliseconds."""
    p50, p95 = np.percentile(np.array(seconds) * 1000, (50, 95))
    return f"p50 {p50:4.0f} ms, p95 {p95:4.0f} ms of {len(seconds)}"


if __name__ == "__main__":
    os.chdir(ROOT)
    main()
