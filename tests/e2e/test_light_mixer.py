"""Tests of the light mixer: a finished picture, relit on the page from the planes of its light groups, and saved so."""

from __future__ import annotations

import re
from pathlib import Path

import httpx
import numpy as np
import OpenImageIO
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from renderer.image import rgbe9995, tonemap
from tests.e2e.conftest import Watched
from tests.e2e.screen import assert_screen, expected_pixels, read_exr, render_job
from tests.helpers import Farm

SIZE = {"width": 96, "height": 64}
SCENE = """
cameras: [{eye: [0, 1.2, 4], target: [0, 0.5, 0], fov: 45}]
environment: {color: 0.02}
lights:
  - {type: spot, position: [-2, 3, 2], target: [0, 0.5, 0], intensity: [40, 30, 20], light_group: key}
  - {type: point, position: [2, 2, 1], intensity: [4, 6, 12], light_group: fill}
materials: {grey: {color: 0.7}, red: {color: [0.8, 0.2, 0.1]}}
shapes:
  - {type: sphere, material: red, radius: 0.5, center: [0, 0.5, 0]}
  - {type: quad, material: grey, transform: [{scale: 4}, {rotate: {axis: x, degrees: -90}}]}
"""


@pytest.fixture(scope="module")
def lit(farm: Farm) -> str:
    """Returns the id of a finished job with two light groups."""
    files = {"files": ("room.yaml", SCENE)}
    scene = httpx.post(f"{farm.url}/api/scenes", files=files).raise_for_status().json()["id"]
    with farm.client() as client:
        client.wait_for_scene(scene)
    return render_job(farm, scene, **SIZE, spp=16, light_groups="key,fill")


def plane(image: str, group: str, denoise: bool = False) -> np.ndarray:
    """Returns the plane of a light group as the page gets it, (h, w, 3) float32."""
    query = {"aov": f"light:{group}", "denoise": denoise}
    words = np.frombuffer(httpx.get(f"{image}.rgb9e5", params=query).raise_for_status().content, "<u4")
    return rgbe9995.unpack(words.reshape(SIZE["height"], SIZE["width"]))


def saved(page: Page, name: str) -> Path:
    """Saves the picture by the Save tab, and returns the file. name: of the format's button."""
    page.get_by_role("tab", name="Save").click()
    with page.expect_download() as download:
        page.get_by_role("link", name=name, exact=True).click()
    assert "-mix" in download.value.suggested_filename
    page.get_by_role("tab", name="Lights").click()
    return download.value.path()


