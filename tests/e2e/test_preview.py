"""Tests that an uploaded scene is drawn as a mesh until path-traced samples arrive, and rotates as the live view does."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, Route, expect

from tests.e2e.conftest import Watched
from tests.e2e.small_glb import small_glb
from tests.helpers import Farm, wait_until

# Counts the frames without the mesh, after the first with it.
WATCH_MESH = """(() => {
  window.framesWithoutMesh = 0;
  let isSeen = false;
  const look = () => {
    const meshes = [...document.querySelectorAll(".live-view canvas.mesh")];
    const isShown = meshes.some((canvas) => canvas.dataset.drawn && !canvas.hidden);
    isSeen ||= isShown;
    if (isSeen && !isShown) window.framesWithoutMesh++;
    requestAnimationFrame(look);
  };
  look();
})()"""


def live_view_pixels(page: Page) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(page.locator(".live-view").screenshot())).convert("RGB")).astype(int)


@pytest.mark.long  # test_page.py tests the first picture
def test_preview_mesh_is_shown_until_samples_arrive(farm: Farm, watched: Watched) -> None:
    page = watched.page
    page.set_viewport_size({"width": 800, "height": 480})
    page.route_web_socket("**/viewport", lambda socket: None)  # keeps samples from arriving
    held: list[Route] = []
    page.route("**/js/views/jobs.js", lambda route: held.append(route))
    page.add_init_script(WATCH_MESH)
    page.goto(farm.url)
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose files").click()
    chooser.value.set_files([{"name": "cube.glb", "mimeType": "model/gltf-binary", "buffer": small_glb("preview")}])
    expect(page.get_by_role("button", name="Render", exact=True)).to_be_visible(timeout=90_000)
    mesh = page.locator(".live-view canvas.mesh")
    expect(mesh).to_be_visible()
    assert page.evaluate("framesWithoutMesh") == 0, "the live view takes the canvas of the scene that was prepared"
    expect(mesh).to_have_attribute("data-drawn", "16")  # triangles of a cube, a floor and a lamp
    first = live_view_pixels(page)
    red = (first[..., 0] > 2 * first[..., 1]) & (first[..., 0] > 60)
    assert 0.01 < red.mean() < 0.6, "the red cube"

    box = page.locator(".live-view").bounding_box()
    assert box
    page.mouse.move(box["x"] + 100, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 220, box["y"] + 120, steps=4)
    page.mouse.up()
    wait_until(lambda: np.abs(live_view_pixels(page) - first).mean() > 2, 20, "the mesh turns")

    page.get_by_role("link", name="Jobs").first.click()
    expect(page.locator("main")).to_have_attribute("aria-busy", "true")
    expect(page.locator(".scene-page.workspace canvas.mesh")).to_be_visible()  # whole, until the next view is loaded
    wait_until(lambda: bool(held), 20, "the module is requested")
    for route in held:
        route.continue_()
    expect(page.get_by_role("heading", name="Jobs")).to_be_visible()
    assert watched.errors == []


@pytest.mark.long
def test_file_that_needs_blender_says_what_to_do(farm: Farm, watched: Watched) -> None:
    page = watched.page
    page.goto(farm.url)
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose files").click()
    blend = b"BLENDER-v402" + bytes(64)
    chooser.value.set_files([{"name": "room.blend", "mimeType": "application/octet-stream", "buffer": blend}])
    notice = page.locator(".live-view-frame .empty")
    expect(notice).to_contain_text("This file needs Blender")
    expect(notice).to_contain_text("farm.py up --blender")
    expect(page.locator(".preparing-panel > p")).to_have_text("Waits for a worker with Blender …")
    expect(page.locator(".view-pills > p")).to_be_hidden()
    page.request.delete(f"{farm.url}/api/scenes/{page.url.partition('/scenes/')[2].partition('?')[0]}")
    assert watched.errors == []
