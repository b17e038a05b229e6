"""Tests of a finished picture's page: loading the picture, and its tools."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import httpx
import numpy as np
import pytest
from playwright.sync_api import Page, WebSocket, expect

from renderer import aovs
from renderer.image import rgbe9995, tonemap
from tests.e2e.conftest import Watched
from tests.e2e.screen import assert_screen, assert_shows, on_screen, read_exr, render_job
from tests.e2e.site import call
from tests.helpers import Farm, wait_until

SIZE = {"width": 192, "height": 128, "tile_size": 64}


def spheres(farm: Farm) -> str:
    return str(httpx.post(f"{farm.url}/api/examples/spheres").raise_for_status().json()["id"])


@pytest.fixture(scope="module")
def finished(farm: Farm) -> str:
    """Returns the id of a finished job with several tiles."""
    return render_job(farm, spheres(farm), **SIZE, spp=8)


def open_job(page: Page, farm: Farm, job: str, query: str = "") -> None:
    page.goto(f"{farm.url}/#/jobs/{job}{query}")
    expect(page.locator(".stage")).to_have_attribute("data-film", "here")


@pytest.mark.long
def test_finished_picture_is_shown_at_once(farm: Farm, finished: str, watched: Watched, tmp_path: Path) -> None:
    """A finished picture is shown at once, by the JPEG of the job list, until the film has arrived.

    The film arrives in one response, without tiles over the live channel.
    """
    page = watched.page
    tiles: list[bytes] = []
    said: list[str] = []
    asked: list[str] = []

    def note(socket: WebSocket) -> None:
        socket.on("framereceived", lambda data: tiles.append(data) if isinstance(data, bytes) else None)
        socket.on("framesent", lambda data: said.append(str(data)))

    page.on("websocket", note)
    page.goto(f"{farm.url}/#/jobs")
    link = page.locator(f'a[href*="{finished}"]').first
    expect(page.locator(".job-row img").first).to_be_visible()
    page.on("request", lambda request: asked.append(request.url.split("/frames/")[-1]) if "/frames/" in request.url else None)
    page.evaluate("""() => {
        const before = fetch;
        const asked = new Promise((done) => { window.letTheFilmCome = done; });
        window.fetch = async (url, ...more) => {
            if (String(url).endsWith("/film")) await asked;
            return before(url, ...more);
        };
    }""")  # a Playwright route would disable the browser's cache
    link.click()
    poster = page.locator(".stage .poster img")
    expect(poster).to_have_js_property("naturalWidth", SIZE["width"])
    box, stage = poster.bounding_box(), page.locator(".stage").bounding_box()
    assert box and stage and box["width"] / box["height"] == pytest.approx(1.5, rel=0.02)
    page.evaluate("letTheFilmCome()")
    expect(page.locator(".stage")).to_have_attribute("data-film", "here")
    expect(poster).to_have_count(0)
    page.keyboard.press("1")
    page.mouse.move(5, 5)
    assert_shows(page, read_exr(f"{farm.url}/api/jobs/{finished}/frames/0/image.exr", tmp_path), 0, "neutral")
    assert asked == ["0/film"], "the JPEG is the list's"
    with page.expect_download() as download:
        page.get_by_role("button", name="Save", exact=True).click()
    assert re.fullmatch(r"Spheres(-\d+)?-8spp\.png", download.value.suggested_filename), "what people call it"
    page.get_by_role("button", name="Other formats").click()
    with page.expect_download() as download:
        page.get_by_role("menuitem", name="EXR").click()
    assert re.fullmatch(r"Spheres(-\d+)?-8spp\.exr", download.value.suggested_filename)
    have = [json.loads(text) for text in said if "have" in text]
    assert have == [{"have": [8] * 6}], "the service knows what is here"
    assert tiles == []
    assert watched.errors == []


def at(page: Page, x: float, y: float) -> tuple[float, float]:
    """Returns the position on the page, in CSS pixels, at which the point x, y of the picture is displayed."""
    stage = page.locator(".stage")
    scale, left, top = (float(v) for v in (stage.get_attribute("data-view") or "").split())
    box = page.locator("canvas.film").bounding_box()
    assert box is not None
    return box["x"] + left + x * scale, box["y"] + top + y * scale


@pytest.mark.long
def test_focus_rectangle_is_rendered_first(farm: Farm, watched: Watched) -> None:
    job = httpx.post(f"{farm.url}/api/jobs", json={"scene": spheres(farm), **SIZE, "spp": 60_000}).raise_for_status().json()["id"]
    url = f"{farm.url}/api/jobs/{job}"
    page = watched.page
    try:
        open_job(page, farm, job)
        page.keyboard.down("Shift")
        page.mouse.move(*at(page, 130, 70))
        page.mouse.down()
        page.mouse.move(*at(page, 185, 120), steps=3)
        page.mouse.up()
        page.keyboard.up("Shift")
        chip = page.locator(".stage-chip")
        expect(chip).to_contain_text("First: ")
        wait_until(lambda: httpx.get(url).json()["focus"] is not None, 20, "it is asked for")
        x, y, w, h = httpx.get(url).json()["focus"]
        assert abs(x - 130) <= 1 and abs(y - 70) <= 1 and abs(w - 56) <= 2 and abs(h - 51) <= 2

        def samples() -> np.ndarray:
            film = httpx.get(f"{url}/frames/0/film", headers={"Accept-Encoding": "identity"}).content
            return np.frombuffer(film, "<u4", 6, 12).astype(np.int64)

        first = samples()  # on a busy machine the others may have many by now

        def ahead() -> bool:
            added = samples() - first
            return bool(added[5] > 8 * max(added[:5].max(), 1))

        wait_until(ahead, 120, "the lower right tile gets more than all others")
        chip.get_by_role("button").click()
        expect(chip).to_be_hidden()
        wait_until(lambda: httpx.get(url).json()["focus"] is None, 20, "it is taken back")

        # Button and click: renders the tile below the pointer first.
        page.get_by_role("button", name="Render a region first").click()
        expect(chip).to_contain_text("Click or drag")
        page.mouse.click(*at(page, 10, 10))
        expect(chip).to_contain_text("First: 64×64 at 0, 0")
        page.keyboard.press("Shift+A")
        expect(chip).to_be_hidden()
    finally:
        httpx.delete(url)
    assert watched.errors == []


@pytest.mark.long
def test_light_groups_and_pinned_pixels_are_shown(farm: Farm, finished: str, watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    open_job(page, farm, finished, "?pins=3,4")
    page.keyboard.press("1")
    film = read_exr(f"{farm.url}/api/jobs/{finished}/frames/0/image.exr", tmp_path)
    light = rgbe9995.unpack(rgbe9995.pack(film))
    luminance = light @ np.array([0.2126, 0.7152, 0.0722], np.float32)

    # The value under the cursor is shown without moving the picture below it.
    stage = page.locator("canvas.film")
    box = stage.bounding_box()
    page.mouse.move(*at(page, 100.5, 64.5))
    expect(page.get_by_role("status", name="Pixel under the cursor").first).to_contain_text("100, 64")
    assert stage.bounding_box() == box
    page.mouse.move(5, 5)

    # A pinned pixel has its exact value on the page and its position in the URL, in film pixels; a second click removes it.
    pins = page.get_by_label("Inspected pixels")
    for x, y in ((3, 4), (100, 64)):
        if (x, y) != (3, 4):
            page.get_by_role("button", name="Inspect pixels").click()
            page.mouse.click(*at(page, x + 0.5, y + 0.5))
        row = pins.get_by_role("listitem").filter(has_text=f"{x}, {y}")
        expect(row.locator("dd").first).to_have_text(re.compile("[0-9]"))
        shown_values = [float(text) for text in row.locator("dd").all_inner_texts()]
        np.testing.assert_allclose(shown_values, [*film[y, x], film[y, x] @ [0.2126, 0.7152, 0.0722]], rtol=2e-3, atol=1e-4)
    expect(page).to_have_url(re.compile("pins=3(,|%2C)4(;|%3B)100(,|%2C)64"))
    # A drag pins an area, for which the mean and its difference from the first pin are shown.
    page.mouse.move(*at(page, 20.5, 30.5))
    page.mouse.down()
    page.mouse.move(*at(page, 43.5, 41.5), steps=3)
    page.mouse.up()
    row = pins.get_by_role("listitem").filter(has_text="24×12 at 20, 30")
    expect(row.locator("dd").first).to_have_text(re.compile("[0-9]"))
    mean = light[30:42, 20:44].mean((0, 1))
    shown_values = [float(text) for text in row.locator("dd").all_inner_texts()]
    np.testing.assert_allclose(shown_values, [*mean, mean @ [0.2126, 0.7152, 0.0722]], rtol=2e-3, atol=1e-4)
    expect(row).to_contain_text(
        f"{np.log2(luminance[30:42, 20:44].mean() / (film[4, 3] @ [0.2126, 0.7152, 0.0722])):+.1f} EV".replace("-", "−")
    )
    page.keyboard.press("Shift+V")
    expect(pins).to_be_hidden()

    page.mouse.move(5, 5)
    for key, grey in (("2", light[..., 0]), ("5", luminance)):
        page.keyboard.press(key)
        assert_screen(page, tonemap.apply(np.repeat(grey[..., None], 3, axis=2), 0, "neutral").astype(int), key)
    page.keyboard.press("6")
    at_stop = (np.log2(np.maximum(luminance, 1e-10) / 0.18) / 12 + 0.5).ravel()[::97]
    colours = call(page, "film/colour-map", "return a.map(m.turbo);", at_stop.tolist())
    screen = on_screen(page, SIZE["width"], SIZE["height"]).astype(int)
    deadline = time.monotonic() + 10
    while np.abs(screen.reshape(-1, 3)[::97] - np.array(colours) * 255).max() > 2 and time.monotonic() < deadline:
        screen = on_screen(page, SIZE["width"], SIZE["height"]).astype(int)
    assert np.abs(screen.reshape(-1, 3)[::97] - np.array(colours) * 255).max() <= 2, "false colour"
    expect(page.get_by_role("img", name="Luminance, in stops")).to_be_visible()

    # A key selects a plane, with a colour bar for its values.
    page.keyboard.press("Shift+9")
    expect(page.get_by_label("Channel")).to_have_value("error")
    answer = httpx.get(f"{farm.url}/api/jobs/{finished}/frames/0/image.png?aov=error")
    top = float(answer.headers["X-Span"].split(",")[1])
    expect(page.get_by_role("img", name="Error: 0; ")).to_be_visible()
    ticks = page.get_by_role("img", name="Error: 0; ").get_attribute("aria-label") or ""
    assert float(ticks.split("; ")[-1]) == pytest.approx(top, rel=1e-3)
    np.testing.assert_allclose(call(page, "film/colour-map", "return m.HEAT;"), aovs._HEAT, atol=1e-6)
    assert watched.errors == []


@pytest.mark.long
def test_history_shows_events_of_job(farm: Farm, finished: str, watched: Watched) -> None:
    page = watched.page
    open_job(page, farm, finished)
    page.get_by_role("tab", name="Info").click()
    details = page.get_by_role("region", name="Details")
    expect(details).to_contain_text("Path tracing")
    expect(details).not_to_contain_text("Caustics")  # its request leaves it out: the default
    page.get_by_text("History", exact=True).click()
    timeline = page.locator(".timeline")
    expect(timeline.get_by_role("listitem").first).to_contain_text("Requested")
    expect(timeline).to_contain_text("First picture")
    expect(timeline.get_by_role("listitem").last).to_contain_text("Finished")
    assert watched.errors == []