@pytest.mark.long
def test_muted_groups_leave_the_others_and_the_mix_is_saved(farm: Farm, lit: str, watched: Watched, tmp_path: Path) -> None:
    image = f"{farm.url}/api/jobs/{lit}/frames/0/image"
    colour = read_exr(f"{image}.exr", tmp_path)
    planes = {group: plane(image, group) for group in ("key", "fill", "rest")}
    only_fill = planes["fill"] + planes["rest"]
    wanted = {"all": expected_pixels(colour, 0, "srgb"), "fill": expected_pixels(only_fill, 0, "srgb")}
    assert np.abs(wanted["all"] - wanted["fill"]).mean() > 5, "the key light is visible, or this test says nothing"

    page = watched.page
    page.goto(f"{farm.url}/#/jobs/{lit}?tone=srgb")
    page.get_by_role("tab", name="Lights").click()
    page.keyboard.press("1")
    page.mouse.move(5, 5)
    assert_screen(page, wanted["all"], "all groups")
    page.get_by_role("button", name="Mute: key").click()
    expect(page.locator(".channel-tag.left")).to_have_text("Light mix")
    tag = page.locator(".channel-tag.left").bounding_box()
    assert tag
    wanted["fill"][: int(tag["height"]) + 20, : int(tag["width"]) + 20] = -1  # may lie on the picture
    assert_screen(page, wanted["fill"], "without the key light")
    expect(page).to_have_url(re.compile(r"mix=key%3A%3A%3Am|mix=key:::m"))

    # Saved files are made by the service from the exact sums.
    png = np.asarray(Image.open(saved(page, "PNG")).convert("RGB")).astype(int)
    exact = read_exr(f"{image}.exr?aov=light:fill", tmp_path) + read_exr(f"{image}.exr?aov=light:rest", tmp_path)
    assert np.abs(png - tonemap.apply(exact, 0, "srgb").astype(int)).max() <= 1
    source = OpenImageIO.ImageInput.open(str(saved(page, "EXR")))
    assert source, OpenImageIO.geterror()
    assert np.allclose(source.read_image(0, 0, 0, 3, OpenImageIO.FLOAT), exact, rtol=1e-6, atol=1e-7)

    # By keyboard: two stops up, solo; the pixel's exact values follow.
    page.get_by_role("button", name="Reset", exact=True).click()
    assert_screen(page, wanted["all"], "reset")
    slider = page.get_by_role("slider", name="Gain of fill")
    slider.focus()
    for _ in range(20):
        page.keyboard.press("ArrowRight")
    page.keyboard.press("s")
    expect(page.get_by_role("button", name="Solo: fill")).to_have_attribute("aria-pressed", "true")
    louder = expected_pixels(4 * planes["fill"], 0, "srgb")
    louder[: int(tag["height"]) + 20, : int(tag["width"]) + 20] = -1
    assert_screen(page, louder, "the fill light alone, two stops up")

    # The link has the mix.
    expect(page).to_have_url(re.compile(r"mix=fill%3A2%3A%3As|mix=fill:2::s"))
    page.reload()
    page.get_by_role("tab", name="Lights").click()
    expect(page.get_by_role("button", name="Solo: fill")).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("1")
    page.mouse.move(5, 5)
    assert_screen(page, louder, "by its link")
    assert watched.errors == []


@pytest.mark.long
def test_tab_is_offered_only_with_lights_to_mix(farm: Farm, lit: str, watched: Watched) -> None:
    """A scene without lights has no tab Lights; one chosen before is shown again for a picture that has it."""
    text = "cameras: [{eye: [0, 0, 4], target: [0, 0, 0]}]\nshapes: [{type: sphere}]\n"
    scene = httpx.post(f"{farm.url}/api/scenes", files={"files": ("ball.yaml", text)}).raise_for_status().json()["id"]
    with farm.client() as client:
        client.wait_for_scene(scene)
    assert httpx.get(f"{farm.url}/api/scenes/{scene}").raise_for_status().json()["light_groups"] == []
    job = render_job(farm, scene, **SIZE, spp=2)
    page = watched.page
    page.goto(f"{farm.url}/#/jobs/{lit}")
    lights = page.get_by_role("tab", name="Lights")
    lights.click()
    page.evaluate("(job) => (location.hash = `#/jobs/${job}`)", job)
    expect(page.locator(".stage")).to_have_attribute("data-film", "here")
    expect(page.get_by_role("tab", name="View")).to_have_attribute("aria-selected", "true")
    expect(lights).to_be_hidden()
    page.get_by_role("tab", name="View").press("ArrowRight")
    expect(page.get_by_role("tab", name="Notes")).to_be_focused()
    page.goto(f"{farm.url}/#/jobs/{job}")
    page.reload()
    expect(page.get_by_role("tab", name="Info")).to_be_visible()
    page.get_by_role("tab", name="Info").click()
    expect(page.get_by_role("definition").filter(has_text="ball")).to_be_visible()  # the scenes are listed
    expect(lights).to_be_hidden()
    assert watched.errors == []


