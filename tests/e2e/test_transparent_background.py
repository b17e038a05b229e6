"""Tests of a transparent background in the browser: its switch, the checkerboard behind the picture, and saved files."""

from __future__ import annotations

import io
import re
from pathlib import Path

import httpx
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import expect

from renderer.image import rgbe9995, tonemap
from tests.e2e.conftest import Watched
from tests.e2e.screen import assert_screen, read_exr
from tests.helpers import Farm, wait_until

WIDTH, HEIGHT = 96, 64
SQUARE, DARK, BRIGHT = 8, 0.34, 0.46  # web/js/film/film-shader.js
SCENE = f"""
settings: {{width: {WIDTH}, height: {HEIGHT}, spp: 16}}
cameras: [{{eye: [0, 1.2, 4], target: [0, 0.5, 0], fov: 45}}]
environment: {{color: 0.5}}
materials: {{red: {{color: [0.8, 0.2, 0.1]}}, veil: {{color: 0.6, opacity: 0.5}}}}
shapes:
  - {{type: sphere, material: red, radius: 0.5, center: [-0.6, 0.5, 0]}}
  - {{type: sphere, material: veil, radius: 0.5, center: [0.6, 0.5, 0]}}
"""


def before_squares(colour: np.ndarray, alpha: np.ndarray, x: float, y: float) -> np.ndarray:
    """Returns the pixels of a picture before the checkerboard. x, y: its corner on the stage, in pixels."""
    rgb = rgbe9995.unpack(rgbe9995.pack(colour))
    shown = tonemap.apply_straight(rgb, alpha, 0, "neutral")[..., :3].astype(float)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    odd = ((columns + x + 0.5) // SQUARE + (rows + y + 0.5) // SQUARE) % 2
    behind = np.where(odd == 0, BRIGHT, DARK)[..., None] * 255
    return np.rint(behind + (shown - behind) * alpha[..., None]).astype(int)


@pytest.mark.long
def test_a_transparent_picture_lies_on_a_checkerboard_and_is_saved_with_alpha(
    farm: Farm, watched: Watched, tmp_path: Path
) -> None:
    with farm.client() as client:
        posted = httpx.post(f"{farm.url}/api/scenes", files={"files": ("balls.yaml", SCENE)}).raise_for_status()
        scene = client.wait_for_scene(posted.json()["id"]).id
        page = watched.page
        page.goto(f"{farm.url}/#/scenes/{scene}")
        page.get_by_text("Advanced", exact=True).click()
        page.get_by_label("Transparent background").check()
        page.get_by_role("button", name="Render", exact=True).click()
        page.wait_for_url("**/#/jobs/*")
        job = page.url.rsplit("/", 1)[-1].partition("?")[0]
        wait_until(lambda: client.job(job).state == "finished", 180, "the job is finished")
    image = f"{farm.url}/api/jobs/{job}/frames/0/image"
    colour = read_exr(f"{image}.exr", tmp_path)
    (tmp_path / "alpha.png").write_bytes(httpx.get(f"{image}.png?aov=alpha").raise_for_status().content)
    alpha = np.asarray(Image.open(tmp_path / "alpha.png"))[..., 0].astype(np.float32) / 255
    assert {0.0, 1.0} < {*alpha.ravel().tolist()}, "some pixels are covered, some are not, and some in part"

    page.goto(f"{farm.url}/#/jobs/{job}")
    page.keyboard.press("1")
    page.mouse.move(5, 5)
    stage = page.locator(".stage")
    expect(stage).to_have_attribute("data-film", "here")
    expect(stage).to_have_attribute("data-view", re.compile("^1 "))
    _, x, y = (float(v) for v in (stage.get_attribute("data-view") or "").split())
    assert_screen(page, before_squares(colour, alpha, x, y), "the picture before the checkerboard")

    page.get_by_role("tab", name="Save").click()
    with page.expect_download() as download:
        page.get_by_role("link", name="PNG", exact=True).click()
    saved = Image.open(download.value.path())
    assert saved.mode == "RGBA"
    np.testing.assert_array_equal(np.asarray(saved)[..., 3], np.rint(alpha * 255))

    page.goto(f"{farm.url}/#/jobs")
    thumbnail = page.locator(f'.job-row img[src*="{job}"]')
    expect(thumbnail).to_have_attribute("src", re.compile(r"/image\.png\?"))
    expect(thumbnail).to_have_css("background-image", re.compile("conic-gradient"))

    page.goto(f"{farm.url}/#/scenes/{scene}?like={job}")
    view = page.locator(".live-view")
    expect(view).to_have_attribute("data-samples", re.compile("[1-9]"))
    box = view.bounding_box()
    assert box
    edge = page.screenshot(clip={"x": box["x"] + 4, "y": box["y"] + 0.4 * box["height"], "width": 32, "height": 32})
    values = np.asarray(Image.open(io.BytesIO(edge)).convert("RGB")).astype(int)
    squares = np.abs(values[..., None] - np.rint(255 * np.array([DARK, BRIGHT])))
    assert squares.min(-1).max() <= 1, "nothing is at the left edge of the live view"
    assert (squares <= 1).any((0, 1, 2)).all(), "it has squares of both kinds"
