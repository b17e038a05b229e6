"""The page in a browser: gestures on a 4K film, a live job, long lists, and opening the page for the first time and again.

    python3 farm.py bench page [hand] [live] [lists] [reload] [first] [--slots 2] [--seconds 60] [--jobs 10000] [--rounds 20]

Each figure is printed next to its target. Headless Chromium draws WebGL on the processor (SwiftShader), which takes hundreds of
milliseconds where a graphics card takes one or two. So gestures are measured twice: unchanged, and without the shader's work,
which leaves the page's code, the upload of tiles, layout, and the browser's own part. Processor times are user plus system time,
which hardly depends on other work of the machine; wall times do.
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import httpx
import numpy as np
import psutil
from playwright.sync_api import Browser, BrowserContext, Page, sync_playwright

from service.store.database import connect
from tests.e2e.conftest import FLAGS
from tests.helpers import ROOT, Farm, start_farm, stop_farm, wait_until
from tests.many_jobs import many_jobs

HAND_S = 6.0
MB = 1e6
WINDOW = {"width": 1440, "height": 900}

# Counts WebGL calls and socket messages. With `isDry` the shader draws nothing.
WATCH = """
window.seen = {draws: 0, uploads: 0, tiles: 0, received: 0, frames: [], isDry: false};
const gl = WebGL2RenderingContext.prototype;
const {drawArrays, texSubImage2D} = gl;
gl.drawArrays = function (...all) { seen.draws++; if (!seen.isDry) drawArrays.apply(this, all); };
gl.texSubImage2D = function (...all) { seen.uploads++; texSubImage2D.apply(this, all); };
window.WebSocket = class extends WebSocket {
  constructor(...all) {
    super(...all);
    this.addEventListener("message", ({data}) => {
      if (typeof data !== "string") { seen.tiles++; seen.received += data.byteLength ?? data.size; }
    });
  }
};
const beat = (now) => { seen.frames.push(now); requestAnimationFrame(beat); };
requestAnimationFrame(beat);
"""


def main() -> None:
    """Measures and prints the results."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("parts", nargs="*", metavar="part", help=f"of {', '.join(PARTS)}; all unless told")
    parser.add_argument("--slots", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=60.0, help="that a job is watched")
    parser.add_argument("--jobs", type=int, default=10_000, help="in the list")
    parser.add_argument("--rounds", type=int, default=20, help="requests of each list, and a quarter as many reloads")
    options = parser.parse_args()
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f"there is no {', '.join(sorted(unknown))}; parts are {', '.join(PARTS)}")
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        parser.error("there is no Chromium on the PATH (Debian: apt install chromium)")
    with tempfile.TemporaryDirectory(prefix="rayfarm-bench-") as name, sync_playwright() as playwright:
        data = Path(name) / "farm"
        data.mkdir()
        if "lists" in (options.parts or PARTS):
            engine, sessions = connect(f"sqlite:///{data / 'rayfarm.sqlite'}")
            many_jobs(sessions, options.jobs)
            engine.dispose()
        farm = start_farm(data, options.slots)
        browser = playwright.chromium.launch(executable_path=path, args=[*FLAGS, "--enable-precise-memory-info"])
        try:
            for part in options.parts or PARTS:
                PARTS[part](farm, browser, options)
        finally:
            browser.close()
            stop_farm(farm)


def hand(farm: Farm, browser: Browser, _: argparse.Namespace) -> None:
    """Measures zooming and panning of a film of 3840x2160."""
    job = rendered(farm, width=3840, height=2160, spp=1)
    page = opened(browser, f"{farm.url}/#/jobs/{job}")
    cdp = page.context.new_cdp_session(page)
    cdp.send("Performance.enable")
    page.locator('.stage[data-film="here"]').wait_for(timeout=240_000)
    window = "{width}x{height}".format(**WINDOW)
    print(f"A finished film of 3840x2160 in a window of {window}, moved by the mouse for {HAND_S:g} s each")
    print("                          drawn/s   the browser's frames p50, p95   the page's own a frame: script, layout   uploads")
    for is_dry in (False, True):
        page.evaluate("(dry) => { seen.isDry = dry; }", is_dry)
        for scale, key in (("fitted", "f"), ("1:1", "1")):
            page.keyboard.press(key)
            for gesture in ("pan", "zoom"):
                if gesture == "pan" or key == "f":
                    print(f"  {gesture:4s} {scale:6s} {'no shader' * is_dry:9s}{repeat_gesture(page, cdp, gesture)}", flush=True)
    print("  asked                           60           16.7 ms, 16.7 ms")
    page.context.close()


