"""Tests of the whole way from file to picture in a browser: a dropped file's displayed pixels equal the film's."""

from __future__ import annotations

import base64
import io
import re
from pathlib import Path

import httpx
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from renderer.image import tonemap
from tests.e2e.conftest import Watched
from tests.e2e.screen import assert_shows, read_exr
from tests.e2e.small_glb import small_glb
from tests.helpers import Farm

WIDTH, HEIGHT = 96, 64
ENDLESS_SPP = 60_000  # more samples than are rendered before the job is cancelled


def drop(page: Page, name: str, content: bytes) -> None:
    """Drops a file with this name and content on the page, as a user does with the mouse."""
    page.evaluate(
        """([name, base64]) => {
            const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
            const dataTransfer = new DataTransfer();
            dataTransfer.items.add(new File([bytes], name));
            for (const type of ["dragenter", "dragover", "drop"])
                document.body.dispatchEvent(new DragEvent(type, { dataTransfer, bubbles: true, cancelable: true }));
        }""",
        [name, base64.b64encode(content).decode()],
    )


def samples_shown(page: Page) -> int:
    """Returns the number of samples per pixel that the progress panel shows."""
    return int(page.get_by_label("Progress", exact=True).locator(".big").inner_text().replace(",", ""))


def test_dropped_file_is_rendered_and_pixels_equal_film(farm: Farm, watched: Watched, tmp_path: Path) -> None:
    """A dropped file is shown first as a preview of its mesh, then as a job's picture with the film's pixels.

    The picture stays when the job is cancelled.
    """
    page = watched.page
    page.set_viewport_size({"width": 800, "height": 480})  # smaller, since drawing takes most of the test's time
    page.route_web_socket("**/viewport", lambda socket: None)  # keeps path-traced samples from replacing the mesh
    page.goto(farm.url)
    expect(page.get_by_role("heading", name="Drop a scene anywhere")).to_be_visible()

    drop(page, "small.glb", small_glb("page"))
    render = page.get_by_role("button", name="Render")
    expect(render).to_be_visible()
    mesh = page.locator(".live-view canvas.mesh")
    expect(mesh).to_have_attribute("data-drawn", "16")  # triangles of a cube, a floor and a lamp
    preview = np.asarray(Image.open(io.BytesIO(page.locator(".live-view").screenshot())).convert("RGB")).astype(int)
    red = (preview[..., 0] > 2 * preview[..., 1]) & (preview[..., 0] > 60)
    assert 0.01 < red.mean() < 0.6, "the red cube"

    page.get_by_text("Custom").nth(1).click()
    page.get_by_label("Keep the aspect").uncheck()
    page.get_by_role("spinbutton", name="Width").fill(str(WIDTH))
    page.get_by_label("Height", exact=True).fill(str(HEIGHT))
    page.get_by_text("Custom").nth(2).click()
    page.get_by_label("Samples per pixel").fill(str(ENDLESS_SPP))
    render.click()

    # Samples arrive while the job renders. A cancelled job keeps its picture.
    expect(page.locator(".big")).to_have_text(re.compile("^[1-9]"), timeout=60_000)
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator(".job-page .chip:not(.verdict)")).to_contain_text("Cancelled")
    assert 1 <= samples_shown(page) < ENDLESS_SPP

    job = page.url.split("/jobs/")[1].split("?")[0]
    image = f"{farm.url}/api/jobs/{job}/frames/0/image"
    film = read_exr(f"{image}.exr", tmp_path)
    assert film.shape == (HEIGHT, WIDTH, 3) and film.max() > 1 > film.min()

    page.keyboard.press("1")
    page.mouse.move(5, 5)
    before = assert_shows(page, film, 0, "neutral")

    # The exposure key changes the picture at once.
    page.keyboard.press("Shift+E")
    darker = assert_shows(page, film, -0.5, "neutral")
    assert darker.mean() < before.mean() - 2
    page.get_by_label("Tone curve").select_option("hue")  # test_modules.py tests all curves
    assert_shows(page, film, -0.5, "hue")

    # The value under the cursor equals the film's.
    stage = page.locator(".stage")
    _, left, top = (float(v) for v in (stage.get_attribute("data-view") or "").split())
    stage.hover(position={"x": left + WIDTH / 2 + 0.5, "y": top + HEIGHT / 2 + 0.5})
    readout = page.get_by_label("Pixel under the cursor")
    expect(readout.locator(".values.exact")).to_be_visible()
    expect(readout.locator(".place")).to_have_text(f"{WIDTH // 2}, {HEIGHT // 2}")
    shown = [float(v) for v in readout.locator(".value").all_inner_texts()]
    np.testing.assert_allclose(shown, film[HEIGHT // 2, WIDTH // 2], rtol=1e-3, atol=1e-4)
    pixel = httpx.get(f"{image.removesuffix('image')}pixel?x={WIDTH // 2}&y={HEIGHT // 2}").raise_for_status().json()
    expect(readout).to_contain_text(f"{pixel['samples']:,} samples")

    # So do the values of planes, each of which shows another picture than the light.
    light = stage.screenshot()
    channels = page.get_by_label("Channel")
    for plane in ("albedo", "error"):
        channels.select_option(plane)
        expect(page.locator(".channel-tag.left")).to_have_text(re.compile("^[^…]+$"))
        expect(readout.locator(".values.exact")).to_be_visible()
        texts = [text for text in readout.locator(".value").all_inner_texts() if text]
        wanted = pixel[plane] if isinstance(pixel[plane], list) else [pixel[plane]]
        np.testing.assert_allclose([float(text.split()[0]) for text in texts], wanted, rtol=1e-3, atol=1e-4, err_msg=plane)
        assert stage.screenshot() != light, plane
    channels.select_option("")

    # The PNG looks like the page.
    page.get_by_label("Tone curve").select_option("neutral")
    page.get_by_role("tab", name="Save").click()
    with page.expect_download() as download:
        page.get_by_role("link", name="PNG", exact=True).click()
    png = np.asarray(Image.open(download.value.path()).convert("RGB"))
    np.testing.assert_array_equal(png, tonemap.apply(film, -0.5, "neutral"))

    assert re.search(r"ev=-0\.5", page.url), "the view's state is in the address"
    assert watched.errors == []
    assert watched.origins == {farm.url.removeprefix("http://")}


@pytest.mark.long
def test_invalid_scene_shows_error_of_service(farm: Farm, watched: Watched) -> None:
    page = watched.page
    page.goto(farm.url)
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose files").click()
    chooser.value.set_files([{"name": "notes.txt", "mimeType": "text/plain", "buffer": b"no scene"}])
    alert = page.get_by_role("alert")
    expect(page.locator(".drop-zone").get_by_role("alert")).to_contain_text("notes.txt is not a 3D scene")
    alert.get_by_role("button", name="Dismiss").click()
    expect(alert).to_have_count(0)
    # The next drop, another page and Escape close it too.
    drop(page, "notes.txt", b"no scene")
    expect(alert).to_contain_text("notes.txt")
    drop(page, "letter.txt", b"no scene")
    expect(alert).to_contain_text("letter.txt is not a 3D scene")
    page.get_by_role("link", name="Jobs", exact=True).click()
    expect(alert).to_have_count(0)
    drop(page, "notes.txt", b"no scene")
    expect(alert).to_contain_text("notes.txt")
    page.keyboard.press("Escape")
    expect(alert).to_have_count(0)
    page.get_by_role("link", name="Scenes", exact=True).click()

    drop(page, "house.c4d", b"QC4DC4D6")
    expect(alert).to_contain_text("house.c4d cannot be read here")
    expect(alert).to_contain_text("File > Export > glTF")
    alert.get_by_role("button", name="Dismiss").click()

    # If an upload is interrupted, the same files are sent again.
    page.route(
        "**/api/scenes", lambda route: route.abort("connectionreset") if route.request.method == "POST" else route.continue_()
    )
    drop(page, "broken.glb", b"glTF, but not really")
    expect(alert).to_contain_text("broken.glb was not accepted")
    expect(alert).to_contain_text("The upload was interrupted")
    page.unroute("**/api/scenes")
    alert.get_by_role("button", name="Try again").click()
    problem = page.get_by_role("alert")
    expect(problem).to_contain_text("broken.glb")
    expect(problem).to_contain_text("This cannot be rendered")
    # The browser reports the refused request itself; nothing else may be on the console.
    assert [error for error in watched.errors if "422" not in error and "ERR_CONNECTION_RE" not in error] == []


@pytest.mark.long
def test_example_renders_in_two_clicks_and_cancelling_keeps_picture(farm: Farm, watched: Watched) -> None:
    page = watched.page
    page.goto(farm.url)
    page.get_by_role("button", name="Spheres", exact=True).click()
    page.get_by_role("button", name="Render").click()
    expect(page.locator(".big")).to_have_text(re.compile("^[1-9]"), timeout=60_000)
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator(".job-page .chip:not(.verdict)")).to_contain_text("Cancelled")
    assert samples_shown(page) >= 1
    picture = Image.open(io.BytesIO(page.locator(".stage").screenshot())).convert("L")
    assert np.asarray(picture).std() > 20, "what was rendered stays"
    page.get_by_role("button", name="Resume").click()
    expect(page.locator(".job-page .chip:not(.verdict)")).to_contain_text("Rendering")
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator(".job-page .chip:not(.verdict)")).to_contain_text("Cancelled")
    assert watched.errors == []


