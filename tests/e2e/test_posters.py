"""Tests of the first picture of a scene that is opened again: as sharp and as bright as the view becomes."""

from __future__ import annotations

import io

import httpx
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, BrowserContext, Page, expect

from renderer.denoise import is_available
from tests.e2e.small_glb import small_glb
from tests.helpers import Farm, wait_until

SIZE = {"width": 1280, "height": 720}
CLEAN = "try { localStorage['rayfarm-view-noise'] ??= '0.02'; } catch { /* a page without an origin */ }"
# Resolves once the page of the scene has painted its view's first picture, whatever that is. Until it is loaded, which takes
# a moment on a busy machine, the thumbnail behind it is seen.
FIRST = """() => new Promise((done) => {
    const look = async () => {
        const view = document.querySelector('.live-view');
        const shown = view?.style.backgroundImage || view?.querySelector('canvas.mesh:not([hidden])');
        if (!shown) return requestAnimationFrame(look);
        const url = view.style.backgroundImage;
        const [, first] = url.match(/url\\("(.*?)"\\)/) ?? [];
        if (first) await Object.assign(new Image(), { src: first }).decode().catch(() => {});
        requestAnimationFrame(() => requestAnimationFrame(() => done(url)));
    };
    look();
})"""

# The words over the view count the samples of the denoised picture that is shown; the view may have more.
SETTLED = """() => {
    const words = document.querySelector('.view-state')?.textContent ?? "";
    return parseInt(words) >= 16 && words.includes("denoised");
}"""


def pixels(page: Page) -> np.ndarray:
    """Returns the view's middle as it is on the page, (h, w) luminance: without the pills and tools over its edges."""
    picture = Image.open(io.BytesIO(page.locator(".live-view").screenshot(animations="disabled"))).convert("L")
    values = np.asarray(picture, np.float64)
    height, width = values.shape
    return values[height // 5 : -height // 5, width // 6 : -width // 6]


def sharpness(picture: np.ndarray) -> float:
    """Returns the energy of the picture's Laplacian."""
    middle = picture[1:-1, 1:-1]
    laplacian = picture[:-2, 1:-1] + picture[2:, 1:-1] + picture[1:-1, :-2] + picture[1:-1, 2:] - 4 * middle
    return float((laplacian**2).mean())


def poster_width(url: str, scene: str) -> int:
    """Returns the width of a scene's poster; 0: it has none."""
    poster = httpx.get(f"{url}/api/scenes/{scene}").raise_for_status().json()["poster"]
    return 0 if poster is None else Image.open(io.BytesIO(httpx.get(f"{url}{poster}").raise_for_status().content)).width


def new_page(context: BrowserContext, url: str) -> Page:
    page = context.new_page()
    page.goto(f"{url}/#/")
    expect(page.locator(".card a.name").first).to_be_visible()
    page.wait_for_load_state("networkidle")
    return page


def open_from_card(page: Page, scene: str) -> None:
    page.locator(f'.card a.name[href$="{scene}"]').click(no_wait_after=True)


@pytest.mark.long
@pytest.mark.skipif(not is_available(), reason="views are not denoised without Open Image Denoise")
@pytest.mark.parametrize("example", [None, "spheres"])
def test_first_picture_of_reopened_scene_is_what_the_view_becomes(farm: Farm, browser: Browser, example: str | None) -> None:
    if example is None:
        file = {"files": ("cube.glb", small_glb("posters"), "model/gltf-binary")}
        answer = httpx.post(f"{farm.url}/api/scenes", files=file, data={"floor": "auto"})
    else:
        answer = httpx.post(f"{farm.url}/api/examples/{example}")
    scene = answer.raise_for_status().json()["id"]
    with farm.client() as client:
        client.wait_for_scene(scene)
    context = browser.new_context(viewport=SIZE, device_scale_factor=1)  # type: ignore[arg-type]
    context.add_init_script(CLEAN)
    page = new_page(context, farm.url)
    open_from_card(page, scene)
    wait_until(lambda: page.evaluate(SETTLED), 240, "the view is clear")
    box = page.locator(".live-view").bounding_box()
    assert box
    # Another test may have opened the example in a smaller page, and left a smaller poster.
    wait_until(lambda: poster_width(farm.url, scene) >= 0.9 * box["width"], 60, "the scene has a poster of this view")
    page.locator("canvas.mesh").wait_for(state="hidden")
    page.wait_for_timeout(1000)
    settled = pixels(page)
    context.close()

    context = browser.new_context(viewport=SIZE, device_scale_factor=1)  # type: ignore[arg-type]
    context.add_init_script(CLEAN)
    page = new_page(context, farm.url)  # of a browser that has seen nothing before
    open_from_card(page, scene)
    shown = page.evaluate(FIRST)
    assert (f"api/scenes/{scene}/poster.jpg" if example is None else f"examples/{example}.jpg") in shown
    first = pixels(page)
    assert first.shape == settled.shape, "no other size"
    assert abs(first - settled).mean() < 3, "neither brightness nor framing jumps"
    assert 0.5 < sharpness(first) / sharpness(settled) < 2, "as sharp as the view"
    small = np.asarray(Image.fromarray(settled.astype(np.uint8)).resize((170, 90)).resize(settled.shape[::-1]), np.float64)
    assert sharpness(small) < 0.4 * sharpness(settled), "a thumbnail would not be"
    assert page.locator(".live-view canvas.mesh:not([hidden])").count() == 0
    if example is not None:
        page = context.new_page()
        page.goto(f"{farm.url}/#/scenes/{scene}")  # the poster, of fewer samples, does not replace the shipped picture
        assert f"examples/{example}.jpg" in page.evaluate(FIRST)
    context.close()
