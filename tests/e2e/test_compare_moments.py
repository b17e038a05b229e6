"""Tests of snapshots and uploaded pictures, on the job's page and on either side of a comparison."""

from __future__ import annotations

import re
from pathlib import Path

import httpx
import numpy as np
import pytest
from playwright.sync_api import expect

from renderer.image import encode, rgbe9995
from tests.e2e.conftest import Watched
from tests.e2e.screen import assert_screen, expected_pixels, expected_split, read_exr, render_job
from tests.helpers import Farm

SIZE = {"width": 96, "height": 64}
DROP = """([name, bytes]) => {
  const transfer = new DataTransfer();
  transfer.items.add(new File([new Uint8Array(bytes)], name));
  for (const type of ["dragenter", "drop"])
    dispatchEvent(new DragEvent(type, {dataTransfer: transfer, bubbles: true, cancelable: true}));
}"""


@pytest.mark.long
def test_snapshot_is_shown_and_compared_with_current_picture(farm: Farm, watched: Watched, tmp_path: Path) -> None:
    scene = httpx.post(f"{farm.url}/api/examples/spheres").raise_for_status().json()["id"]
    job = render_job(farm, scene, **SIZE, spp=256)
    address = f"{farm.url}/api/jobs/{job}"
    kept = httpx.get(f"{address}/snapshots").raise_for_status().json()
    assert kept and kept[0]["samples"] < 256 * 96 * 64, "a moment of it is kept, whichever"
    spp = kept[0]["spp"]
    then, now = (read_exr(f"{address}/{where}/image.exr", tmp_path) for where in (f"snapshots/{spp}", "frames/0"))
    pictures = [expected_pixels(film, -1.0, "hue") for film in (then, now)]
    assert np.abs(pictures[0] - pictures[1]).max() > 20, "the two differ, or this test says nothing"

    page = watched.page
    page.goto(f"{farm.url}/#/jobs/{job}?ev=-1&tone=hue")
    slider = page.get_by_role("slider", name="Moment")
    expect(slider).to_have_attribute("aria-valuetext", "Current")
    page.keyboard.press("1")
    page.mouse.move(5, 5)
    assert_screen(page, pictures[1], "now")
    slider.focus()
    page.keyboard.press("Home")
    expect(slider).to_have_attribute("aria-valuetext", re.compile(f"^{spp} sample"))
    tag = page.locator(".stage-box .channel-tag:visible").bounding_box()
    assert tag
    without_tag = pictures[0].copy()
    without_tag[:40] = -1  # the tag may cover the picture's upper rows
    assert_screen(page, without_tag, "then")
    expect(page).to_have_url(re.compile(rf"then={spp}\b"))
    page.reload()
    expect(slider).to_have_attribute("aria-valuetext", re.compile(f"^{spp} sample"))
    page.locator("h1").click()
    page.keyboard.press("Period")
    expect(slider).not_to_have_attribute("aria-valuetext", re.compile(f"^{spp} sample"))
    page.keyboard.press("Comma")
    expect(slider).to_have_attribute("aria-valuetext", re.compile(f"^{spp} sample"))
    # Planes exist only for the current picture.
    page.get_by_label("Channel").select_option("albedo")
    expect(slider).to_have_attribute("aria-valuetext", "Current")
    page.get_by_role("button", name="Fewer samples").click()
    expect(page.get_by_label("Channel")).to_have_value("")
    page.get_by_role("button", name="Back to now").click()
    expect(page.get_by_label("Channel")).to_have_value("albedo")
    expect(slider).to_have_attribute("aria-valuetext", "Current")
    page.get_by_label("Channel").select_option("")

    page.goto(f"{farm.url}/#/compare/{job}/{job}?ta={spp}&ev=-1&tone=hue")
    expect(page.locator(".channel-tag.left")).to_have_text(f"{spp} sample" + "s" * (spp > 1))
    expect(page.locator(".channel-tag.right")).to_have_text("now")
    page.keyboard.press("1")
    page.mouse.move(5, 5)
    assert_screen(page, expected_split(*pictures, page), "then beside now")
    expect(page.get_by_label("Channel of A")).to_be_disabled()
    page.get_by_label("Channel of B").select_option("albedo")
    expect(page).to_have_url(re.compile(r"\bb=albedo"))
    page.get_by_label("Channel of B").select_option("")
    page.get_by_label("Moment of A").select_option("")
    expect(page).not_to_have_url(re.compile("ta="))
    assert_screen(page, expected_split(pictures[1], pictures[1], page), "now beside now")
    assert watched.errors == []


@pytest.mark.long
def test_dropped_picture_becomes_reference(farm: Farm, watched: Watched, tmp_path: Path) -> None:
    scene = httpx.post(f"{farm.url}/api/examples/spheres").raise_for_status().json()["id"]
    job = render_job(farm, scene, **SIZE, spp=4)
    film = read_exr(f"{farm.url}/api/jobs/{job}/frames/0/image.exr", tmp_path)
    truth = (film * np.linspace(0.5, 1.5, 96, dtype=np.float32)[:, None]).astype(np.float32)

    page = watched.page
    page.goto(f"{farm.url}/#/compare/{job}/{job}?b=albedo")
    panel = page.get_by_role("region", name="Reference pictures")
    expect(panel).to_contain_text("linear Rec.709")
    page.evaluate(DROP, ["Ground truth.exr", list(encode.encode(truth, "exr"))])
    expect(page.locator(".channel-tag.left")).to_have_text("Ground truth.exr")
    expect(page).to_have_url(re.compile(r"compare/ref\.\w+/" + job))
    page.keyboard.press("1")
    page.mouse.move(5, 5)
    assert_screen(
        page,
        expected_split(expected_pixels(truth, 0, "neutral"), expected_pixels(film, 0, "neutral"), page),
        "the truth beside the film",
    )

    # A is the reference of the error metric; its URL alone shows the same.
    page.get_by_label("Ways to compare").get_by_text("Relative", exact=True).click()
    expect(page).to_have_url(re.compile("way=relative"))
    page.reload()
    ways = page.get_by_label("Ways to compare")
    expect(ways).to_contain_text("A is the reference")
    a, b = (rgbe9995.unpack(rgbe9995.pack(each)).astype(float) for each in (truth, film))
    wanted = [((a - b) ** 2).mean(), ((a - b) ** 2 / (a**2 + 0.01)).mean()]
    figures = [float(text) for text in ways.locator("dd").all_inner_texts()]
    np.testing.assert_allclose(figures[:2], wanted, rtol=2e-3)

    # An 8-bit picture is labelled as such; a picture of another size is not stretched.
    small = encode.encode(truth[:32, :48], "png")
    page.evaluate(DROP, ["small.png", list(small)])
    expect(page.get_by_role("status").filter(has_text="A is 48×32, B is 96×64")).to_be_visible()
    expect(ways).to_contain_text("differ in size")
    expect(panel).to_contain_text("8 bits per channel")
    page.evaluate(DROP, ["broken.exr", [1, 2, 3]])
    expect(page.get_by_text("broken.exr was not accepted")).to_be_visible()

    # A picture that no side shows is released.
    page.get_by_label("Picture A").select_option(job)
    panel.get_by_role("button", name="Remove small.png").click()
    expect(panel.get_by_text("small.png")).to_have_count(0)
    page.goto(f"{farm.url}/#/compare/ref.0000/{job}")
    expect(page.get_by_text("This picture is not here")).to_be_visible()
    assert watched.errors == [error for error in watched.errors if "status of 4" in error]