@pytest.mark.long
def test_a_mix_is_shown_and_saved_denoised(farm: Farm, lit: str, watched: Watched, tmp_path: Path) -> None:
    """Each light group is denoised once, and mixed without its noise; what is saved is what is shown."""
    if not httpx.get(f"{farm.url}/api/info").json()["denoise"]:
        pytest.skip("no worker that can denoise: Open Image Denoise is not installed")
    image = f"{farm.url}/api/jobs/{lit}/frames/0/image"
    clean = {group: read_exr(f"{image}.exr?aov=light:{group}&denoise=true", tmp_path) for group in ("key", "fill", "rest")}
    raw = read_exr(f"{image}.exr?aov=light:fill", tmp_path)
    assert np.abs(np.diff(clean["fill"], axis=1)).mean() < 0.7 * np.abs(np.diff(raw, axis=1)).mean(), "it has less noise"
    wanted = 4 * clean["fill"] + clean["rest"]
    mixed = read_exr(f"{image}.exr?mix=key:0,fill:4&denoise=true", tmp_path)
    assert np.allclose(mixed, wanted, rtol=1e-5, atol=1e-6)
    refused = httpx.get(f"{image}.exr", params={"mix": "key:0", "denoise": True, "in_shot": True})
    assert (refused.status_code, refused.json()["code"]) == (422, "in-shot-without-lights")

    page = watched.page
    page.goto(f"{farm.url}/#/jobs/{lit}?tone=srgb&denoise=on&mix=key:::m,fill:2")
    expect(page.locator(".channel-tag.right")).to_have_text("Light mix, denoised", timeout=120_000)
    page.keyboard.press("1")
    page.mouse.move(5, 5)
    shown = expected_pixels(4 * plane(image, "fill", denoise=True) + plane(image, "rest", denoise=True), 0, "srgb")
    tag = page.locator(".channel-tag.right").bounding_box()
    assert tag
    shown[: int(tag["height"]) + 20, : int(tag["width"]) + 20] = -1  # may lie on the picture
    assert_screen(page, shown, "denoised and mixed")
    page.get_by_role("tab", name="Save").click()
    with page.expect_download() as download:
        page.get_by_role("link", name="PNG, denoised", exact=True).click()
    assert download.value.suggested_filename.endswith("-mix-denoised.png")
    assert watched.errors == []


@pytest.mark.long
def test_a_mix_of_gains_1_has_the_bits_of_the_colour(farm: Farm, lit: str, tmp_path: Path) -> None:
    image = f"{farm.url}/api/jobs/{lit}/frames/0/image.exr"
    colour = read_exr(image, tmp_path)
    assert colour.any()
    assert np.array_equal(read_exr(f"{image}?mix=key:1", tmp_path), colour)
    doubled = read_exr(f"{image}?mix=key:2,fill:2/2/2,rest:2", tmp_path)
    assert np.array_equal(doubled, 2 * colour)
    for mix, code in [
        ("window:1", "mix-group-unknown"),
        ("key:-1", "mix-gain-invalid"),
        ("key:1/2", "mix-gain-invalid"),
        ("key", "mix-gain-invalid"),
    ]:
        refused = httpx.get(image, params={"mix": mix})
        assert (refused.status_code, refused.json()["code"]) == (422, code), mix
    refused = httpx.get(image, params={"mix": "key:1", "aov": "normal"})
    assert (refused.status_code, refused.json()["code"]) == (422, "mix-only-colour")


@pytest.mark.long
def test_picture_without_groups_is_rendered_again_with_a_group_per_lamp(farm: Farm, watched: Watched) -> None:
    text = SCENE.replace(", light_group: key", "").replace(", light_group: fill", "")
    scene = httpx.post(f"{farm.url}/api/scenes", files={"files": ("lamps.yaml", text)}).raise_for_status().json()["id"]
    with farm.client() as client:
        client.wait_for_scene(scene)
    job = render_job(farm, scene, **SIZE, spp=4, max_depth=3)
    page = watched.page
    page.goto(f"{farm.url}/#/jobs/{job}")
    page.get_by_role("tab", name="Lights").click()
    page.get_by_role("button", name="Render again to mix").click()
    expect(page).not_to_have_url(re.compile(job))
    for name in ("Environment", "light 0", "light 1", "All others"):
        expect(page.get_by_role("button", name=f"Mute: {name}")).to_be_visible()
    again = httpx.get(f"{farm.url}/api/jobs/{page.url.rsplit('/', 1)[1].split('?')[0]}").raise_for_status().json()
    assert again["settings"]["light_groups"] == "environment,light 0,light 1"
    assert (again["spp"], again["width"], again["settings"]["max_depth"]) == (4, 96, 3)
    assert watched.errors == []
