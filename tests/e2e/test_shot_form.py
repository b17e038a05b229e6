"""Tests of the form of a shot: its frames, and the resulting request."""

from __future__ import annotations

import re
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests.e2e.site import call
from tests.e2e.test_settings_form import SCENE, open_form, submitted_request
from tests.grids import grid

MOVES = {
    **SCENE,
    "fps": 25.0,
    "clips": [
        {"name": "walk", "start": 0.0, "end": 2.0},
        {"name": "jump", "start": 0.5, "end": 1.5},
        {"name": "walk", "start": 0, "end": 8.99999},  # ends at frame 225, rounded to five decimals
    ],
}
STILL = {"scene": "abc", "camera": "front", "width": 300, "height": 200, "spp": 50}


@pytest.mark.long
def test_default_frames_cover_the_clip(page: Page) -> None:
    open_form(page, scene=MOVES)
    expect(page.get_by_label("Frames", exact=True)).to_be_hidden()
    page.get_by_text("Shot", exact=True).click()
    frames = page.get_by_label("Frames", exact=True)
    expect(frames).to_have_value("0-50")
    page.get_by_label("Clip").select_option("jump")
    expect(frames).to_have_value("13-37")
    page.get_by_label("Frames a second").fill("50")
    expect(frames).to_have_value("25-75")
    page.get_by_label("Clip").select_option("2")
    expect(frames).to_have_value("0-450")
    frames.fill("0-9")
    page.get_by_label("Frames a second").fill("25")
    expect(frames).to_have_value("0-9")
    expect(page.get_by_text("10 frames, 0.4 s")).to_be_visible()
    expect(page.get_by_title("30 M samples")).to_be_attached()  # of the estimate
    page.get_by_label("Order").select_option("every-nth")
    page.get_by_label("Every", exact=True).fill("4")
    assert submitted_request(page) == {**STILL, "frames": "0-9", "clip": "2", "order": "every-nth", "every": 4}


@pytest.mark.long
@grid(("scene", "frames"), [(MOVES, "0-50"), (SCENE, None)], ordinary=[MOVES])
def test_form_opened_as_shot_requests_whole_clip(page: Page, scene: dict[str, Any], frames: str | None) -> None:
    open_form(page, scene=scene, as_shot=True)
    shown = page.get_by_label("Frames", exact=True)
    if frames is None:
        expect(shown).to_be_hidden()
    else:
        expect(shown).to_have_value(frames)
        expect(page.get_by_label("Frame", exact=True)).to_be_hidden()


@pytest.mark.long
def test_animated_example_shows_duration_and_opens_as_shot(page: Page) -> None:
    told = {"name": "toy", "title": "A toy", "description": "It moves.", "scenes": []}
    page.route("**/api/examples", lambda route: route.fulfill(json=[{**told, "frames": "0-95", "fps": 24}]))
    page.route("**/api/examples/toy", lambda route: route.fulfill(json={**MOVES, "id": "abc"}))
    page.evaluate("document.body.innerHTML = '<div id=upload-place></div>';")  # which the home view moves into itself
    call(page, "news/farm", "m.scenes.set([]);")  # examples are listed after scenes
    call(page, "views/home", "document.body.replaceChildren(m.homeView().element);")
    expect(page.locator(".badge")).to_have_text("4 s")
    page.get_by_role("button", name="A toy").click()
    expect(page).to_have_url(re.compile(r"#/scenes/abc\?shot$"))


@pytest.mark.long
def test_still_of_animation_has_frame_field(page: Page) -> None:
    open_form(page, scene=MOVES)
    assert submitted_request(page) == STILL
    page.get_by_label("Frame", exact=True).fill("12.5")
    assert submitted_request(page) == {**STILL, "frame": 12.5}
    expect(page.get_by_label("Moment")).to_have_attribute("max", "50")
    page.get_by_label("Moment").fill("40")
    expect(page.get_by_label("Frame", exact=True)).to_have_value("40")
    assert submitted_request(page) == {**STILL, "frame": 40}


@pytest.mark.long
def test_static_scene_offers_turntable(page: Page) -> None:
    open_form(page)
    expect(page.get_by_label("Frame", exact=True)).to_be_hidden()
    page.get_by_text("Shot", exact=True).click()
    expect(page.get_by_label("Frames", exact=True)).to_have_value("0-95")
    page.get_by_label("Turn duration, s").fill("2")
    assert submitted_request(page) == {**STILL, "frames": "0-47", "fps": 24, "turntable": 2, "order": "in-turn"}


@pytest.mark.long
def test_invalid_frames_show_error_at_their_field(page: Page) -> None:
    open_form(page, scene=MOVES)
    page.get_by_text("Shot", exact=True).click()
    page.get_by_label("Frames", exact=True).fill("9-3")
    assert submitted_request(page) is None
    expect(page.get_by_role("alert").filter(has_text="The range 9-3 ends before it begins.")).to_be_visible()
    page.get_by_label("Frames", exact=True).fill("3-9")
    asked: dict[str, Any] = submitted_request(page)
    assert asked["frames"] == "3-9"
