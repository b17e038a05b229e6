"""Drafts of live views: pictures per second and processor time of all stages but a graphics card's.

    python3 farm.py bench drafts [--scene scenes/cornell-box.yaml] [--size 1920x1080] [--seconds 10] [--noisy] [--page]

The worker is that of instant_card.py, whose card takes 1 ms, beside a farm with one slot. A viewer requests 60 denoised views per
second, as a page does while the camera moves: drafts per second, their bytes and their age on arrival, and the processor time of
service, broker and worker per draft; then the time from the last request to the denoised picture. --noisy: views that are not
denoised. --page: Chromium shows the drafts, too, while the pointer drags the view.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil
from websockets.sync.client import connect

from protocol.pictures import DRAFT
from renderer.child_processes import spawn_guard
from tests.benchmarks.bench_view import Viewer
from tests.helpers import ROOT, Farm, start_farm, stop_farm, wait_until

RATE = 60  # requests per second
WARM_UP_S = 2.0
# Records when each view is requested and when its draft is shown.
WATCH = """
window.asked = new Map(); window.shown = [];
const send = WebSocket.prototype.send;
WebSocket.prototype.send = function (text) {
  const said = typeof text === "string" ? JSON.parse(text) : {};
  if (said.id) window.asked.set(String(said.id), performance.now());
  return send.call(this, text);
};
new MutationObserver(() => {
  const id = document.querySelector(".live-view")?.dataset.draft;
  if (id && id !== window.shown.at(-1)?.id) window.shown.push({ id, age: performance.now() - window.asked.get(id) });
}).observe(document, { attributes: true, subtree: true, attributeFilter: ["data-draft"] });
"""


def main() -> None:
    """Measures and prints the results."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scene", default="scenes/cornell-box.yaml")
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--noisy", action="store_true")
    parser.add_argument("--page", action="store_true")
    options = parser.parse_args()
    with contextlib.ExitStack() as ends:
        folder = Path(ends.enter_context(tempfile.TemporaryDirectory(prefix="rayfarm-bench-")))
        farm = start_farm(folder / "farm", 1)
        ends.callback(stop_farm, farm)
        worker = join(farm, options, folder / "worker.log", ends)
        with farm.client() as client:
            scene = client.wait_for_scene(client.upload([ROOT / options.scene]).id).id
        parts = {"service": [psutil.Process(farm.pids()["service"])], "worker": family(worker.pid)}
        parts["broker"] = [each for each in farm.family() if "server" in each.name()]
        measure(farm, scene, options, parts)
        if options.page:
            measure_page(farm, scene, options, parts)


def join(farm: Farm, options: argparse.Namespace, log: Path, ends: contextlib.ExitStack) -> subprocess.Popen[bytes]:
    """Starts the worker; returns when it is ready."""
    command = [
        sys.executable,
        "-m",
        "tests.benchmarks.instant_card",
        options.scene,
        options.size,
        "--service",
        farm.url,
        "--paired",
    ]
    environment = {**os.environ, "RAYFARM_TOKEN": farm.token}
    with log.open("ab") as out:
        process = subprocess.Popen(
            command, cwd=ROOT, env=environment, stdout=out, stderr=out, start_new_session=True, preexec_fn=spawn_guard()
        )
    ends.callback(process.wait)
    ends.callback(process.send_signal, signal.SIGTERM)

    def is_ready() -> bool:
        if process.poll() is not None:
            sys.exit(log.read_text()[-2000:])
        workers = httpx.get(f"{farm.url}/api/workers").json()
        return len(workers) == 2 and all(each["state"] == "ready" for each in workers)

    wait_until(is_ready, 300, "the worker has joined")
    return process


def family(pid: int) -> list[psutil.Process]:
    """Returns a process and all its descendants."""
    return [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]


class Spent:
    """Measures the processor time of the farm's parts from its creation on."""

    def __init__(self, parts: dict[str, list[psutil.Process]]) -> None:
        self._parts = parts
        self._before = self._now()
        self._begun = time.perf_counter()

    def report(self, title: str, ages: list[float]) -> None:
        """Prints the rate and age of drafts, and each part's processor time, per draft and as a share of a core."""
        now, seconds = self._now(), time.perf_counter() - self._begun
        shares = []
        for name, processes in self._parts.items():
            used = sum(now[each.pid] - self._before[each.pid] for each in processes if each.pid in now)
            shares.append(f"{name} {1e3 * used / max(len(ages), 1):.1f} ms ({used / seconds:.0%})")
        p50, p95 = np.percentile(np.array(ages or [np.nan]) * 1e3, (50, 95))
        print(f"{title}: {len(ages) / seconds:.1f} drafts a second, age p50 {p50:.0f} ms, p95 {p95:.0f} ms", flush=True)
        print(f"  processor time a draft (of a core): {', '.join(shares)}", flush=True)

    def _now(self) -> dict[int, float]:
        """Returns the processor seconds of each process, by its id."""
        found = {}
        for each in (each for processes in self._parts.values() for each in processes):
            with contextlib.suppress(psutil.NoSuchProcess):  # one that prepared the scene
                times = each.cpu_times()
                found[each.pid] = times.user + times.system
        return found