def repeat_gesture(page: Page, cdp: Any, gesture: str) -> str:
    """Repeats a gesture on the page for some seconds; returns its processor time per frame, and the frame intervals, as text."""
    box = page.locator("canvas.film").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    if gesture == "pan":
        page.mouse.down()
    before = spent(cdp)
    page.evaluate("() => { Object.assign(seen, {draws: 0, uploads: 0, frames: []}); }")
    begun = time.perf_counter()
    while (passed := time.perf_counter() - begun) < HAND_S:
        if gesture == "pan":
            page.mouse.move(x + 200 * math.sin(3 * passed), y + 100 * math.cos(3 * passed))
        else:
            page.mouse.wheel(0, 25 if passed % 2 > 1 else -25)
    seen = page.evaluate("seen")
    after = spent(cdp)
    if gesture == "pan":
        page.mouse.up()
    gaps = np.diff(seen["frames"])
    drawn = max(seen["draws"], 1)
    p50, p95 = np.percentile(gaps, (50, 95))
    script, layout = (1000 * (after[name] - before[name]) / drawn for name in ("script", "layout"))
    return (
        f"{drawn / HAND_S:12.1f}          {p50:5.1f} ms, {p95:5.1f} ms"
        f"                  {script:6.2f} ms, {layout:5.2f} ms         {seen['uploads']}"
    )


def live(farm: Farm, browser: Browser, options: argparse.Namespace) -> None:
    """Measures a job of 1920x1080 in an open page while workers of low process priority render it."""
    for name, pid in farm.pids().items():
        if name not in ("service", "redis"):
            for process in (psutil.Process(pid), *psutil.Process(pid).children(recursive=True)):
                process.nice(10)
    job = submit_job(farm, width=1920, height=1080, spp=1 << 16)
    wait_until(lambda: job_json(farm, job)["samples"] > 4 * 1920 * 1080, 600, "the job renders")
    service = psutil.Process(farm.pids()["service"])
    alone = share(service, options.seconds / 2)
    page = opened(browser, f"{farm.url}/#/jobs/{job}")
    page.locator('.stage[data-film="here"]').wait_for(timeout=240_000)
    page.wait_for_timeout(5000)
    first = memory(page)
    page.evaluate("() => { Object.assign(seen, {tiles: 0, received: 0, draws: 0}); }")
    samples = job_json(farm, job)["samples"]
    watched = share(service, options.seconds)
    seen = page.evaluate("seen")
    rate = {name: seen[name] / options.seconds for name in ("tiles", "received", "draws")}
    samples = job_json(farm, job)["samples"] - samples
    last = memory(page)
    page.context.close()
    httpx.delete(f"{farm.url}/api/jobs/{job}", verify=False)
    speed = samples / options.seconds / 1e6
    print(f"A job of 1920x1080, watched for {options.seconds:g} s; its workers, niced, add {speed:.1f} million samples a second")
    print(
        f"  the page gets           {rate['tiles']:.1f} tiles/s, {rate['received'] / MB:.2f} MB/s;"
        f" it draws {rate['draws']:.1f} times a second"
    )
    print(f"  the service takes       {watched:.1%} of a core; {alone:.1%} while nobody watches   (asked: < 15 %)")
    print(f"  the tab's heap          {first['heap']:.0f} MB, at the end {last['heap']:.0f} MB   (asked: < 200 MB)")
    both = f"{last['rss']:.0f} MB with what is shared"
    print(f"  its process alone       {first['own']:.0f} MB, at the end {last['own']:.0f} MB; {both}")


