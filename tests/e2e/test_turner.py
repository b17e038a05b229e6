"""The view in the hand: the arithmetic of turning, and a farm that follows it."""

from __future__ import annotations

import math

import httpx
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.e2e.conftest import Watched
from tests.e2e.site import call
from tests.helpers import Farm, wait_until

pytestmark = pytest.mark.browser

VIEW = {"eye": [3, 2, 5], "target": [0.5, 1, -1], "up": [0, 1, 0], "fov": 40}


def vector(view: dict[str, list[float]], name: str) -> np.ndarray:
    return np.array(view[name])


def test_turning_keeps_the_target_and_its_distance(page: Page) -> None:
    distance = np.linalg.norm(vector(VIEW, "eye") - vector(VIEW, "target"))
    for dx, dy in ((0.3, 0), (0, 0.4), (-2, -0.5), (0.1, 9)):
        turned = call(page, "scene/orbit", f"return m.orbit(a, {dx}, {dy});", VIEW)
        assert turned["target"] == VIEW["target"]
        offset = vector(turned, "eye") - vector(turned, "target")
        assert np.linalg.norm(offset) == pytest.approx(distance)
        assert abs(offset[1]) <= math.sin(math.radians(89.001)) * distance, "never along up"
    back = call(page, "scene/orbit", "return m.orbit(m.orbit(a, 0.7, 0.2), -0.7, -0.2);", VIEW)
    np.testing.assert_allclose(back["eye"], VIEW["eye"], atol=1e-12)


def test_what_is_dragged_follows_the_hand(page: Page) -> None:
    """Half a picture's height to the right and down: the old target is seen there."""
    moved = call(page, "scene/orbit", "return m.pan(a, 0.5, 0.25);", VIEW)
    forward = vector(moved, "target") - vector(moved, "eye")
    distance = np.linalg.norm(forward)
    right = np.cross(forward, VIEW["up"])
    right /= np.linalg.norm(right)
    above = np.cross(right, forward / distance)
    seen = vector(VIEW, "target") - vector(moved, "target")
    height = 2 * distance * math.tan(math.radians(VIEW["fov"] / 2))  # type: ignore[operator]
    np.testing.assert_allclose([seen @ right / height, seen @ above / height, seen @ forward], [0.5, -0.25, 0], atol=1e-9)


def test_a_pixels_depth_along_the_line_of_sight(page: Page) -> None:
    body = "return m.alongSight(a, { width: 300, height: 200 }, { x: 299, y: 0 }, 7);"
    half = math.tan(math.radians(20))
    direction = np.array([299 / 200 * half, 199 / 200 * half, 1])
    assert call(page, "scene/orbit", body, VIEW) == pytest.approx(7 / np.linalg.norm(direction))


@pytest.mark.farm
def test_the_farm_follows_the_hand_and_a_click_sets_the_focus(farm: Farm, watched: Watched) -> None:
    page = watched.page
    scene = httpx.post(f"{farm.url}/api/examples/spheres").raise_for_status().json()["id"]
    with farm.client() as client:
        client.wait_for_scene(scene)
    others = {job["id"] for job in httpx.get(f"{farm.url}/api/jobs").json()}
    page.goto(f"{farm.url}/#/scenes/{scene}")
    page.get_by_role("button", name="Turn the view").click()
    surface = page.locator(".turner")

    def picture() -> bytes:
        return surface.screenshot()

    def previews() -> list[dict[str, object]]:
        return [job for job in httpx.get(f"{farm.url}/api/jobs").json() if job["id"] not in others]

    wait_until(lambda: any(job["state"] == "finished" for job in previews()), 60, "the first preview is rendered")
    before = picture()
    box = surface.bounding_box()
    assert box
    page.mouse.move(box["x"] + 100, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 180, box["y"] + 120, steps=4)
    page.mouse.up()
    expect(page.get_by_label("Camera", exact=True)).to_have_value("\0view")
    wait_until(lambda: picture() != before, 30, "the preview shows the turned view")
    wait_until(lambda: [job["state"] for job in previews()] == ["finished"], 60, "only the last preview is left")
    assert "View preview" not in page.locator(".pictures").inner_text()

    page.get_by_role("button", name="Pick the focus").click()
    surface.click(position={"x": box["width"] / 2, "y": 0.9 * box["height"]})
    focus = page.get_by_label("Focus distance")
    expect(focus).not_to_have_value("")
    assert 2 < float(focus.input_value()) < 20, "the floor, between the camera and the spheres"

    page.get_by_role("button", name="Done").click()
    wait_until(lambda: not previews(), 20, "nothing of the previews is left")
    assert watched.errors == []