def measure(farm: Farm, scene: str, options: argparse.Namespace, parts: dict[str, list[psutil.Process]]) -> None:
    """Prints the drafts per second of a viewer that shows nothing, and the processor time of each part."""
    view = httpx.get(f"{farm.url}/api/scenes/{scene}").json()["cameras"][0]["view"]
    width, height = map(int, options.size.split("x"))
    with connect(f"ws{farm.url[4:]}/api/scenes/{scene}/viewport", proxy=None, max_size=None) as socket:
        viewer = Viewer(socket, view, (width, height), draft=0.0, denoise=not options.noisy)
        viewer.send(0.0)
        viewer.until_samples(4)
        drafts: list[tuple[float, int]] = []  # age in seconds, bytes
        run(viewer, WARM_UP_S, [])
        spent = Spent(parts)
        run(viewer, options.seconds, drafts)
        spent.report(f"{options.scene} at {width}x{height}", [age for age, _ in drafts])
        print(f"  {np.mean([size for _, size in drafts]) / 1e3:.0f} kB a draft")
        if not options.noisy:
            begun = viewer.sent[viewer.id]
            print(f"  denoised {viewer.until_denoised() - begun:.2f} s after the last request", flush=True)


def run(viewer: Viewer, seconds: float, drafts: list[tuple[float, int]]) -> None:
    """Requests RATE views per second; adds age and size of each draft that has arrived."""
    begun, number = time.perf_counter(), 0
    while time.perf_counter() < begun + seconds:
        number += 1
        viewer.send(0.002 * number)
        while (left := begun + number / RATE - time.perf_counter()) > 0:
            packet = viewer.packet(left)
            if packet is not None and packet[1] == DRAFT.kind:
                drafts.append((time.perf_counter() - viewer.sent[DRAFT.unpack(packet).id], len(packet)))


def measure_page(farm: Farm, scene: str, options: argparse.Namespace, parts: dict[str, list[psutil.Process]]) -> None:
    """Prints the drafts per second that Chromium shows while the pointer drags the view."""
    from playwright.sync_api import sync_playwright

    from tests.e2e.conftest import FLAGS

    width, height = map(int, options.size.split("x"))
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=FLAGS)
        context = browser.new_context(viewport={"width": 1800, "height": 1000}, device_scale_factor=2)
        context.add_init_script(WATCH)
        if options.noisy:
            context.add_init_script("localStorage['rayfarm-view-denoise'] = 'off'")
        page = context.new_page()
        page.set_default_timeout(120_000)  # it draws without a graphics card
        page.goto(f"{farm.url}/#/scenes/{scene}")
        page.get_by_role("radiogroup", name="Size").get_by_text("Custom").click()
        page.get_by_label("Keep the aspect").uncheck()
        page.get_by_role("spinbutton", name="Width", exact=True).fill(str(width))
        page.get_by_role("spinbutton", name="Height", exact=True).fill(str(height))
        page.wait_for_selector(".live-view[data-view]")
        box: Any = page.locator(".live-view").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        for seconds in (2 * WARM_UP_S, options.seconds):
            spent, begun, step = Spent(parts), time.perf_counter(), 0
            page.evaluate("window.shown.length = 0")
            while time.perf_counter() < begun + seconds:
                step += 1
                page.mouse.move(x + 40 * np.sin(step / 20), y + 10 * np.cos(step / 20))
                page.wait_for_timeout(10)
        ages = [each["age"] / 1e3 for each in page.evaluate("window.shown")]
        canvas = page.evaluate(
            "(({ width, height }) => `${width}x${height}`)(document.querySelector('.live-view canvas:nth-of-type(2)'))"
        )
        spent.report(f"in Chromium, {canvas}", ages)
        page.mouse.up()
        browser.close()


if __name__ == "__main__":
    os.chdir(ROOT)
    main()
