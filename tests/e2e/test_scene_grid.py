"""Tests of the scenes on the front page: the latest come first, all are shown on request, and a search filters them."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from playwright.sync_api import Page, Route, expect

from tests.e2e.site import call

SHOW = """
    const grid = m.sceneGrid();
    document.body.replaceChildren(grid.aside, grid.element);
    grid.put(a);"""


def scene(i: int, name: str) -> dict[str, Any]:
    return {"id": f"s{i}", "name": name, "status": "ready", "created": -i, "counts": {}, "cameras": [], "warnings": []}


@pytest.mark.long
def test_latest_scenes_are_shown_first_and_search_finds_all(page: Page) -> None:
    older = scene(200, "Bridge at dawn")
    page.route("**/api/scenes?*", lambda route: answer(route, [older] if "bridge" in route.request.url else [older, *latest]))
    latest = [scene(i, f"Take {i}") for i in range(30)]
    page.evaluate("document.body.innerHTML = '<div id=announcer></div>'")  # exists in the page from its start
    call(page, "views/scene-grid", SHOW, latest)
    cards, search = page.locator(".card"), page.get_by_label("Search scenes")
    expect(cards).to_have_count(24)
    search.fill("take 7")
    expect(cards).to_have_count(3)  # 7, 17 and 27
    search.fill("bridge dawn")
    expect(cards).to_have_count(1)
    search.fill("nothing like that")
    expect(page.get_by_text("No scene has that name.")).to_be_visible()
    search.fill("")
    page.get_by_role("button", name="Show all scenes").click()
    expect(cards).to_have_count(31)
    expect(cards.nth(24).get_by_role("link")).to_be_focused()


@pytest.mark.long
def test_upload_has_a_card_until_it_ends(page: Page) -> None:
    body = """
        const grid = m.sceneGrid();
        document.body.replaceChildren(grid.element);
        const { arrive, arriving } = await import("/js/news/arriving.js");
        const upload = arrive("truck.glb");
        arriving.subscribe((uploads) => grid.put(a, uploads));
        upload.fraction.set(0.25);
        document.body.addEventListener("click", () => upload.end(), { once: true });"""
    call(page, "views/scene-grid", body, [scene(1, "Bridge")])
    cards = page.locator(".card")
    expect(cards).to_have_count(2)
    expect(cards.first).to_contain_text("truck.glb")
    expect(cards.first.get_by_role("progressbar")).to_have_attribute("aria-valuenow", "25")
    page.locator("body").click()
    expect(cards).to_have_count(1)
    expect(cards.first).to_contain_text("Bridge")


@pytest.mark.long
def test_failed_upload_has_a_card_with_its_reason(page: Page) -> None:
    failed = {**scene(2, "cut"), "status": "failed", "error": "cut.glb ends before its data does."}
    call(page, "views/scene-grid", SHOW, [scene(1, "Bridge"), failed, scene(3, "Tower")])
    cards = page.locator(".card")
    expect(cards).to_have_count(3)
    expect(cards.nth(1)).to_contain_text("cut.glb ends before its data does.")
    expect(cards.nth(1).locator(".chip")).to_have_text("Failed")
    expect(cards.nth(1).get_by_role("link")).to_have_attribute("href", re.compile("scenes/s2"))
    expect(cards.nth(0).locator(".chip, .why").filter(visible=True)).to_have_count(0)


@pytest.mark.long
def test_few_scenes_have_no_search(page: Page) -> None:
    call(page, "views/scene-grid", SHOW, [scene(i, f"Take {i}") for i in range(5)])
    expect(page.locator(".card")).to_have_count(5)
    expect(page.get_by_label("Search scenes")).to_be_hidden()


@pytest.mark.long
def test_opened_example_has_its_shipped_picture_or_else_its_thumbnail(page: Page) -> None:
    # Without the page's styles an icon is as wide as the page, and pictures far below the window are not loaded.
    page.set_viewport_size({"width": 200, "height": 1200})
    picture = '<svg xmlns="http://www.w3.org/2000/svg" width="3" height="2"/>'
    for place in ("**/shipped.svg", "**/thumbnail*"):
        page.route(place, lambda route: route.fulfill(content_type="image/svg+xml", body=picture))
    page.route("**/gone.jpg", lambda route: route.fulfill(status=404))
    for id, url in (("s1", "/shipped.svg"), ("s2", "/gone.jpg")):
        call(page, "news/example-pictures", "m.examplePictures.set(...a);", [id, url])
    body = """
        const cards = a.map((scene) => [m.sceneCard(scene), scene]);
        document.body.replaceChildren(...cards.map(([{ element }]) => element));
        for (const [card, scene] of cards) card.update(scene);"""
    call(page, "views/scene-card", body, [{**scene(i, f"Example {i}"), "thumbnail": "its own"} for i in (1, 2, 3)])
    images = page.locator(".card .picture img")
    expect(images.nth(0)).to_have_attribute("src", "/shipped.svg")
    expect(images.nth(0)).to_have_class("loaded")
    for i in (1, 2):
        images.nth(i).scroll_into_view_if_needed()  # else it is not loaded
        expect(images.nth(i)).to_have_attribute("src", re.compile(f"scenes/s{i + 1}/thumbnail"))


def answer(route: Route, found: list[dict[str, Any]]) -> None:
    route.fulfill(content_type="application/json", body=json.dumps(found))
