"""Tests that a job keeps the exposure and tone curve with which it was ordered, and its picture the place of the view."""

from __future__ import annotations

import re

import httpx
import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Farm, Watched
from tests.e2e.small_glb import small_glb

pytestmark = pytest.mark.long

# Notes at every frame where the picture is: in the scene's view, or on the stage of the job's page with its first picture.
WATCH = """() => {
  window.places = [];
  const look = () => {
    const view = document.querySelector(".scene-page .live-view");
    const stage = document.querySelector(".job-page .stage");
    const box = (view ?? stage)?.getBoundingClientRect();
    const place = box && [view ? "scene" : "job", ...[box.x, box.y, box.width, box.height].map(Math.round)].join(" ");
    if (place && place !== window.places.at(-1)) window.places.push(place);
    requestAnimationFrame(look);
  };
  look();
}"""


def test_job_opens_with_the_look_it_was_ordered_with(farm: Farm, watched: Watched) -> None:
    scene = httpx.post(f"{farm.url}/api/examples/cornell-box").raise_for_status().json()["id"]
    page = watched.page
    page.goto(f"{farm.url}/#/scenes/{scene}")
    page.get_by_role("spinbutton", name="Width", exact=True).fill("96")
    page.get_by_role("spinbutton", name="Height", exact=True).fill("64")
    page.get_by_role("radiogroup", name="Quality").get_by_text("Custom").click()
    page.get_by_label("Samples per pixel").fill("4")
    page.get_by_role("slider", name="Exposure in stops").fill("1.5")
    with page.expect_response(lambda answer: answer.request.method == "POST" and answer.url.endswith("/api/jobs")) as sent:
        page.get_by_role("button", name="Render").click()
    job = sent.value.json()["id"]
    assert (sent.value.json()["exposure"], sent.value.json()["tonemap"]) == (1.5, "neutral")
    exposure = page.get_by_role("slider", name="Exposure")
    expect(exposure).to_have_value("1.5")
    assert "ev=" not in page.url, "it is the job's own"
    with page.expect_request(lambda request: f"/{job}/frames/0/image.jpg" in request.url and "exposure=1.5" in request.url):
        page.goto(f"{farm.url}/#/jobs")
    page.locator(f"a[href='#/jobs/{job}']").first.click()
    expect(exposure).to_have_value("1.5")
    exposure.dblclick()
    expect(page).to_have_url(re.compile(r"ev=0\b"))
    page.reload()
    expect(exposure).to_have_value("0")
    page.keyboard.press("Control+k")
    page.keyboard.type("Layout: Default")
    page.keyboard.press("Enter")
    expect(exposure).to_have_value("1.5")
    page.goto(f"{farm.url}/#/scenes/{scene}?like={job}")
    expect(page.get_by_role("slider", name="Exposure in stops")).to_have_value("1.5")
    page.goto(f"{farm.url}/#/compare/{job}/{job}")
    expect(exposure).to_have_value("1.5")
    assert watched.errors == []


def test_layout_changes_once_when_a_render_starts(farm: Farm, watched: Watched) -> None:
    """The view stays in place until the job's page is shown, whose picture is there at once without motion."""
    upload = httpx.post(f"{farm.url}/api/scenes", files={"files": ("once.glb", small_glb("layout changes once"))})
    scene = upload.raise_for_status().json()["id"]
    page = watched.page
    page.emulate_media(reduced_motion="reduce")
    page.goto(f"{farm.url}/#/scenes/{scene}")
    expect(page.locator(".view-state")).to_have_text(re.compile("sample"), timeout=90_000)
    page.evaluate(WATCH)
    page.get_by_role("button", name="Render").click()
    expect(page.locator(".job-page .stage")).to_be_visible(timeout=60_000)
    page.wait_for_timeout(1000)
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator(".chip.cancelled, .chip.finished")).to_be_visible()
    places = page.evaluate("places")
    assert [place.split()[0] for place in places] == ["scene", "job"], places
    assert watched.errors == []


# The place of the shown picture, in CSS pixels: left, top, width, height. A job's is computed from the canvas and its viewport.
PLACE = """() => {
  const view = document.querySelector(".scene-page .live-view")?.getBoundingClientRect();
  if (view) return [view.x, view.y, view.width, view.height];
  const stage = document.querySelector(".job-page .stage");
  const [scale, x, y] = stage.dataset.view.split(" ").map(Number);
  const { left, top } = stage.querySelector("canvas").getBoundingClientRect();
  const [, width, height] = /(\\d+)×(\\d+)/.exec(document.querySelector(".status-bar .size").textContent).map(Number);
  return [left + x, top + y, width * scale, height * scale];
}"""


def test_picture_is_centred_where_scene_view_had_it(farm: Farm, watched: Watched) -> None:
    """A picture rendered from the view lies where the view did; the next, from a view above a strip, is centred too."""
    upload = httpx.post(f"{farm.url}/api/scenes", files={"files": ("centred.glb", small_glb("picture is centred"))})
    scene = upload.raise_for_status().json()["id"]
    page = watched.page
    page.set_viewport_size({"width": 1440, "height": 900})
    page.goto(f"{farm.url}/#/scenes/{scene}")
    expect(page.locator(".view-state")).to_have_text(re.compile("sample"), timeout=90_000)
    before = page.evaluate(PLACE)
    for name in ("first", "second"):
        page.get_by_role("button", name="Render").click()
        expect(page.locator(".job-page .stage")).to_be_visible(timeout=60_000)
        page.get_by_role("button", name="Cancel").click()
        expect(page.locator(".chip.cancelled, .chip.finished")).to_be_visible()
        page.wait_for_timeout(500)  # the picture has glided to its place
        assert page.evaluate(PLACE) == pytest.approx(before, abs=1), name
        page.go_back()
        expect(page.get_by_role("region", name="Pictures of this scene")).to_be_visible()
        expect(page.locator(".view-state")).to_have_text(re.compile("sample"), timeout=90_000)
        assert page.evaluate(PLACE) == pytest.approx(before, abs=1), "the strip leaves the view where it is"
        picture = page.locator(".strip-picture").first
        box = picture.bounding_box()
        assert box and box["y"] + box["height"] <= 900, "the strip is whole"
    assert watched.errors == []
