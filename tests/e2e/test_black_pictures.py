"""Tests that the page says why a picture is black, and frames a scene that its camera does not show or shows small."""

from __future__ import annotations

import re

import httpx
import pytest
from playwright.sync_api import Page, expect

from tests.e2e.conftest import Watched
from tests.e2e.screen import render_job
from tests.helpers import Farm

pytestmark = pytest.mark.long

SCENE = """
name: Behind
cameras: [{eye: [0, 0, 4], target: [0, 0, 9], fov: 40}]
environment: {color: 0}
materials: {clay: {color: 0.5}, lamp: {color: 0, emission: 5}}
shapes:
  - {type: sphere, material: clay, center: [0, 0, 0], radius: 1}
  - {type: sphere, material: lamp, center: [0, 6, 0], radius: 0.5}
"""


def choose_own_camera(page: Page) -> None:
    """Chooses the file's camera, in place of which the page shows the scene by the automatic one."""
    camera = page.get_by_label("Camera", exact=True)
    note = page.get_by_text("The file's camera sees nothing, so the automatic one is used.")
    expect(camera.locator("option:checked")).to_have_text("Automatic: frames the scene")
    expect(note).to_be_visible()
    camera.select_option("0")
    expect(note).to_be_hidden()


def test_black_view_says_before_its_first_samples_that_the_camera_sees_nothing(farm: Farm, watched: Watched) -> None:
    """The page explains a black picture before any sample if the scene's bounds lie outside the camera's view."""
    page = watched.page
    sent = httpx.post(f"{farm.url}/api/scenes", files={"files": ("behind.yaml", SCENE.replace("Behind", "Behind at once"))})
    scene = sent.raise_for_status().json()["id"]
    with farm.client() as client:
        client.wait_for_scene(scene)
    page.route_web_socket("**/viewport", lambda socket: None)  # keeps samples from arriving
    page.goto(f"{farm.url}/#/scenes/{scene}")
    dark = page.locator(".view-dark")
    choose_own_camera(page)
    expect(dark).to_contain_text("The camera sees nothing")
    expect(dark.get_by_role("button", name="Frame the scene")).to_be_visible()
    expect(page.locator(".view-state")).to_have_text("Preparing the view …")
    cost = page.locator(".submit")
    expect(cost).to_contain_text("The picture will be black, since the camera sees nothing.")
    cost.get_by_role("button", name="Frame the scene").click()
    expect(cost).not_to_contain_text("black")
    assert watched.errors == []


def test_black_view_and_job_say_that_the_camera_sees_nothing(farm: Farm, watched: Watched) -> None:
    """The pages of the job and of the scene offer to frame the scene, which then is seen; cards have a word over the black."""
    page = watched.page
    sent = httpx.post(f"{farm.url}/api/scenes", files={"files": ("behind.yaml", SCENE)})
    scene = sent.raise_for_status().json()["id"]
    with farm.client() as client:
        client.wait_for_scene(scene)
    job = render_job(farm, scene, width=64, height=36, spp=4)
    page.goto(f"{farm.url}/#/jobs/{job}")
    notice = page.locator(".stage-black")
    expect(notice).to_contain_text("The camera sees nothing")
    expect(notice.get_by_role("link", name="Frame the scene")).to_have_attribute("href", re.compile(f"{scene}.*view="))
    page.goto(f"{farm.url}/#/")
    expect(page.locator(".job-row", has_text="Behind").get_by_text("Nothing visible")).to_be_visible()

    page.goto(f"{farm.url}/#/scenes/{scene}")
    dark = page.locator(".view-dark")
    choose_own_camera(page)
    expect(dark).to_contain_text("The camera sees nothing", timeout=60_000)
    expect(dark.get_by_role("button", name="Studio light")).to_be_hidden()
    dark.get_by_role("button", name="Frame the scene").click()
    expect(dark).to_be_hidden()
    expect(page).not_to_have_url(re.compile("view="))  # it is the camera that the page opens the scene with
    assert watched.errors == []


def test_scene_without_area_says_so_once_on_its_page_and_card(farm: Farm, watched: Watched) -> None:
    """A scene of which nothing can be seen says why and what to do; it has no remedy by the camera or by light."""
    page = watched.page
    flat = "v 0.1 0.1 0.1\nv 0.7 0.7 0.7\nv 1.3 1.3 1.3000001\nf 1 2 3\n"  # a line but for rounding
    sent = httpx.post(f"{farm.url}/api/scenes", files={"files": ("flat.obj", flat)})
    scene = sent.raise_for_status().json()["id"]
    with farm.client() as client:
        ready = client.wait_for_scene(scene)
    said = "Nothing is visible, since no surface of the file has an area"
    assert [said in warning for warning in ready.warnings].count(True) == 1
    page.goto(f"{farm.url}/#/scenes/{scene}")
    dark = page.locator(".view-dark")
    expect(dark).to_contain_text(said)
    expect(page.locator(".live-view")).to_have_attribute("data-samples", re.compile("^[1-9]"), timeout=60_000)
    expect(page.locator(".view-state")).to_have_text("Nothing visible")
    expect(dark).to_contain_text(said)
    expect(dark.get_by_role("button")).to_have_count(0)
    expect(page.get_by_text("The file's camera sees nothing")).to_be_hidden()
    expect(page.get_by_text("The picture will show nothing of the file.")).to_be_visible()
    expect(page.get_by_role("button", name="Render", exact=True)).not_to_have_class(re.compile(r"\bprimary\b"))
    expect(page.get_by_role("group", name="Sides")).to_be_hidden()
    page.goto(f"{farm.url}/#/")
    word = page.locator(".card", has_text="flat").get_by_text("Nothing visible")
    expect(word).to_have_attribute("title", re.compile(said), timeout=60_000)

    page.route_web_socket("**/viewport", lambda socket: None)  # keeps samples from arriving
    page.goto(f"{farm.url}/#/scenes/{scene}")
    page.reload()
    expect(dark).to_contain_text(said)
    expect(page.locator(".view-state")).to_have_text("Nothing visible")
    assert watched.errors == []


def test_scene_that_its_camera_shows_small_is_framed_and_framing_is_undone(farm: Farm, watched: Watched) -> None:
    page = watched.page
    distant = SCENE.replace("Behind", "Distant").replace(
        "eye: [0, 0, 4], target: [0, 0, 9]", "eye: [0, 0, 90], target: [0, 0, 0]"
    )
    sent = httpx.post(f"{farm.url}/api/scenes", files={"files": ("distant.yaml", distant)})
    scene = sent.raise_for_status().json()["id"]
    with farm.client() as client:
        client.wait_for_scene(scene)
    page.goto(f"{farm.url}/#/scenes/{scene}")
    frame = page.get_by_role("button", name="Frame the scene")
    camera = page.get_by_label("Camera", exact=True).locator("option:checked")
    own = camera.inner_text()
    frame.click()
    page.get_by_role("button", name="Undo").focus()  # else it is removed after some seconds
    expect(frame).to_be_hidden()
    expect(camera).to_have_text("Automatic: frames the scene")
    page.keyboard.press("Enter")
    expect(frame).to_be_visible()
    expect(camera).to_have_text(own)
    expect(page).not_to_have_url(re.compile("view="))
    page.keyboard.press("f")
    expect(frame).to_be_hidden()
    expect(page).to_have_url(re.compile("view="))
    assert watched.errors == []
