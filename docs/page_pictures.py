"""Takes the screenshots of the page for README.md and the guides, while a farm renders.

    python3 farm.py up                           in one terminal
    python3 farm.py page-pictures                in another: some minutes, since each waits until there is something to see
    python3 farm.py page-pictures first-steps    those of docs/first-steps.md alone, with a farm that is empty
    python3 farm.py page-pictures terminal       rayfarm watch, on Linux and macOS
    python3 farm.py page-pictures takes          the takes of a scene's live view
    python3 farm.py page-pictures who-rendered   with a second worker (rayfarm worker --name attic --join ...)
    python3 farm.py page-pictures tour -o out    every page at three widths, light and dark, for inspection

It drives Debian's Chromium, as the tests do, and submits its jobs through the page as a user does.
"""

from __future__ import annotations

import argparse
import html
import io
import json
import os
import re
import select
import shutil
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import httpx
from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

__all__ = ["main"]

PICTURES = Path(__file__).parent / "pictures"
SIZE = {"width": 1440, "height": 900}  # as wide as the tools of a job's page need for their labels
# SwiftShader, in case there is no GPU; the rest of the page is drawn faster without it.
FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader", "--use-gl=angle", "--use-angle=swiftshader", "--disable-gpu-compositing"]
PATIENCE_S = 3600
SETTLE_MS = 3000
WIDTHS = {375: 800, 1440: 900, 2560: 1300}
TOUR, FIRST_STEPS, TERMINAL = "tour", "first-steps", "terminal"
TAKES, LIGHT_MIXER = "takes", "light-mixer"
COLUMNS, LINES = 96, 32  # of the terminal
WATCHED_S = 8.0
ESCAPE = re.compile(r"\x1b\[([?\d;]*)([A-Za-z])|\x1b[_P].*?\x1b\\", re.DOTALL)
# As if a file were dragged over the page, whose drop area then covers it: again and again, since
# the area goes a second after the last event.
DRAG_OVER = """() => setInterval(() => {
  const dragged = new DataTransfer();
  dragged.items.add(new File(["x"], "truck.glb"));
  dispatchEvent(new DragEvent("dragover", { dataTransfer: dragged, bubbles: true, cancelable: true }));
}, 100)"""
CLEAR_SPP = 16  # of a live view's denoised picture
# The view's own picture, by the words of its tag.
IS_CLEAR = """least => {
  const words = document.querySelector(".view-state")?.textContent ?? "";
  return words.includes("denoised") && (parseFloat(words) >= least || words.includes("done"));
}"""


