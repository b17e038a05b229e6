"""Tests of the light tools in a scene's view: dragging rotates and strengthens the light, a click places the sun."""

from __future__ import annotations

import math
from typing import Any

import httpx
import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Watched
from tests.helpers import Farm, wait_until

FOV = 40
# Sky above, floor below, and a wall in the middle that faces the camera.
SCENE = f"""
shapes:
  - {{type: quad, transform: [{{scale: 50}}, {{rotate: {{axis: x, degrees: -90}}}}]}}
  - {{type: quad, transform: [{{scale: [0.5, 0.1, 1]}}, {{translate: [0, 1, 0]}}]}}
environment: {{preset: overcast}}
cameras:
  - {{eye: [0, 1, 6], target: [0, 1, 0], fov: {FOV}}}
settings: {{width: 320, height: 320}}
"""


@pytest.fixture(scope="module")
def scene(farm: Farm) -> str:
    sent = {"files": ("wall.yaml", SCENE.encode())}
    found: dict[str, Any] = httpx.post(f"{farm.url}/api/scenes", files=sent, timeout=60).raise_for_status().json()
    with farm.client() as client:
        client.wait_for_scene(found["id"])
    return str(found["id"])


@pytest.mark.long
def test_light_is_rotated_and_sun_placed_in_view(farm: Farm, watched: Watched, scene: str) -> None:
    page = watched.page
    page.goto(f"{farm.url}/#/scenes/{scene}")
    surface, readout, hint = (page.locator(name) for name in (".live-view", ".view-readout", ".view-hint"))
    page.wait_for_selector(".live-view[data-view]", timeout=120_000)
    rotation, strength = page.get_by_label("Rotation, °"), page.get_by_label("Strength", exact=True)
    box = surface.bounding_box()
    assert box

    def at(x: float, y: float) -> tuple[float, float]:
        return box["x"] + x * box["width"], box["y"] + y * box["height"]

    def seen() -> int:
        return int(surface.get_attribute("data-view") or 0)

    before = seen()
    page.mouse.move(*at(0.5, 0.5))
    page.keyboard.down("l")
    page.mouse.down()
    page.mouse.move(*at(0.25, 0.5), steps=4)
    turn = round(360 * (0.25 - 3 / box["width"]))
    expect(readout).to_have_text(f"Rotation {turn}°, strength 1")
    wait_until(lambda: seen() > before, 60, "the turned light is seen while it is held")
    assert rotation.input_value() == str(turn)
    page.keyboard.press("Escape")
    expect(readout).to_contain_text("Undone: Rotation 0°")
    assert rotation.input_value() == "0"
    page.mouse.up()
    page.keyboard.up("l")
    expect(surface).to_have_attribute("data-tool", "")
    assert "view=" not in page.evaluate("location.href"), "the view stands still"

    page.keyboard.down("Shift")
    page.mouse.move(*at(0.5, 0.75))
    page.mouse.down(button="right")
    page.mouse.move(*at(0.5, 0.25), steps=4)
    page.mouse.up(button="right")
    page.keyboard.up("Shift")
    assert 2 < float(strength.input_value()) < 4, "half the height is two stops, less what trembles"

    page.keyboard.press("l")
    expect(page.get_by_role("button", name="Turn the light")).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowLeft")
    assert rotation.input_value() == "10"

    page.get_by_role("button", name="Place it in the view").or_(page.get_by_role("button", name="Place the sun")).first.click()
    height, direction = page.get_by_label("Sun's height"), page.get_by_label("Sun's direction")
    rise = math.degrees(math.atan(0.5 * math.tan(math.radians(FOV / 2))))
    page.mouse.click(*at(0.5, 0.25))
    expect(hint).to_have_text(f"Sun at {rise:.0f}° elevation, 0°.")
    expect(page.get_by_role("radio", name="Clear sky")).to_be_checked()
    assert float(height.input_value()) == pytest.approx(rise, abs=0.3)
    assert float(direction.input_value()) == pytest.approx(10, abs=0.3), "seen straight ahead, in a sky that is turned"
    page.mouse.click(*at(0.5, 0.5))
    expect(hint).to_have_text(
        "Sun at 2° elevation, 180°. A highlight there needs a sun below the horizon, so it is placed just above it."
    )
    page.mouse.click(*at(0.5, 0.75))
    expect(hint).to_have_text(f"Sun at {rise:.0f}° elevation, 0°.")
    before = seen()
    wait_until(lambda: seen() > before or int(surface.get_attribute("data-samples") or 0) > 0, 60, "it is seen")
    page.keyboard.press("Escape")
    expect(surface).to_have_attribute("data-tool", "")
    assert not watched.errors