def lists(farm: Farm, _: Browser, options: argparse.Namespace) -> None:
    """Measures the service's answers to requests for lists of a thousand jobs."""
    service = psutil.Process(farm.pids()["service"])
    print(f"Lists of a farm with {options.jobs} jobs, {options.rounds} requests each")
    asked = {"newest": {}, "by name": {"sort": "name"}, "found by a word": {"search": "truck"}, "shots alone": {"shot": True}}
    with httpx.Client(base_url=farm.url, verify=False, timeout=60) as http:
        for name, query in asked.items():
            parameters = {"limit": 1000, **query}
            walls, answer = [], http.get("/api/jobs", params=parameters)
            before = cpu(service)
            for _ in range(options.rounds):
                begun = time.perf_counter()
                answer = http.get("/api/jobs", params=parameters)
                walls.append(1000 * (time.perf_counter() - begun))
            took = 1000 * (cpu(service) - before) / options.rounds
            n = len(answer.raise_for_status().json())
            print(
                f"  {n} {name:16s} {took:4.0f} ms of processor   (asked: < 100 ms);"
                f" wall {min(walls):.0f} to {max(walls):.0f} ms, p50 {median(walls):.0f}; {len(answer.content) / MB:.2f} MB"
            )


def reload(farm: Farm, browser: Browser, options: argparse.Namespace) -> None:
    """Measures opening the page again with a warm cache."""
    page = opened(browser, f"{farm.url}/", is_watched=False)
    told = []
    for _ in range(max(options.rounds // 4, 3)):
        page.reload(wait_until="load")
        page.wait_for_function("() => performance.getEntriesByName('first-contentful-paint').length > 0", timeout=60_000)
        page.wait_for_timeout(1000)
        told.append(
            page.evaluate("""() => {
                const all = [...performance.getEntriesByType("resource"), ...performance.getEntriesByType("navigation")];
                return {
                    paint: performance.getEntriesByName("first-contentful-paint")[0].startTime,
                    files: all.length,
                    sent: all.filter((each) => each.transferSize > 0).length,
                    bytes: all.reduce((sum, each) => sum + each.transferSize, 0),
                };
            }""")
        )
    page.context.close()
    paints = [each["paint"] for each in told]
    print(f"The page opened again, {len(told)} times")
    print(f"  first paint             {min(paints):.0f} to {max(paints):.0f} ms, p50 {median(paints):.0f}   (asked: < 300 ms)")
    print(
        f"  of its {told[-1]['files']} files         {told[-1]['sent']} asked of the service, {told[-1]['bytes'] / 1000:.0f} kB"
    )


def first(farm: Farm, browser: Browser, options: argparse.Namespace) -> None:
    """Measures opening the page for the first time and again, over network connections of several speeds."""
    job = rendered(farm, width=320, height=200, spp=4)
    places = {
        "the front page": ("/", (".drop-zone", ".home .job-row")),
        "a picture": (f"/#/jobs/{job}", ('.stage[data-film="here"]',)),
    }
    rounds = max(options.rounds // 8, 3)
    print(f"Opened over slow lines, as Chromium imitates them: seconds, median of {rounds}")
    print("                                         drop zone, list; or picture     requests     kB")
    for line, speed in LINES.items():
        for place, (path, wanted) in places.items():
            told: dict[str, list[Visit]] = {"first": [], "again": []}
            for _ in range(rounds):
                context = browser.new_context(viewport=WINDOW)
                for visits in told.values():
                    visits.append(visit_page(context, farm.url + path, wanted, speed))
                context.close()
            for which, visits in told.items():
                times = ", ".join(f"{median(each):.2f}" for each in zip(*(visit.seconds for visit in visits), strict=True))
                requests, kb = median(visit.requests for visit in visits), median(visit.kb for visit in visits)
                print(f"  {line:20s} {place:15s} {which:6s} {times:>28s} {requests:14.0f} {kb:8.0f}", flush=True)


@dataclass
class Visit:
    """Measurements of one visit to the page.

    seconds: from navigation until each awaited element is visible. requests: number of responses with content. kb: their total
    size.
    """

    seconds: list[float]
    requests: int
    kb: float


def visit_page(context: BrowserContext, url: str, wanted: Sequence[str], line: tuple[float, float] | None) -> Visit:
    """Visits the page, waits for each of the selectors `wanted`, and returns the measurements.

    line: (bits per second, latency in ms) of the connection; None: unlimited.
    """
    page = context.new_page()
    cdp = context.new_cdp_session(page)
    cdp.send("Network.enable")
    if line is not None:
        speed, latency = line
        each = {"downloadThroughput": speed / 8, "uploadThroughput": speed / 8, "latency": latency}
        cdp.send("Network.emulateNetworkConditions", {"offline": False, **each})
    asked: list[float] = []
    cdp.on("Network.loadingFinished", lambda event: asked.append(event["encodedDataLength"]))
    page.goto(url, wait_until="commit")
    seconds = []
    for selector in wanted:
        page.locator(selector).first.wait_for(timeout=120_000)
        seconds.append(page.evaluate("performance.now()") / 1000)
    visit = Visit(seconds, sum(size > 0 for size in asked), sum(asked) / 1000)
    page.close()
    return visit


# (bits per second, latency in ms); the slowest is a mobile connection in the country
LINES = {"this machine": None, "10 Mbit/s, 40 ms": (10e6, 40.0), "400 kbit/s, 400 ms": (400e3, 400.0)}

PARTS: dict[str, Callable[[Farm, Browser, argparse.Namespace], None]] = {
    "hand": hand,
    "live": live,
    "lists": lists,
    "reload": reload,
    "first": first,
}


def opened(browser: Browser, url: str, is_watched: bool = True) -> Page:
    """Opens the page in a new browser profile. is_watched: whether a script counts the page's draws, uploads and frames."""
    page = browser.new_context(viewport=WINDOW).new_page()
    if is_watched:
        page.add_init_script(WATCH)
    page.goto(url)
    return page


def submit_job(farm: Farm, **request: Any) -> str:
    """Submits a job of the example scene `spheres` and returns its id."""
    with farm.client() as client:
        scene = httpx.post(f"{farm.url}/api/examples/spheres", verify=False).raise_for_status().json()["id"]
        client.wait_for_scene(scene)
        return str(client.submit(scene, name="bench", **request).id)


def rendered(farm: Farm, **request: Any) -> str:
    """Renders a job, and returns its id once it is finished."""
    job = submit_job(farm, **request)
    wait_until(lambda: job_json(farm, job)["state"] == "finished", 600, "the job is finished")
    return job


def job_json(farm: Farm, job: str) -> dict[str, Any]:
    """Returns the job's JSON from the API."""
    found: dict[str, Any] = httpx.get(f"{farm.url}/api/jobs/{job}", verify=False, timeout=60).raise_for_status().json()
    return found


def spent(cdp: Any) -> dict[str, float]:
    """Returns the seconds that the main thread of the page has spent since its start, by "script" and "layout" (with styles)."""
    told = {each["name"]: each["value"] for each in cdp.send("Performance.getMetrics")["metrics"]}
    return {"script": told["ScriptDuration"], "layout": told["LayoutDuration"] + told["RecalcStyleDuration"]}


def cpu(process: psutil.Process) -> float:
    """Returns the processor seconds of a process."""
    times = process.cpu_times()
    return float(times.user + times.system)


def share(process: psutil.Process, seconds: float) -> float:
    """Observes a process for `seconds`, and returns its processor time divided by the wall time (1: one core in full use)."""
    begun, before = time.perf_counter(), cpu(process)
    time.sleep(seconds)
    return (cpu(process) - before) / (time.perf_counter() - begun)


def memory(page: Page) -> dict[str, float]:
    """Returns memory in MB of the tab's JavaScript heap and of the largest renderer process."""
    cdp = page.context.new_cdp_session(page)
    cdp.send("HeapProfiler.collectGarbage")
    heap = page.evaluate("performance.memory.usedJSHeapSize")
    tabs = [each for each in psutil.Process().children(recursive=True) if "--type=renderer" in " ".join(each.cmdline())]
    largest = max((each.memory_full_info() for each in tabs), key=lambda each: each.rss)
    return {"heap": heap / MB, "own": largest.uss / MB, "rss": largest.rss / MB}


if __name__ == "__main__":
    os.chdir(ROOT)
    main()