def main() -> None:
    """Parses the command line, and takes the pictures that it requests."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    usual = [*TAKEN, *(name for name in OTHERS if name != TOUR)]
    known = ", ".join(usual)
    parser.add_argument("names", nargs="*", metavar="name", help=f"{known}; by default all; or {TOUR}")
    parser.add_argument("-o", "--output", type=Path, default=PICTURES, help="by default docs/pictures")
    parser.add_argument("--server", default="http://127.0.0.1:8000", help="the farm's address")
    parser.add_argument("--job", help="an existing job to show instead of a new one; with one name only")
    options = parser.parse_args()
    names = options.names or usual
    if not set(names) <= {*TAKEN, *OTHERS} or (options.job and len(names) > 1):
        parser.error(f"pictures are {', '.join([*TAKEN, *OTHERS])}; --job needs one of their names")
    options.output.mkdir(parents=True, exist_ok=True)
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        sys.exit("There is no Chromium on the PATH. On Debian: apt install chromium")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser, args=FLAGS)
        for name in names:
            if name in OTHERS:
                OTHERS[name](chromium, options.server, options.output)
                continue
            request, enough, pose = TAKEN[name]
            job = options.job or _job_id(options.server, **request)
            _wait_for_samples(options.server, job, enough)
            page = _opened(chromium, viewport=SIZE, color_scheme="light", reduced_motion="reduce")
            page.goto(f"{options.server}/#/jobs/{job}")
            pose(page)
            _save_jpeg(page, options.output / f"{name}.jpg")
            page.close()


def _opened(chromium: Browser, **options: Any) -> Page:
    """Opens a page whose actions may take long, as they do beside a farm that renders on the same cores."""
    page = chromium.new_page(**options)
    page.set_default_timeout(1000 * PATIENCE_S)
    return page


def _tour(chromium: Browser, server: str, folder: Path) -> None:
    """Takes pictures of every page of the web interface, at every width, in the light and the dark theme."""
    request = {"example": "still-life", "width": 640, "height": 400, "spp": 32}
    own, other = _job_id(server, **request), _job_id(server, **request, environment={"preset": "noon"})
    for job in (own, other):
        _wait_for_samples(server, job, 1.0)
    scene = _scene(server, "still-life")
    pages = {"home": "", "scene": f"scenes/{scene}", "job": f"jobs/{own}", "jobs": "jobs", "workers": "workers"}
    pages["compare"] = f"compare/{own}/{other}"
    for width, height in WIDTHS.items():
        for theme in ("light", "dark"):
            page = _opened(chromium, viewport={"width": width, "height": height}, color_scheme=theme, reduced_motion="reduce")
            for name, place in pages.items():
                page.goto(f"{server}/#/{place}")
                page.wait_for_timeout(2 * SETTLE_MS)
                page.screenshot(path=folder / f"{name}-{width}-{theme}.png", full_page=name != "job")
            page.close()
    print(f"{len(pages) * len(WIDTHS) * 2} pictures in {folder}", flush=True)


def _first_steps(chromium: Browser, server: str, folder: Path) -> None:
    """Walks on an empty farm from its first page to a shared picture, as first-steps.md does; saves a picture of each step."""
    page = _opened(chromium, viewport=SIZE, color_scheme="light", reduced_motion="reduce")
    page.goto(server)
    page.get_by_text("Examples", exact=True).wait_for()
    page.wait_for_timeout(SETTLE_MS)
    _save(page, folder, "start")
    page.evaluate(DRAG_OVER)
    page.get_by_text("Drop to upload", exact=True).wait_for()
    page.wait_for_timeout(SETTLE_MS)
    _save(page, folder, "drop", height=590)
    page.goto(f"{server}/#/scenes/{_scene(server, 'spheres')}")
    page.reload()  # without the file that is dragged
    view = page.locator(".live-view canvas:not(.mesh)").first
    view.wait_for()
    page.wait_for_timeout(5 * SETTLE_MS)
    box = view.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y - 30, steps=4)
    page.mouse.up()
    page.mouse.move(5, 5)
    _wait_for_clear_view(page)
    _save(page, folder, "look")
    page.get_by_text("Studio", exact=True).click()
    page.mouse.move(5, 5)
    _wait_for_clear_view(page)
    _save(page, folder, "light")
    page.get_by_text("Good", exact=True).click()
    page.wait_for_timeout(SETTLE_MS)
    side = page.locator(".workspace-side").bounding_box()
    assert side is not None
    _save(page, folder, "settings", left=round(side["x"]), width=round(side["width"]))
    page.get_by_role("button", name="Render", exact=True).first.click()
    page.wait_for_url("**/#/jobs/*")
    job = page.url.rsplit("/", 1)[-1].partition("?")[0]
    _wait_for_samples(server, job, 0.15)
    _wait_for_denoised_film(page)
    page.get_by_role("list", name="Workers on this picture").wait_for()  # shown while tiles have outlines
    _save(page, folder, "grow")
    _wait_for_samples(server, job, 1.0)
    _wait_for_denoised_film(page, is_final=True)
    page.get_by_role("tab", name="Save").click()
    page.wait_for_timeout(SETTLE_MS)
    _save(page, folder, "save")
    page.get_by_role("tab", name="Notes").click()
    page.wait_for_timeout(SETTLE_MS)
    stage = page.locator(".stage-box").bounding_box()
    assert stage is not None
    page.get_by_role("button", name="Add note").click()
    page.get_by_label("Your name").fill("Ben")
    page.mouse.click(stage["x"] + 0.5 * stage["width"], stage["y"] + 0.35 * stage["height"])
    page.get_by_label("New note", exact=True).fill("Lovely glass. A softer lamp?")
    page.get_by_role("button", name="Save note").click()
    page.locator(".note-thread").first.wait_for()
    page.mouse.move(5, 5)
    page.wait_for_timeout(SETTLE_MS)
    _save(page, folder, "share")
    page.close()


def _takes(chromium: Browser, server: str, folder: Path) -> None:
    """Saves three takes of an example in different light through the page, and shows them."""
    scene = _scene(server, "spheres")
    takes = f"{server}/api/scenes/{scene}/takes"
    for take in httpx.get(takes, timeout=60).raise_for_status().json():
        httpx.delete(f"{takes}/{take['id']}", timeout=60).raise_for_status()
    page = _opened(chromium, viewport=SIZE, color_scheme="light", reduced_motion="reduce")
    page.add_init_script("localStorage['rayfarm.author'] ??= 'Anna'")
    page.goto(f"{server}/#/scenes/{scene}")
    view = page.locator(".live-view[data-view]")
    view.wait_for()
    for name, author, light, key in (
        ("Wide", "Anna", "From file", ""),
        ("Grey day", "Ben", "Overcast", "ArrowRight"),
        ("From above", "Anna", "Studio", "ArrowDown"),
    ):
        if page.locator(".takes-author input").is_visible():
            page.locator(".takes-author input").fill(author)
        page.locator(".lights").get_by_text(light, exact=True).click()
        view.focus()
        for _ in range(4 if key else 0):
            page.keyboard.press(key)
        _wait_for_clear_view(page)
        page.get_by_role("button", name="Save take").click()
        tile = page.get_by_role("button", name=re.compile(r"^Take \d+, "))
        tile.focus()
        page.keyboard.press("F2")
        page.get_by_label("Name of the take").locator("visible=true").fill(name)
        page.keyboard.press("Enter")
    page.evaluate("document.activeElement.blur()")
    page.locator(".takes .strip").evaluate("strip => strip.scrollLeft = 0")  # a new take scrolls it to the end
    page.mouse.move(5, 5)
    page.wait_for_timeout(3 * SETTLE_MS)
    _save_jpeg(page, folder / f"{TAKES}.jpg")
    page.close()


LAMPS = """
cameras: [{eye: [0, 1.1, 4.2], target: [0, 0.5, 0], fov: 33}]
environment: {color: 0.08}
lights:
  - {type: spot, position: [-2, 3, 2], target: [0, 0.4, 0], intensity: [40, 30, 20], light_group: key}
  - {type: point, position: [2, 2, 1.5], intensity: [4, 6, 12], light_group: fill}
