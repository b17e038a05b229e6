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
from playwright.sync_api import Browser, Route, expect

from renderer.image import rgbe9995, tonemap
from tests.e2e.conftest import Watched
from tests.e2e.screen import assert_screen, expected_pixels, expected_split, read_exr, render_job
from tests.helpers import Farm, wait_until

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
    expect(page.locator("#tray")).to_contain_text(f"Saved: {download.value.suggested_filename}")
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
    assert re.fullmatch(r"Cornell-box(-\d+)?-8spp-denoised\.png", download.value.suggested_filename)
    page.get_by_role("tab", name="Save").click()
    expect(page.get_by_role("switch", name="Denoised")).to_be_checked()
    expect(page.get_by_role("link", name="PNG, denoised")).to_be_visible()
    assert watched.errors == []


@pytest.mark.long
def test_job_is_finishing_until_its_last_picture_is_denoised(farm: Farm, watched: Watched) -> None:
    if not httpx.get(f"{farm.url}/api/info").json()["denoise"]:
        pytest.skip("no worker that can denoise: Open Image Denoise is not installed")
    scene = httpx.post(f"{farm.url}/api/examples/cornell-box").raise_for_status().json()["id"]
    page, held = watched.page, list[Route]()
    last = re.compile(r"image\.(rgb9e5|png).*denoise=true(?!.*preview=true)")

    def hold(route: Route) -> None:  # as if the denoiser needed time
        held.append(route)

    page.route(last, hold)
    page.goto(f"{farm.url}/#/jobs")
    page.get_by_role("heading", name="Jobs").wait_for()
    request = {"scene": scene, **SIZE, "spp": 8, "denoise": True}
    job = httpx.post(f"{farm.url}/api/jobs", json=request).raise_for_status().json()["id"]
    with page.expect_request(last, timeout=60_000):
        page.goto(f"{farm.url}/#/jobs/{job}")
    state, line = page.locator(".job-head .chip").first, page.get_by_role("progressbar", name="Progress")
    expect(state).to_have_text("Finishing")
    assert int(line.get_attribute("aria-valuenow") or "100") < 100
    page.get_by_role("button", name="Save", exact=True).click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Save without denoising").click()
    assert re.fullmatch(r"Cornell-box(-\d+)?-8spp\.png", download.value.suggested_filename)
    expect(page.locator("a[aria-busy]")).to_have_count(0)  # the denoised one is not awaited any more
    expect(state).to_have_text("Finishing")
    page.on("download", lambda later: pytest.fail(f"saved twice: {later.suggested_filename}"))
    while held:
        held.pop().continue_()
    page.unroute(last, hold)
    expect(state).to_have_text("Finished", timeout=60_000)
    expect(page.locator(".channel-tag.right")).to_have_text("Denoised")
    assert watched.errors == []


@pytest.mark.long
def test_job_that_ended_earlier_stays_finished_while_it_is_denoised(farm: Farm, watched: Watched) -> None:
    if not httpx.get(f"{farm.url}/api/info").json()["denoise"]:
        pytest.skip("no worker that can denoise: Open Image Denoise is not installed")
    scene = httpx.post(f"{farm.url}/api/examples/cornell-box").raise_for_status().json()["id"]
    request = {"scene": scene, **SIZE, "spp": 8, "denoise": True}
    url = f"{farm.url}/api/jobs/{httpx.post(f'{farm.url}/api/jobs', json=request).raise_for_status().json()['id']}"
    wait_until(lambda: httpx.get(url).json()["state"] == "finished", 60, "it has finished")
    page = watched.page
    page.add_init_script("""
        const now = Date.now;
        Date.now = () => now() + 3_600_000; // an hour later
        window.states = [];
        const look = () => {
            const chip = document.querySelector(".job-head .chip");
            if (chip && window.states.at(-1) !== chip.textContent) window.states.push(chip.textContent);
            requestAnimationFrame(look);
        };
        requestAnimationFrame(look);""")
    page.goto(url.replace("/api", "/#"))
    expect(page.locator(".channel-tag.right")).to_have_text("Denoised", timeout=60_000)
    assert page.evaluate("window.states") == ["Finished"]
    assert watched.errors == []