@pytest.mark.long
def test_missing_files_are_added_and_main_file_is_selected(farm: Farm, watched: Watched) -> None:
    page = watched.page
    page.goto(farm.url)
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose files").click()
    triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    named = {
        "table.obj": b"mtllib wood.mtl\nusemtl wood\n" + triangle,
        "chair.obj": triangle,
        "wood.mtl": b"newmtl wood\nmap_Kd oak.png\n",
    }
    plain = [{"name": name, "mimeType": "text/plain", "buffer": content} for name, content in named.items()]
    chooser.value.set_files(plain)
    asked = page.get_by_role("dialog", name="2 models: which is the scene?")
    asked.get_by_role("button", name="table.obj").click()
    expect(page.get_by_role("heading", name="table")).to_be_visible()
    warning = page.locator(".first-warning", has_text="Missing: oak.png")
    expect(warning).to_be_visible(timeout=60_000)
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Add files").click()
    oak = io.BytesIO()
    Image.new("RGB", (4, 4), (120, 80, 40)).save(oak, "PNG")
    chooser.value.set_files([{"name": "oak.png", "mimeType": "image/png", "buffer": oak.getvalue()}])
    expect(warning).to_have_count(0, timeout=60_000)
    expect(page.get_by_role("button", name="Render", exact=True)).to_be_visible(timeout=60_000)
    expect(page.get_by_role("button", name="Add files")).to_have_count(0)
    assert watched.errors == []


@pytest.mark.long
def test_mistaken_address_leads_to_the_page_that_it_means(farm: Farm, watched: Watched) -> None:
    """The front page is shown for the address of a list of scenes, and the back button leads past that address."""
    page = watched.page
    page.goto(f"{farm.url}/#/jobs")
    jobs = page.get_by_role("heading", name="Jobs", exact=True)
    expect(jobs).to_be_visible()
    page.evaluate("location.hash = '#/scenes'")
    expect(page.get_by_role("heading", name="Drop a scene anywhere")).to_be_visible()
    assert page.evaluate("location.hash") == "#/"
    page.go_back()
    expect(jobs).to_be_visible()
    page.goto(f"{farm.url}/#/nowhere")
    expect(page.get_by_text("There is nothing at this address")).to_be_visible()
    assert watched.errors == []
