"""Tests of environment light on a scene's page: selected, dropped, rendered and displayed, without creating another scene."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from playwright.sync_api import Page, expect

from tests.e2e.conftest import Watched
from tests.helpers import Farm, wait_until

SCENE = b"""
shapes:
  - {type: sphere, center: [0, 0.5, 0], radius: 0.5}
  - {type: cube}
"""


@pytest.fixture(scope="module")
def scene(farm: Farm) -> dict[str, Any]:
    sent = {"files": ("lit.yaml", SCENE)}
    found = httpx.post(f"{farm.url}/api/scenes", files=sent, timeout=60).raise_for_status().json()
    wait_until(lambda: httpx.get(f"{farm.url}/api/scenes/{found['id']}").json()["status"] == "ready", 300, "the scene is ready")
    return dict(found)


def hdri(path: Path) -> bytes:
    pixels = np.full((16, 32, 3), 0.5, np.float32)
    pixels[4, 8] = 40
    file = oiio.ImageOutput.create(str(path))
    file.open(str(path), oiio.ImageSpec(32, 16, 3, "half"))
    file.write_image(pixels)
    file.close()
    return path.read_bytes()


def drop(page: Page, name: str, content: bytes) -> None:
    page.evaluate(
        """([name, text]) => {
            const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
            const transfer = new DataTransfer();
            transfer.items.add(new File([bytes], name));
            dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true }));
        }""",
        [name, base64.b64encode(content).decode()],
    )


def render(page: Page) -> None:
    for fields in ("Size", "Quality"):
        page.get_by_role("radiogroup", name=fields).get_by_text("Custom").click()
    page.get_by_role("spinbutton", name="Width").fill("32")
    page.get_by_label("Height", exact=True).fill("32")
    page.get_by_label("Samples per pixel").fill("4")
    page.get_by_role("button", name="Render", exact=True).click()
    expect(page.locator(".job-page")).to_be_visible()


@pytest.mark.long
def test_scene_uses_selected_and_dropped_environment(watched: Watched, farm: Farm, scene: dict[str, Any], tmp_path: Path) -> None:
    page = watched.page
    before = len(httpx.get(f"{farm.url}/api/scenes").json())
    page.goto(f"{farm.url}/#/scenes/{scene['id']}")
    page.get_by_role("group", name="Light", exact=True).get_by_role("button", name="More").click()
    page.get_by_role("radio", name="Low sun").check(force=True)
    dial = page.get_by_role("slider", name="Sun position")
    expect(dial).to_have_attribute("aria-valuetext", "8° high, direction 110°")
    dial.evaluate("element => element.scrollIntoView({ block: 'center' })")
    box = dial.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] * 0.25)
    expect(page.get_by_role("radio", name="Clear sky")).to_be_checked()
    assert page.get_by_label("Sun's direction").input_value() == "0"
    page.get_by_label("Strength", exact=True).fill("2")
    render(page)
    expect(page.locator(".facts")).to_contain_text("Clear sky, sun at 3")
    expect(page.locator(".facts")).to_contain_text("° elevation, 0°, strength 2")
    page.get_by_role("tab", name="Info").click()
    page.get_by_role("link", name="Render with other settings").click()
    expect(page.get_by_role("radio", name="Clear sky")).to_be_checked()

    drop(page, "window.exr", hdri(tmp_path / "window.exr"))
    expect(page.get_by_role("radio", name="window")).to_be_checked()
    render(page)
    expect(page.locator(".facts")).to_contain_text("window.exr")
    assert len(httpx.get(f"{farm.url}/api/scenes").json()) == before, "light makes no other scene"
    jobs = httpx.get(f"{farm.url}/api/jobs", params={"scene": scene["id"]}).json()
    assert [job["environment"].get("name") for job in jobs] == ["window.exr", None]
    assert not watched.errors


@pytest.mark.long
def test_image_dropped_on_the_home_page_lights_the_last_scene(
    watched: Watched, farm: Farm, scene: dict[str, Any], tmp_path: Path
) -> None:
    page = watched.page
    page.goto(farm.url)  # the newest scene is listed first
    expect(page.get_by_role("heading").first).to_be_visible()
    name = scene["name"]
    drop(page, "porch.exr", hdri(tmp_path / "porch.exr"))
    page.get_by_role("button", name=f"Light “{name}” with it").click()
    expect(page.get_by_role("radio", name="porch")).to_be_checked(timeout=30_000)
    row = page.locator(".lights .face:visible")
    assert len({round(box["y"]) for each in row.all() if (box := each.bounding_box())}) == 1
    shown = page.locator(".lights .name:visible").all_text_contents()
    assert shown[1:] == ["Studio", "Overcast", "Clear sky", "porch"], "the chosen image takes no other light's place"
    assert not watched.errors


@pytest.mark.long
def test_dropped_image_can_be_added_as_environment(watched: Watched, farm: Farm, tmp_path: Path) -> None:
    page = watched.page
    page.goto(farm.url)
    expect(page.get_by_role("heading").first).to_be_visible()
    drop(page, "bare.png", b"png")
    expect(page.get_by_role("alert")).to_contain_text("light it")
    page.get_by_role("button", name="Dismiss").click()
    drop(page, "lamp.exr", hdri(tmp_path / "lamp.exr"))
    page.get_by_role("button", name="Add it to the lights").click()
    listed = f"{farm.url}/api/environments"
    wait_until(lambda: any(each["kind"] == "image" for each in httpx.get(listed).json()), 30, "it is kept")
    image = next(each for each in httpx.get(listed).json() if each["kind"] == "image")
    assert httpx.get(farm.url + image["thumbnail"]).headers["content-type"] == "image/jpeg"
    for each in httpx.get(listed).json():
        assert httpx.get(farm.url + each["thumbnail"]).status_code == 200