# Creates a job as the scene's page does, which hands it a picture of another light, and opens the job's page.
BEGIN = """async (request) => {
    const main = performance.getEntriesByType("resource").map(({ name }) => name).find((name) => name.endsWith("/js/main.js"));
    const read = (path) => import(main.replace("main.js", path));
    const [{ createJob }, { keepFirstLook, prepareLook }, { adoptJob }, { Film }] =
        await Promise.all(["news/api.js", "film/first-look.js", "news/farm.js", "film/film.js"].map(read));
    const job = await createJob(request, "once");
    const look = { film: new Film(1, 1), isSame: true, clean: document.createElement("canvas").toDataURL(), worth: 0 };
    await prepareLook(look);
    keepFirstLook(job.id, look);
    adoptJob(job);
    location.hash = `/jobs/${job.id}`;
    return job.id;
}"""


@pytest.mark.long
def test_growing_picture_replaces_one_of_another_light(farm: Farm, watched: Watched) -> None:
    if not httpx.get(f"{farm.url}/api/info").json()["denoise"]:
        pytest.skip("no worker that can denoise: Open Image Denoise is not installed")
    scene = httpx.post(f"{farm.url}/api/examples/cornell-box").raise_for_status().json()["id"]
    with farm.client() as client:
        client.wait_for_scene(scene)
    page = watched.page
    page.goto(f"{farm.url}/#/jobs")
    page.get_by_role("heading", name="Jobs").wait_for()
    held: list[Route] = []
    denoised = re.compile("denoise=true")

    def hold(route: Route) -> None:  # as if the denoiser were busy
        held.append(route)

    page.route(denoised, hold)
    job = page.evaluate(BEGIN, {"scene": scene, **SIZE, "spp": 60_000, "denoise": True})
    try:
        tag = page.locator(".channel-tag.right")
        expect(tag).to_have_text(re.compile(r"^[\d,]+ samples?, not denoised yet$"), timeout=60_000)
        expect(page.locator(".stage")).to_have_attribute("data-film", "here")
        assert held, "a denoised one is asked for from the first samples on"
        while held:
            held.pop().continue_()
        page.unroute(denoised, hold)
        expect(tag).to_have_text("Denoised", timeout=60_000)  # the heading has another number of samples
        page.get_by_role("tab", name="View").click()
        expect(page.get_by_text(re.compile(r"^Made of the first ([\d,]+ samples|sample)$"))).to_be_visible()
    finally:
        httpx.patch(f"{farm.url}/api/jobs/{job}", json={"state": "cancelled"})
    assert watched.errors == []


@pytest.mark.long
def test_stored_denoised_picture_of_paused_job_is_shown_at_once(farm: Farm, watched: Watched, browser: Browser) -> None:
    if not httpx.get(f"{farm.url}/api/info").json()["denoise"]:
        pytest.skip("no worker that can denoise: Open Image Denoise is not installed")
    scene = httpx.post(f"{farm.url}/api/examples/cornell-box").raise_for_status().json()["id"]
    request = {"scene": scene, "width": 640, "height": 400, "spp": 60_000, "denoise": True}
    job = httpx.post(f"{farm.url}/api/jobs", json=request).raise_for_status().json()["id"]
    url = f"{farm.url}/api/jobs/{job}"
    wait_until(lambda: httpx.get(url).json()["samples"] > 640 * 400, 60, "it has samples")
    httpx.patch(url, json={"state": "paused"}).raise_for_status()
    assert httpx.get(url).json()["frames"][0]["denoised"] is False
    asked: list[str] = []
    page = watched.page
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"{farm.url}/#/jobs/{job}")
    expect(page.locator(".channel-tag.right")).to_have_text(re.compile("^Denoised"), timeout=60_000)
    assert not [each for each in asked if "wait=false" in each], "there was none to show at once"
    assert watched.errors == []

    page.goto("about:blank")
    assert httpx.get(url).json()["frames"][0]["denoised"] is True
    other = browser.new_page()
    other.route(re.compile("denoise=true(?!.*wait=false)"), lambda _: None)  # no worker denoises now
    other.goto(f"{farm.url}/#/jobs/{job}")
    expect(other.locator(".channel-tag.right")).to_have_text(re.compile("^Denoised"), timeout=30_000)
    expect(other.locator(".stage")).to_have_attribute("data-film", "here")
    other.close()
    httpx.delete(url).raise_for_status()
