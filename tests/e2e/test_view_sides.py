"""Tests of pictures shown in place of a scene's live view: one (A), or two (A and B) beside a movable divider.

One of the two may be the live view itself.
"""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import parse_qs

import httpx
import pytest
from playwright.sync_api import WebSocket, expect

from tests.e2e.conftest import Watched
from tests.e2e.screen import assert_screen, assert_shows, expected_pixels, expected_split, read_exr, render_job
from tests.e2e.site import call
from tests.helpers import Farm, wait_until

SIZE = {"width": 96, "height": 64}


@pytest.mark.long
def test_sides_are_never_equal(watched: Watched, site) -> None:  # type: ignore[no-untyped-def]
    watched.page.goto(f"{site.url}/blank")
    body = """
        const steps = [["asA", "1"], ["asB", "2"], ["asB", "1"], ["asA", "2"], ["asA", "2"], ["asB", "3"], ["asB", "3"]];
        let now = { a: m.LIVE, b: "" };
        return steps.map(([deed, id]) => ((now = m[deed](now, id)), [now.a, now.b]));"""
    found = call(watched.page, "scene/sides", body)
    assert found == [["1", ""], ["1", "2"], ["1", ""], ["2", ""], ["live", ""], ["live", "3"], ["live", ""]]


@pytest.mark.long
def test_less_used_controls_open_by_keyboard_and_close_with_escape(watched: Watched, site) -> None:  # type: ignore[no-untyped-def]
    page = watched.page
    page.goto(f"{site.url}/blank")
    body = """
        window.escapes = 0;
        addEventListener("keydown", ({ key }) => (window.escapes += key === "Escape"));
        const control = Object.assign(document.createElement("button"), { textContent: "Denoise" });
        document.body.replaceChildren(...m.viewMore(document.body, control));"""
    call(page, "scene/view-more", body)
    more = page.get_by_role("button", name="More")
    expect(more).to_have_attribute("aria-expanded", "false")
    more.focus()
    page.keyboard.press("Enter")
    page.keyboard.press("Tab")
    expect(page.get_by_role("button", name="Denoise")).to_be_focused()
    expect(more).to_have_attribute("aria-expanded", "true")
    page.keyboard.press("Escape")
    expect(more).to_be_focused()
    expect(more).to_have_attribute("aria-expanded", "false")
    assert page.evaluate("window.escapes") == 0, "Escape had a page-wide meaning, too"
    more.press("Escape")
    assert page.evaluate("window.escapes") == 1


@pytest.mark.long
def test_pictures_are_shown_in_place_of_view(farm: Farm, watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    scene = httpx.post(f"{farm.url}/api/examples/spheres").raise_for_status().json()["id"]
    with farm.client() as client:
        client.wait_for_scene(scene)
    a, b = (
        render_job(farm, scene, spp=spp, environment={"preset": light}, **SIZE) for spp, light in ((2, "studio"), (4, "noon"))
    )
    films = [read_exr(f"{farm.url}/api/jobs/{job}/frames/0/image.exr", tmp_path) for job in (a, b)]
    said: list[str] = []

    def listen(socket: WebSocket) -> None:
        if socket.url.endswith("/viewport"):
            socket.on("framesent", lambda text: said.append(str(text)))

    page.on("websocket", listen)

    def params() -> dict[str, list[str]]:
        return parse_qs(str(page.evaluate("location.hash")).partition("?")[2])

    page.goto(f"{farm.url}/#/scenes/{scene}")
    surface = page.locator(".live-view")
    page.wait_for_selector(".live-view[data-view]", timeout=120_000)
    tiles = [page.locator(f"[data-job='{job}']") for job in (a, b)]

    tiles[0].click()
    expect(page.locator(".stage[data-film=here]")).to_be_visible()
    expect(surface).to_be_hidden()
    expect(tiles[0]).to_have_attribute("aria-pressed", "true")
    wait_until(lambda: params().get("a") == [a] and '{"paused":true}' in said, 20, "what is not seen is not rendered")
    page.keyboard.press("1")
    page.evaluate("scrollTo(0, 0)")  # the filmstrip is further down
    assert_shows(page, films[0], 0, "neutral")

    tiles[1].click(modifiers=["Shift"])
    expect(page.locator(".channel-tag.left")).to_have_text("A: Studio, 2 samples")
    expect(page.locator(".channel-tag.right")).to_have_text(re.compile("^B: .*4 samples"))
    page.keyboard.press("1")
    page.evaluate("scrollTo(0, 0)")  # the filmstrip is further down
    assert_screen(
        page, expected_split(expected_pixels(films[0], 0, "neutral"), expected_pixels(films[1], 0, "neutral"), page), "A beside B"
    )
    expect(page.get_by_role("link", name="Compare", exact=True)).to_have_attribute("href", f"#/compare/{a}/{b}")
    assert (params()["a"], params()["b"]) == ([a], [b])
    page.reload()
    expect(page.locator(".channel-tag.left")).to_have_text("A: Studio, 2 samples")

    page.get_by_label("Picture B").select_option("live")
    expect(page.locator(".channel-tag.right")).to_have_text("B: Live view")
    expect(page.locator(".view-state")).to_be_visible()
    wait_until(lambda: int(surface.get_attribute("data-samples") or 0) > 0, 60, "it goes on")
    box = page.locator(".view-stage .stage").bounding_box()
    assert box
    page.keyboard.down("l")
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.2 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + 0.2 * box["height"], steps=3)
    page.mouse.up()
    page.keyboard.up("l")
    assert float(page.get_by_label("Rotation, °").input_value()) == pytest.approx(-36, abs=4), "the light beside A is turned"

    page.get_by_role("button", name="Swap left and right").click()
    expect(page.locator(".channel-tag.left")).to_have_text("A: Live view")
    page.keyboard.press("Escape")
    expect(surface).to_be_visible()
    assert not {"a", "b", "at"} & params().keys()
    tiles[1].focus()
    page.keyboard.press("Shift+Enter")
    expect(page.locator(".channel-tag.right")).to_have_text(re.compile("^B: 4 samples"))
    page.get_by_role("button", name="Live view", exact=True).click()
    expect(surface).to_be_visible()
    page.get_by_role("link", name="Open Spheres, 96×64").first.click()
    expect(page.locator(".job-page")).to_be_visible()
    assert not watched.errors
