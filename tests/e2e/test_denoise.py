"""Tests of the denoised picture on the page: it is shown beside the raw picture or in its place.

The film stays unchanged.
"""

from __future__ import annotations

import re
from pathlib import Path

import httpx
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import expect

from renderer.image import rgbe9995, tonemap
from tests.e2e.conftest import Watched
from tests.e2e.screen import assert_screen, expected_pixels, expected_split, read_exr, render_job
from tests.helpers import Farm

SIZE = {"width": 96, "height": 64}


@pytest.mark.long
def test_denoised_picture_is_shown_and_film_is_unchanged(farm: Farm, watched: Watched, tmp_path: Path) -> None:
    if not httpx.get(f"{farm.url}/api/info").json()["denoise"]:
        pytest.skip("no worker that can denoise: Open Image Denoise is not installed")
    scene = httpx.post(f"{farm.url}/api/examples/cornell-box").raise_for_status().json()["id"]
    job = render_job(farm, scene, **SIZE, spp=8)
    image = f"{farm.url}/api/jobs/{job}/frames/0/image"
    raw = read_exr(f"{image}.exr", tmp_path)
    words = np.frombuffer(httpx.get(f"{image}.rgb9e5?denoise=true", timeout=60).raise_for_status().content, "<u4")
    clean = rgbe9995.unpack(words.reshape(SIZE["height"], SIZE["width"]))
    pictures = [expected_pixels(raw, 0.5, "srgb"), tonemap.apply(clean, 0.5, "srgb").astype(int)]
    assert np.abs(pictures[0] - pictures[1]).mean() > 2, "the two differ, or this test says nothing"

    page = watched.page
    page.goto(f"{farm.url}/#/jobs/{job}?ev=0.5&tone=srgb")
    panel = page.get_by_label("Display", exact=True)
    panel.get_by_text("Split").click()
    expect(page.locator(".channel-tag.right")).to_have_text("Denoised")
    expect(page.locator(".channel-tag.left")).to_have_text("Raw")
    page.keyboard.press("1")
    page.mouse.move(5, 5)
    assert_screen(page, expected_split(*pictures, page), "beside")
    expect(page).to_have_url(re.compile("denoise=wipe"))

    panel.get_by_text("On", exact=True).click()
    assert_screen(page, pictures[1], "instead")
    panel.get_by_text("Off").click()
    assert_screen(page, pictures[0], "off again")

    # Both can be downloaded.
    page.get_by_role("tab", name="Save").click()
    page.get_by_role("switch", name="Denoised").check()
    with page.expect_download() as download:
        page.get_by_role("link", name="PNG, denoised").click()
    assert download.value.suggested_filename.endswith("-denoised.png")
    png = np.asarray(Image.open(download.value.path()).convert("RGB")).astype(int)
    assert np.abs(png - pictures[1]).max() <= 2  # the page has it as RGB9E5
    page.get_by_role("switch", name="Denoised").uncheck()
    with page.expect_download() as download:
        page.get_by_role("link", name="PNG", exact=True).click()
    np.testing.assert_array_equal(np.asarray(Image.open(download.value.path()).convert("RGB")), tonemap.apply(raw, 0.5, "srgb"))

    # A page opened on the denoised picture receives it before the film's tiles, which do not count as new samples.
    with page.expect_response(lambda response: "rgb9e5" in response.url):
        page.goto("about:blank")
        page.goto(f"{farm.url}/#/jobs/{job}?ev=0.5&tone=srgb&denoise=on")
    expect(page.locator(".channel-tag.right")).to_have_text("Denoised")
    page.keyboard.press("1")
    page.mouse.move(5, 5)
    assert_screen(page, pictures[1], "opened anew")
    expect(page.get_by_text("New samples have come")).to_be_hidden()

    # With more samples it is made again when the job finishes, even if the page misses all events in between.
    with page.expect_response(lambda response: "rgb9e5" in response.url, timeout=60_000):
        httpx.patch(f"{farm.url}/api/jobs/{job}", json={"spp": 32}).raise_for_status()
    assert watched.errors == []


def test_job_with_denoise_is_shown_and_saved_denoised(farm: Farm, watched: Watched) -> None:
    if not httpx.get(f"{farm.url}/api/info").json()["denoise"]:
        pytest.skip("no worker that can denoise: Open Image Denoise is not installed")
    scene = httpx.post(f"{farm.url}/api/examples/cornell-box").raise_for_status().json()["id"]
    page = watched.page
    page.add_init_script("try { localStorage['rayfarm-view-denoise'] = 'on'; } catch { /* no origin */ }")
    page.goto(f"{farm.url}/#/scenes/{scene}")
    page.get_by_role("spinbutton", name="Width", exact=True).fill("96")
    page.get_by_role("spinbutton", name="Height", exact=True).fill("64")
    page.get_by_role("radiogroup", name="Quality").get_by_text("Custom").click()
    page.get_by_label("Samples per pixel").fill("8")
    expect(page.get_by_role("switch", name="Denoise")).to_be_checked()  # as the live view is
    with page.expect_request(lambda request: request.method == "POST" and request.url.endswith("/api/jobs")) as sent:
        page.get_by_role("button", name="Render").click()
    assert sent.value.post_data_json["denoise"] is True
    expect(page.locator(".channel-tag.right")).to_have_text("Denoised", timeout=120_000)
    with page.expect_download(timeout=120_000) as download:
        page.get_by_role("button", name="Save", exact=True).click()
    assert download.value.suggested_filename == "Cornell-box-8spp-denoised.png"
    page.get_by_role("tab", name="Save").click()
    expect(page.get_by_role("switch", name="Denoised")).to_be_checked()
    expect(page.get_by_role("link", name="PNG, denoised")).to_be_visible()
    assert watched.errors == []
