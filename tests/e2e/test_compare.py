"""Tests of the comparison of two pictures: the first is shown left of a movable divider (the wipe), the second right of it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import httpx
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from renderer import settings
from service.models.jobs import JobIn
from tests.e2e.conftest import Watched
from tests.e2e.screen import assert_screen, expected_pixels, expected_split, read_exr, render_job
from tests.helpers import ROOT, Farm
from tests.rayfarm.test_sequence import animated_scene

SIZE = {"width": 96, "height": 64}


def open_comparison(farm: Farm, page: Page, tmp_path: Path) -> tuple[list[str], list[np.ndarray]]:
    """Renders a scene with two maximum depths, and opens the comparison of the pictures.

    Returns (ids of the two jobs, expected display of each picture).
    """
    scene = httpx.post(f"{farm.url}/api/examples/spheres").raise_for_status().json()["id"]
    jobs = [render_job(farm, scene, **SIZE, spp=4, max_depth=depth) for depth in (2, 9)]
    films = [read_exr(f"{farm.url}/api/jobs/{job}/frames/0/image.exr", tmp_path) for job in jobs]
    pictures = [expected_pixels(film, -1.0, "hue") for film in films]
    assert np.abs(pictures[0] - pictures[1]).max() > 50, "the two differ, or this test says nothing"
    page.goto(f"{farm.url}/#/compare/{jobs[0]}/{jobs[1]}?ev=-1&tone=hue")
    expect(page.get_by_role("slider", name="Wipe")).to_be_visible()
    expect(page.locator(".channel-tag.left")).to_have_text("depth 2")
    expect(page.locator(".channel-tag.right")).to_have_text("depth 9")
    page.keyboard.press("1")
    page.mouse.move(5, 5)
    return jobs, pictures


@pytest.mark.long
def test_each_side_of_divider_shows_its_picture(farm: Farm, watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    jobs, pictures = open_comparison(farm, page, tmp_path)
    assert_screen(page, expected_split(*pictures, page), "the middle")
    page.get_by_role("slider", name="Wipe").focus()
    page.keyboard.press("Home")
    assert_screen(page, pictures[1], "all of the right one")
    # The default partner is the previous picture of the scene that looks different.
    page.goto(f"{farm.url}/#/compare/{jobs[1]}")
    expect(page).to_have_url(re.compile(f"compare/{jobs[1]}/{jobs[0]}"))
    assert watched.errors == []


@pytest.mark.long
def test_each_side_has_exposure_of_its_job(farm: Farm, watched: Watched, tmp_path: Path) -> None:
    scene = httpx.post(f"{farm.url}/api/examples/spheres").raise_for_status().json()["id"]
    jobs = [render_job(farm, scene, **SIZE, spp=4, exposure=exposure) for exposure in (-1.0, 0.5)]
    films = [read_exr(f"{farm.url}/api/jobs/{job}/frames/0/image.exr", tmp_path) for job in jobs]
    page = watched.page
    page.goto(f"{farm.url}/#/compare/{jobs[0]}/{jobs[1]}?tone=hue")
    expect(page.get_by_role("slider", name="Wipe")).to_be_visible()
    expect(page.get_by_text("A −1.0, B +0.5 EV")).to_be_visible()
    page.keyboard.press("1")
    page.mouse.move(5, 5)
    left, right = (expected_pixels(film, exposure, "hue") for film, exposure in zip(films, (-1.0, 0.5), strict=True))
    assert_screen(page, expected_split(left, right, page), "each its own")
    page.get_by_label("Same exposure").check()
    page.mouse.move(5, 5)
    assert_screen(page, expected_split(left, expected_pixels(films[1], -1.0, "hue"), page), "that of A")
    expect(page).to_have_url(re.compile(r"same=1"))
    assert watched.errors == []


@pytest.mark.long
def test_divider_position_is_in_url(farm: Farm, watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    jobs, pictures = open_comparison(farm, page, tmp_path)
    divider = page.get_by_role("slider", name="Wipe")

    # Keyboard: to one end, and back in steps of ten.
    divider.focus()
    page.keyboard.press("Home")
    expect(divider).to_have_attribute("aria-valuenow", "0")
    assert_screen(page, pictures[1], "all of the right one")
    page.keyboard.press("End")
    assert_screen(page, pictures[0], "all of the left one")
    for _ in range(5):
        page.keyboard.press("Shift+ArrowLeft")
    page.keyboard.press("ArrowRight")
    expect(divider).to_have_attribute("aria-valuenow", "51")

    # Mouse: moving the divider does not move the picture.
    stage = page.locator(".stage").bounding_box()
    grip = divider.bounding_box()
    assert stage and grip
    page.mouse.move(grip["x"] + grip["width"] / 2, grip["y"] + 30)
    page.mouse.down()
    page.mouse.move(stage["x"] + 0.48 * stage["width"], grip["y"] + 60, steps=3)
    page.mouse.up()
    expect(divider).to_have_attribute("aria-valuenow", "48")
    page.mouse.move(5, 5)
    assert_screen(page, expected_split(*pictures, page), "after a drag")

    # The URL has the whole state; swapping exchanges left and right.
    expect(page).to_have_url(re.compile(r"wipe=0\.48"))
    page.reload()
    expect(divider).to_have_attribute("aria-valuenow", "48")
    page.keyboard.press("1")
    page.keyboard.press("x")
    expect(page.locator(".channel-tag.left")).to_have_text("depth 9")
    expect(divider).to_have_attribute("aria-valuenow", "52")
    page.keyboard.press("1")
    assert_screen(page, expected_split(pictures[1], pictures[0], page), "swapped")
    expect(page).to_have_url(re.compile(f"compare/{jobs[1]}/{jobs[0]}"))

    # A plane of one picture next to the light of the other.
    page.get_by_label("Channel of A").select_option("albedo")
    expect(page.locator(".channel-tag.left")).to_have_text("depth 9, Albedo")
    assert watched.errors == []


@pytest.mark.long
def test_shots_are_compared_frame_by_frame(farm: Farm, watched: Watched, tmp_path: Path) -> None:
    """In a comparison of two shots, each side shows its frame nearest to the selected one.

    The link back to the picture, and a new comparison from there, keep the frame.
    """
    parts = [("files", ("turns.glb", animated_scene().glb()))]
    scene = httpx.post(f"{farm.url}/api/scenes", files=parts).raise_for_status().json()["id"]
    white = {"environment": {"color": [1, 1, 1]}}
    shots = [render_job(farm, scene, **SIZE, **white, spp=2, frames=frames) for frames in ("0-12x4", "0-15x5")]
    films = [
        {n: read_exr(f"{farm.url}/api/jobs/{job}/frames/{n}/image.exr", tmp_path) for n in numbers}
        for job, numbers in zip(shots, ((0, 4, 8), (0, 5, 10)), strict=True)
    ]
    page = watched.page
    page.goto(f"{farm.url}/#/compare/{shots[0]}/{shots[1]}?frame=8")
    slider = page.get_by_role("slider", name="Frame")
    expect(slider).to_have_attribute("aria-valuetext", "Frame 8")
    expect(page.get_by_role("region", name="Frame")).to_contain_text("B shows frame 10, the nearest that it has.")
    page.keyboard.press("1")
    page.mouse.move(5, 5)

    def shows(left: int, right: int) -> None:
        pictures = [expected_pixels(film[n], 0, "neutral") for film, n in zip(films, (left, right), strict=True)]
        assert_screen(page, expected_split(*pictures, page), f"frames {left} and {right}")

    shows(8, 10)
    slider.focus()
    page.keyboard.press("ArrowLeft")  # frame 5, which only the right shot has
    expect(page).to_have_url(re.compile("frame=5"))
    shows(4, 5)
    page.get_by_role("link", name="Back to the picture").click()
    expect(page).to_have_url(re.compile(f"jobs/{shots[0]}.*frame=4"))
    page.get_by_role("link", name="Compare with another picture").click()
    expect(page).to_have_url(re.compile(f"compare/{shots[0]}/.*frame=4"))
    assert watched.errors == []


@pytest.mark.long
def test_example_comparison_opens_by_one_click(farm: Farm, watched: Watched) -> None:
    page = watched.page
    small = {"spheres": [{"title": "Shallow beside deep", "both": {**SIZE, "spp": 1}, "left": {"max_depth": 1}, "right": {}}]}
    page.route("**/comparisons.json", lambda route: route.fulfill(json=small))
    page.goto(farm.url)
    page.get_by_role("button", name="Shallow beside deep").click()
    expect(page).to_have_url(re.compile("/compare/"))
    expect(page.locator(".channel-tag.left")).to_have_text("depth 1")
    expect(page.get_by_label("Progress", exact=True)).to_contain_text("FinishedBFinished", timeout=60_000)
    first = re.search(r"compare/(\w+/\w+)", page.url)
    page.goto(farm.url)
    page.get_by_role("button", name="Shallow beside deep").click()
    expect(page).to_have_url(re.compile("/compare/"))
    assert first and first.group(1) in page.url
    assert watched.errors == []


def test_shipped_comparisons_can_be_requested() -> None:
    offered = json.loads((ROOT / "web" / "examples" / "comparisons.json").read_text())
    for example, comparisons in offered.items():
        assert any((ROOT / "scenes" / f"{name}.yaml").is_file() for name in (example, f"{example}/{example}")), example
        for comparison in comparisons:
            both = comparison.get("both", {})
            left, right = ({"scene": "x", **both, **comparison[side]} for side in ("left", "right"))
            assert left != right
            for request in (left, right):
                JobIn(**request)
                own = {key: value for key, value in request.items() if key in settings.RenderSettings.__dataclass_fields__}
                view = settings.View((0, 0, 1), (0, 0, 0))
                settings.RenderSettings(**{"width": 8, "height": 8, **own, "view": view})