materials:
  grey: {color: 0.7}
  white: {color: 0.8}
  orange: {kind: plastic, color: [0.8, 0.25, 0.05], roughness: 0.2}
  gold: {kind: conductor, metal: gold, roughness: 0.3}
shapes:
  - {type: sphere, material: gold, radius: 0.5, center: [-1.1, 0.5, 0]}
  - {type: sphere, material: orange, radius: 0.5, center: [0, 0.5, 0.1]}
  - {type: sphere, material: white, radius: 0.5, center: [1.1, 0.5, 0]}
  - {type: quad, material: grey, transform: [{scale: 12}, {rotate: {axis: x, degrees: -90}}]}
"""


def _light_mixer(chromium: Browser, server: str, folder: Path) -> None:
    """Shows a finished picture of two lamps, with one of them muted, and the other brighter and warmer."""
    files = {"files": ("two-lamps.yaml", LAMPS)}
    sent = httpx.post(f"{server}/api/scenes", files=files, data={"name": "Two lamps"}, timeout=60)
    scene = str(sent.raise_for_status().json()["id"])
    asked = {"scene": scene, "width": 960, "height": 600, "spp": 32, "light_groups": "key,fill"}
    key = {"Idempotency-Key": f"page-pictures-{LIGHT_MIXER}-{scene}"}
    job = str(httpx.post(f"{server}/api/jobs", json=asked, headers=key, timeout=60).raise_for_status().json()["id"])
    _wait_for_samples(server, job, 1.0)
    page = _opened(chromium, viewport={**SIZE, "height": 720}, color_scheme="light", reduced_motion="reduce")
    page.goto(f"{server}/#/jobs/{job}")
    page.locator("canvas.film").wait_for()
    _denoise(page)
    page.get_by_role("tab", name="Lights").click()
    page.get_by_role("button", name="Mute: key").click()
    page.get_by_label("Gain of fill").fill("1")
    page.get_by_label("Tint of fill").fill("#f5c98a")
    page.mouse.move(5, 5)
    page.locator(".channel-tag:visible", has_text="Light mix, denoised").wait_for()
    page.wait_for_timeout(SETTLE_MS)
    path = folder / f"{LIGHT_MIXER}.webp"
    Image.open(io.BytesIO(page.screenshot())).convert("RGB").save(path, quality=82, method=6)
    print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB", flush=True)
    page.close()


def _terminal(chromium: Browser, server: str, folder: Path) -> None:
    """Runs `rayfarm watch` in a terminal of its own while a job renders, and saves what it shows."""
    job = _job_id(server, example="still-life", width=960, height=600, spp=128, seed=2)
    _wait_for_samples(server, job, 0.1)
    page = _opened(chromium, viewport={"width": 900, "height": 700}, color_scheme="dark")
    page.set_content(_as_html(_written_by("watch", job[:4], "--graphics", "blocks", "--server", server)))
    path = folder / f"{TERMINAL}.webp"
    picture = Image.open(io.BytesIO(page.locator("pre").screenshot())).convert("RGB")
    picture.save(path, quality=82, method=6)
    page.close()
    print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB", flush=True)


def _written_by(*command: str) -> str:
    """Returns what a command of `rayfarm` writes to a terminal of true colour within `WATCHED_S`."""
    import fcntl  # POSIX only, as pseudo-terminals are
    import pty
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", LINES, COLUMNS, 0, 0))
    environment = {**os.environ, "COLORTERM": "truecolor", "TERM": "xterm-256color"}
    written, end = b"", time.monotonic() + WATCHED_S
    with subprocess.Popen(
        [sys.executable, "-m", "rayfarm", *command],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env=environment,
        start_new_session=True,
    ) as process:
        while time.monotonic() < end:
            if select.select([ours], [], [], 0.2)[0]:
                written += os.read(ours, 65536)
        process.kill()
    os.close(ours)
    os.close(theirs)
    return written[: written.rindex(b"\x1b[?2026l")].decode()  # up to the end of the last whole update


def _as_html(written: str) -> str:
    """Returns a page that shows the screen of a terminal: characters, and half blocks as two colours of a cell."""
    cells = [[(" ", "")] * COLUMNS for _ in range(LINES)]
    line = column = at = 0
    style = ""
    while at < len(written):
        if escape := ESCAPE.match(written, at):
            at = escape.end()
            numbers, kind = escape[1] or "", escape[2]
            if kind == "H":
                line, column = (int(number) - 1 for number in numbers.split(";"))
            elif kind == "m":
                style = numbers if not numbers or not style else f"{style};{numbers}"
            continue
        if ord(written[at]) >= ord(" ") and line < LINES and column < COLUMNS:
            cells[line][column] = (written[at], style)
            column += 1
        at += 1
    rows = "<br>".join("".join(_cell(*cell) for cell in row) for row in cells)
    screen = "pre { font: 14px/18px monospace; background: #111; color: #ddd; padding: 12px; display: inline-block; margin: 0 }"
    cell = "i { display: inline-block; width: 1ch; height: 18px; vertical-align: top; font-style: normal }"
    return f"<style>{screen} {cell}</style><pre>{rows}</pre>"


def _cell(character: str, style: str) -> str:
    """Returns one cell of the terminal as HTML."""
    colors = {layer: f"rgb({value.replace(';', ',')})" for layer, value in re.findall(r"\b([34]8);2;(\d+;\d+;\d+)", style)}
    if character != "▀" or len(colors) < 2:
        return f"<i>{html.escape(character)}</i>"
    return f'<i style="background: linear-gradient({colors["38"]} 50%, {colors["48"]} 50%)"></i>'


def _save_jpeg(page: Page, path: Path) -> None:
    Image.open(io.BytesIO(page.screenshot())).convert("RGB").save(path, quality=82, optimize=True)
    print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB", flush=True)


def _save(page: Page, folder: Path, step: str, *, left: int = 0, width: int = 0, height: int = 0) -> None:
    """Saves a part of what a page shows as the picture of a step; without `width` or `height` up to the edge."""
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    picture = picture.crop((left, 0, left + width if width else picture.width, height or picture.height))
    path = folder / FIRST_STEPS / f"{step}.webp"
    path.parent.mkdir(parents=True, exist_ok=True)
    picture.save(path, quality=82, method=6)
    print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB", flush=True)


def _scene(server: str, example: str) -> str:
    scene = str(httpx.post(f"{server}/api/examples/{example}", timeout=60).raise_for_status().json()["id"])
    deadline = time.monotonic() + PATIENCE_S
    while httpx.get(f"{server}/api/scenes/{scene}", timeout=60).raise_for_status().json()["status"] != "ready":
        if time.monotonic() > deadline:
            sys.exit(f"{example} was not ready after {PATIENCE_S} s.")
        time.sleep(1)
    return scene


def _job_id(server: str, example: str, **request: Any) -> str:
    """Returns the id of a job that renders an example; creates the job at the first call."""
    scene = _scene(server, example)
    key = {"Idempotency-Key": f"page-pictures-{scene}-{json.dumps(request, sort_keys=True)}"}
    answer = httpx.post(f"{server}/api/jobs", json={"scene": scene, **request}, headers=key, timeout=60)
    return str(answer.raise_for_status().json()["id"])


def _wait_for_samples(server: str, job: str, enough: float) -> None:
    """Waits until the job's progress is at least `enough` (0 to 1), or the job is finished.

    Exits if the job fails or is cancelled.
    """
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        told = httpx.get(f"{server}/api/jobs/{job}", timeout=60).raise_for_status().json()
        if told["progress"] >= enough or told["state"] == "finished":
            return
        if told["state"] in ("failed", "cancelled"):
            sys.exit(f"The job {job} is {told['state']}: {told['error'] or ''}")
        time.sleep(1)
    sys.exit(f"The job {job} had not come far enough after {PATIENCE_S} s.")


def _wait_for_clear_view(page: Page) -> None:
    """Waits until a live view that has just changed shows a denoised picture of at least `CLEAR_SPP` samples per pixel."""
    page.wait_for_timeout(SETTLE_MS)
    page.wait_for_function(IS_CLEAR, arg=CLEAR_SPP, timeout=1000 * PATIENCE_S)


def _wait_for_denoised_film(page: Page, *, is_final: bool = False) -> None:
    """Waits until a job's page shows a denoised picture; `is_final`: that of all samples, not a preview of some."""
    words = re.compile(r"^Denoised$" if is_final else r"^Denoised")
    page.locator(".channel-tag:visible", has_text=words).first.wait_for(timeout=1000 * PATIENCE_S)
    page.wait_for_timeout(SETTLE_MS)


