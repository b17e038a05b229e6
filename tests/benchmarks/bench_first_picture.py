"""Time from opening the page, and from choosing a file in it, until each stage is visible.

    python3 farm.py bench first_picture [--cold] [--rounds 3] [--rest 3] [FILE or "Still life" ...]

Columns, in seconds: first contentful paint of the front page; then, from the moment a file is chosen (or an example
opened), the upload's last byte, the model drawn by WebGL or the example's picture, the first path-traced samples, the
whole picture (a sample in every pixel), and the denoised picture that replaces the preview or the example's picture.
--rest: seconds for which the front page is looked at, and for which the file dialog is open. Without files: a generated
GLB of 1,000 and one of a million triangles, and the example Still life. Warm: kernels are in the cache, and the farm
waits; --cold: a farm starts with an empty kernel cache before each file. Each round has a new browser profile.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright

from tests.benchmarks.peers.files import large_file
from tests.e2e.conftest import FLAGS
from tests.helpers import start_farm, stop_farm

EXAMPLE = "Still life"
STAGES = ("paint", "sent", "model", "samples", "whole", "denoised")
DEADLINE_S = 600.0
PAINT = "() => performance.getEntriesByName('first-contentful-paint')[0]?.startTime / 1000"
# The time at which the upload's last byte was sent, which only the request itself knows.
NOTE_UPLOAD = """
  const send = XMLHttpRequest.prototype.send;
  XMLHttpRequest.prototype.send = function (body) {
    if (body instanceof FormData) this.upload.addEventListener("load", () => (window.uploadSent = true));
    return send.call(this, body);
  };
"""
SEEN = """() => {
  const view = document.querySelector(".live-view");
  return {
    sent: window.uploadSent === true,
    model: [...document.querySelectorAll("canvas.mesh")].some((canvas) => canvas.dataset.drawn && !canvas.hidden)
      || Boolean(view?.style.backgroundImage),
    samples: view?.dataset.view !== undefined,
    whole: Number(view?.dataset.samples) >= 1,
    denoised: Number(view?.dataset.samples) >= 1 && view.dataset.denoised === "true" && !view.querySelector("canvas.held-back"),
  };
}"""


def main() -> None:
    """Measures and prints a table of medians."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE", help="scenes of one file, or titles of examples")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--slots", type=int, default=2)
    parser.add_argument("--rest", type=float, default=3.0, help="seconds before a file is chosen, and in its dialog; 0: at once")
    parser.add_argument("--cold", action="store_true", help="with an empty kernel cache before each file (about a minute each)")
    options = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f}; medians of {options.rounds} rounds, seconds")
    print(f"{'':24}" + "".join(f"{stage:>10}" for stage in STAGES))
    with tempfile.TemporaryDirectory(prefix="rayfarm-bench-") as name, sync_playwright() as playwright:
        folder = Path(name)
        scenes: list[Path | str] = [path if path.exists() else str(path) for path in options.files]
        if not scenes:
            sizes = {"1 k triangles": 1_000, "1 M triangles": 1_000_000}
            scenes = [*(large_file(folder / f"{label}.glb", count) for label, count in sizes.items()), EXAMPLE]
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        if options.cold:
            for number, scene in enumerate(scenes):
                room = folder / f"cold-{number}"
                with_farm(
                    browser, room, options.slots, [scene], 1, options.rest, "cold", RAYFARM_CACHE=str(folder / f"cache-{number}")
                )
        with_farm(browser, folder / "warm", options.slots, scenes, options.rounds, options.rest, "warm")
        browser.close()


def with_farm(
    browser: Browser,
    data: Path,
    slots: int,
    scenes: list[Path | str],
    rounds: int,
    rest_s: float,
    label: str,
    **environment: str,
) -> None:
    """Prints a line of medians for each scene, measured with a new farm on this data folder."""
    farm = start_farm(data, slots, **environment)
    try:
        if label == "warm":
            first_picture(browser, farm.url, scenes[0], rest_s)  # makes the slots load the kernels
        for scene in scenes:
            found = [first_picture(browser, farm.url, scene, rest_s) for _ in range(rounds)]
            title = f"{scene.stem if isinstance(scene, Path) else scene}, {label}"
            print(f"{title:24}" + "".join(f"{statistics.median(each[s] for each in found):10.2f}" for s in STAGES), flush=True)
    finally:
        stop_farm(farm)


def first_picture(browser: Browser, url: str, scene: Path | str, rest_s: float) -> dict[str, float]:
    """Opens the scene on the page and returns the seconds to each stage.

    Afterwards the scene is deleted, so that the next round uploads and prepares it again.
    """
    context = browser.new_context(viewport={"width": 1440, "height": 900})
    try:
        page = context.new_page()
        page.add_init_script(NOTE_UPLOAD)
        page.goto(url)
        page.get_by_role("button", name="Choose files").wait_for()
        page.wait_for_function(PAINT)
        found = {"paint": float(page.evaluate(PAINT))}
        page.wait_for_timeout(1000 * rest_s)
        begun = begin(page, scene, rest_s)
        while len(found) < len(STAGES):
            seen = page.evaluate(SEEN)
            now = time.monotonic() - begun
            found |= {stage: now for stage in STAGES if seen.get(stage) and stage not in found}
            if "samples" in found:
                found.setdefault("model", found["samples"])  # samples arrived before the preview mesh
                found.setdefault("sent", 0.0)  # examples are not uploaded
            if now > DEADLINE_S:
                raise TimeoutError(f"{scene}: no denoised picture after {DEADLINE_S:.0f} s; seen: {found}")
            page.wait_for_timeout(20)
        page.request.delete(f"{url}/api/scenes/{page.url.partition('/scenes/')[2].partition('?')[0]}")
        return found
    finally:
        context.close()


def begin(page: Page, scene: Path | str, rest_s: float) -> float:
    """Chooses the scene's file on the page, or opens the example scene; returns the time of this action."""
    if isinstance(scene, str):
        begun = time.monotonic()
        page.get_by_role("button", name=scene).first.click()
        return begun
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose files").click()
    page.wait_for_timeout(1000 * rest_s)
    begun = time.monotonic()
    chooser.value.set_files(scene)
    return begun


if __name__ == "__main__":
    main()
