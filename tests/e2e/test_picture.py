"""The page of one picture: how it opens, and what can be done with it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import Page, WebSocket, expect

from tests.e2e.conftest import Watched
from tests.e2e.screen import assert_shows, read_exr, rendered
from tests.helpers import Farm

pytestmark = [pytest.mark.browser, pytest.mark.farm]

SIZE = {"width": 192, "height": 128, "tile_size": 64}


def spheres(farm: Farm) -> str:
    return str(httpx.post(f"{farm.url}/api/examples/spheres").raise_for_status().json()["id"])


@pytest.fixture(scope="module")
def finished(farm: Farm) -> str:
    """A job that is finished, of some tiles."""
    return rendered(farm, spheres(farm), **SIZE, spp=8)


def open_job(page: Page, farm: Farm, job: str, query: str = "") -> None:
    page.goto(f"{farm.url}/#/jobs/{job}{query}")
    expect(page.locator(".stage")).to_have_attribute("data-film", "here")


def test_a_finished_picture_is_there_at_once(farm: Farm, finished: str, watched: Watched, tmp_path: Path) -> None:
    """The list's JPEG until the film is here, which comes in one answer; no tile after it."""
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
        window.fetch = async (url, ...more) => {
            if (String(url).endsWith("/film")) await new Promise((done) => setTimeout(done, 300));
            return before(url, ...more);
        };
    }""")  # a route would keep the browser from using what it has
    link.click()
    poster = page.locator(".stage .poster img")
    expect(poster).to_have_js_property("naturalWidth", SIZE["width"])
    box, stage = poster.bounding_box(), page.locator(".stage").bounding_box()
    assert box and stage and box["width"] / box["height"] == pytest.approx(1.5, rel=0.02)
    expect(page.locator(".stage")).to_have_attribute("data-film", "here")
    expect(poster).to_have_count(0)
    page.keyboard.press("1")
    page.mouse.move(5, 5)
    assert_shows(page, read_exr(f"{farm.url}/api/jobs/{finished}/frames/0/image.exr", tmp_path), 0, "neutral")
    page.wait_for_timeout(300)
    have = [json.loads(text) for text in said if "have" in text]
    assert have == [{"have": [8] * 6}], "the service knows what is here"
    assert tiles == [] and asked == ["0/film"], "the JPEG is the list's"
    assert watched.errors == []


def changed(farm: Farm, job: str, **change: Any) -> dict[str, Any]:
    answer: dict[str, Any] = httpx.patch(f"{farm.url}/api/jobs/{job}", json=change).raise_for_status().json()
    return answer
