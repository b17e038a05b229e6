"""Takes the pictures of the page that README.md and animation.md show, while a farm renders: page-dark.jpg and shot-page.jpg.

    python3 farm.py up                 in one terminal
    python3 farm.py page-pictures      in another: some minutes, as both are rendered until there is something to see

It drives Debian's Chromium, as the tests do, and asks for its pictures as a person would by the page.
"""

from __future__ import annotations

import argparse
import io
import shutil
import sys
import time
from pathlib import Path
from typing import Any

import httpx
from PIL import Image
from playwright.sync_api import Page, sync_playwright

__all__ = ["main"]

PICTURES = Path(__file__).parent / "pictures"
SIZE = {"width": 1360, "height": 850}
# SwiftShader, as there may be no graphics card; the rest of the page is drawn faster without it.
FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader", "--use-gl=angle", "--use-angle=swiftshader", "--disable-gpu-compositing"]
PATIENCE_S = 3600
SETTLE_MS = 3000


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="name", help=f"{' or '.join(TAKEN)}; both unless told")
    parser.add_argument("-o", "--output", type=Path, default=PICTURES, help="docs/pictures unless told")
    parser.add_argument("--server", default="http://127.0.0.1:8000", help="the farm's address")
    parser.add_argument("--job", help="of one picture: a job that is there, in place of a new one")
    options = parser.parse_args()
    names = options.names or list(TAKEN)
    if not set(names) <= set(TAKEN) or (options.job and len(names) > 1):
        parser.error(f"pictures are {', '.join(TAKEN)}; --job is of one of them")
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        sys.exit("There is no Chromium on the PATH. On Debian: apt install chromium")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser, args=FLAGS)
        for name in names:
            request, enough, pose = TAKEN[name]
            job = options.job or _asked(options.server, **request)
            _wait(options.server, job, enough)
            page = chromium.new_page(viewport=SIZE, color_scheme="dark", reduced_motion="reduce")
            page.goto(f"{options.server}/#/jobs/{job}")
            pose(page)
            picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
            path = options.output / f"{name}.jpg"
            picture.save(path, quality=88, optimize=True)
            page.close()
            print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB", flush=True)


def _asked(server: str, example: str, **request: Any) -> str:
    """The id of a job of an example; asked for again, it is the same one."""
    scene = httpx.post(f"{server}/api/examples/{example}", timeout=60).raise_for_status().json()["id"]
    key = {"Idempotency-Key": f"page-pictures-{scene}"}
    answer = httpx.post(f"{server}/api/jobs", json={"scene": scene, **request}, headers=key, timeout=60)
    return str(answer.raise_for_status().json()["id"])


def _wait(server: str, job: str, enough: float) -> None:
    """Until so much of it is rendered, or all that is to be."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        told = httpx.get(f"{server}/api/jobs/{job}", timeout=60).raise_for_status().json()
        if told["progress"] >= enough or told["state"] == "finished":
            return
        if told["state"] in ("failed", "cancelled"):
            sys.exit(f"The job {job} is {told['state']}: {told['error'] or ''}")
        time.sleep(1)
    sys.exit(f"The job {job} had not come far enough after {PATIENCE_S} s.")


def _still(page: Page) -> None:
    """The mouse reads a pixel."""
    stage = page.locator("canvas.film")
    stage.wait_for()
    page.wait_for_timeout(SETTLE_MS)
    stage.hover(position={"x": 400, "y": 300})
    page.wait_for_timeout(SETTLE_MS)


def _shot(page: Page) -> None:
    """It is played, and stopped where the caterpillar looks at the top before it."""
    page.get_by_role("button", name="Play", exact=True).click()
    page.locator(".loaded").filter(has_text="in memory").wait_for()
    page.wait_for_timeout(5 * SETTLE_MS)
    page.get_by_role("button", name="Stop playing").click()
    page.get_by_role("slider", name="Frame").fill("20")
    page.mouse.move(5, 5)
    page.wait_for_timeout(2 * SETTLE_MS)


TAKEN = {
    "page-dark": ({"example": "still-life", "width": 960, "height": 600, "spp": 128}, 0.25, _still),
    "shot-page": (
        {"example": "caterpillar", "width": 640, "height": 360, "spp": 16, "frames": "0-95", "order": "breadth-first"},
        0.5,
        _shot,
    ),
}

if __name__ == "__main__":
    main()