def _denoise(page: Page) -> None:
    """Shows a finished picture denoised, in the tab View of its job's page."""
    page.get_by_role("radiogroup", name="Denoise").get_by_text("On", exact=True).click()
    page.mouse.move(5, 5)
    _wait_for_denoised_film(page, is_final=True)


def _show_still(page: Page) -> None:
    """Shows a job's finished picture denoised on the page, and moves the mouse over a pixel of it."""
    _denoise(page)
    stage = page.locator("canvas.film")
    stage.hover(position={"x": 400, "y": 300})
    page.wait_for_timeout(SETTLE_MS)


def _shot(page: Page) -> None:
    """Plays the example animation on the page, and stops it at the frame in which the caterpillar looks at the spinning top."""
    page.get_by_role("button", name="Play", exact=True).click()
    page.locator(".loaded").filter(has_text="in memory").wait_for()
    page.wait_for_timeout(5 * SETTLE_MS)
    page.get_by_role("button", name="Stop playing").click()
    page.get_by_role("slider", name="Frame").fill("20")
    _denoise(page)


def _notes(page: Page) -> None:
    """Writes notes on a job's picture through the page, once, asks for changes, and shows them."""
    page.locator("canvas.film").wait_for()
    _denoise(page)
    page.get_by_role("tab", name="Notes").click()
    page.wait_for_timeout(SETTLE_MS)
    box = page.locator(".stage-box").bounding_box()
    assert box is not None
    written = ((0.1, 0.75, "The gold is lovely, keep it."), (0.335, 0.42, "The highlight on the glass is too hard."))
    for x, y, text in written if page.locator(".note-thread").count() == 0 else ():
        page.get_by_role("button", name="Add note").click()
        page.get_by_label("Your name").fill("Ben")
        page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
        page.get_by_label("New note", exact=True).fill(text)
        page.get_by_role("button", name="Save note").click()
        page.locator(".note-thread", has_text=text).wait_for()
        page.wait_for_timeout(SETTLE_MS)
    glass = page.locator(".note-thread", has_text="glass")
    if not glass.get_by_text("softer").count():
        page.get_by_label("Your name").fill("Anna")
        glass.get_by_role("button", name="Reply").click()
        glass.get_by_role("textbox").fill("The next one has a softer lamp.")
        glass.get_by_role("button", name="Reply").click()
        page.get_by_label("Your name").fill("Ben")
        page.get_by_role("button", name="Ask for changes").click()
    page.wait_for_timeout(SETTLE_MS)
    page.get_by_role("button", name="Note 2 by").click()
    page.mouse.move(5, 5)
    page.wait_for_timeout(SETTLE_MS)


def _who_rendered(page: Page) -> None:
    """Shows in colours who rendered the tiles of a job's picture."""
    page.locator("canvas.film").wait_for()
    page.wait_for_timeout(SETTLE_MS)
    page.get_by_label("Who rendered it").check()
    page.mouse.move(5, 5)
    page.wait_for_timeout(SETTLE_MS)


TAKEN = {
    "page": ({"example": "still-life", "width": 960, "height": 600, "spp": 64}, 1.0, _show_still),
    "notes": ({"example": "still-life", "width": 960, "height": 600, "spp": 64}, 1.0, _notes),
    "shot-page": (
        {"example": "caterpillar", "width": 480, "height": 270, "spp": 8, "frames": "0-23", "order": "breadth-first"},
        1.0,
        _shot,
    ),
    "who-rendered": ({"example": "cornell-box", "width": 320, "height": 320, "spp": 48, "tile_size": 128}, 1.0, _who_rendered),
}

OTHERS = {
    TOUR: _tour,
    FIRST_STEPS: _first_steps,
    TAKES: _takes,
    LIGHT_MIXER: _light_mixer,
    TERMINAL: _terminal,
}

if __name__ == "__main__":
    main()
