"""Tests of a pixel's explanation, which is drawn over the picture, and of the job's log and the picture's tools."""

from __future__ import annotations

import io
import json
import re

import httpx
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from tests.e2e.conftest import Watched
from tests.e2e.screen import render_job
from tests.helpers import Farm

PIXEL = (96, 64)


@pytest.fixture(scope="module")
def finished(farm: Farm) -> str:
    """Returns the id of a small finished picture of a closed box with indirect light."""
    scene = httpx.post(f"{farm.url}/api/examples/cornell-box").raise_for_status().json()["id"]
    return render_job(farm, str(scene), width=192, height=128, tile_size=64, spp=8)


def open_job(page: Page, farm: Farm, job: str, query: str = "") -> None:
    page.goto(f"{farm.url}/#/jobs/{job}{query}")
    expect(page.locator(".stage")).to_have_attribute("data-film", "here")


@pytest.mark.long
def test_pixel_explanation_is_drawn_over_picture(farm: Farm, finished: str, watched: Watched) -> None:
    """A pixel can be explained by a click with the tool, or by the button of a pinned pixel; Escape ends the explanation.

    The table shows what the service answers about the pixel.
    """
    page = watched.page
    x, y = PIXEL
    told = httpx.get(f"{farm.url}/api/jobs/{finished}/explain?x={x}&y={y}", timeout=60).raise_for_status().json()
    assert told["equals_film"] is True
    open_job(page, farm, finished, f"?pins={x},{y}")
    panel = page.get_by_role("region", name="Paths of a pixel")
    page.get_by_role("button", name=f"Show the paths of pixel {x}, {y}").click()
    expect(page.get_by_role("tab", name="Paths")).to_have_attribute("aria-selected", "true")
    expect(panel.get_by_role("heading")).to_have_text(f"Paths of pixel {x}, {y}")
    expect(panel).to_contain_text("Their sum equals the picture exactly.")
    expect(panel.get_by_role("radio")).to_have_count(len(told["paths"]))
    bright = next(path for path in told["paths"] if "brightest" in path["chosen"])
    panel.get_by_role("radio", name="Brightest").check()
    rows = panel.locator("tbody tr")
    expect(rows).to_have_count(len(bright["vertices"]))
    expect(rows.first).to_contain_text(bright["vertices"][0]["object_name"])
    over = page.locator(".stage canvas").last
    drawn = """(canvas) => canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height)
        .data.filter((value, i) => i % 4 === 3 && value).length"""
    with_path = over.evaluate(drawn)
    panel.get_by_role("button", name="Vertex 1").press("Enter")
    expect(panel.get_by_role("button", name="Vertex 1")).to_have_attribute("aria-pressed", "true")
    expect(panel.locator("dl")).to_contain_text("Throughput")
    panel.get_by_role("spinbutton", name="Number of a sample").fill("5")
    panel.get_by_role("button", name="Follow").click()
    expect(panel.get_by_role("radio", name="Requested")).to_be_checked()
    page.keyboard.press("Escape")  # typing is not affected
    page.locator("h1").click()
    page.keyboard.press("Escape")
    expect(panel).to_be_hidden()
    expect(page.get_by_role("tab", name="Paths")).to_be_hidden()
    expect(page.get_by_role("tab", name="View")).to_have_attribute("aria-selected", "true")
    assert over.evaluate(drawn) < with_path, "what was drawn is gone"
    page.get_by_role("button", name="Inspect pixels", exact=True).click()
    page.get_by_role("button", name="Show a pixel's paths", exact=True).click()
    expect(page.get_by_role("button", name="Inspect pixels", exact=True)).to_have_attribute("aria-pressed", "false")
    box = page.locator(".stage").bounding_box()
    assert box
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    expect(panel).to_contain_text("followed again")
    page.keyboard.press("Escape")
    expect(page.get_by_role("button", name="Show a pixel's paths", exact=True)).to_have_attribute("aria-pressed", "false")
    assert watched.errors == []


@pytest.mark.long
def test_job_log_is_shown_copied_and_downloaded(farm: Farm, finished: str, watched: Watched) -> None:
    page = watched.page
    page.context.grant_permissions(["clipboard-read", "clipboard-write"], origin=farm.url)
    open_job(page, farm, finished, "?pins=10,12")
    panel = page.locator(".job-log")
    page.get_by_role("button", name="The log of the tile with 10, 12").click()
    lines = panel.get_by_role("log")
    expect(lines).to_contain_text(re.compile(r": samples? 0 "))
    expect(panel.get_by_text("Tile with 10, 12")).to_be_visible()
    panel.get_by_role("button", name="The whole log").click()
    expect(lines).to_contain_text("finished: ")
    panel.get_by_role("button", name="Copy the log").click()
    expect(page.get_by_text("The log is copied")).to_have_count(1)
    text = httpx.get(f"{farm.url}/api/jobs/{finished}/log").text
    assert page.evaluate("navigator.clipboard.readText()") == text
    with page.expect_download() as download:
        panel.get_by_role("link", name="Download the log").click()
    assert re.fullmatch(r"Cornell box( \d+)?\.log", download.value.suggested_filename)
    assert download.value.path().read_text() == text


@pytest.mark.long
def test_picture_tools_work(farm: Farm, finished: str, watched: Watched) -> None:
    """The picture's tools work: they copy the displayed picture, copy the URL with all display options, and show fullscreen."""
    page = watched.page
    page.context.grant_permissions(["clipboard-read", "clipboard-write"], origin=farm.url)
    open_job(page, farm, finished, "?ev=1.5&tone=agx")
    page.get_by_role("button", name="Copy the picture").click()
    expect(page.get_by_text("Copy the picture: done")).to_have_count(1)
    bytes_ = page.evaluate("""async () => {
        const [item] = await navigator.clipboard.read();
        return [...new Uint8Array(await (await item.getType('image/png')).arrayBuffer())];
    }""")
    copied = np.asarray(Image.open(io.BytesIO(bytes(bytes_))).convert("RGB")).astype(int)
    query = {"exposure": 1.5, "tonemap": "agx"}
    asked = httpx.get(f"{farm.url}/api/jobs/{finished}/frames/0/image.png", params=query).raise_for_status().content
    np.testing.assert_array_equal(copied, np.asarray(Image.open(io.BytesIO(asked)).convert("RGB")))
    page.get_by_role("button", name="Copy the link to this view").click()
    expect(page.get_by_text("Copy the link to this view: done")).to_have_count(1)
    link = page.evaluate("navigator.clipboard.readText()")
    assert link == page.url and "ev=1.5" in link and json.dumps(finished)[1:-1] in link
    whole = page.get_by_role("button", name="Full screen")
    whole.click()
    expect(page.locator(":fullscreen").locator(".stage")).to_have_count(1)
    page.keyboard.press("w")
    expect(page.locator(":fullscreen")).to_have_count(0)
    assert watched.errors == []


@pytest.mark.long
def test_workers_and_firefly_are_shown(farm: Farm, finished: str, watched: Watched) -> None:
    """The tiles are coloured by worker, and a sample that brings most of a pixel's light is named and shown first."""
    page = watched.page
    x, y = PIXEL
    address = f"{farm.url}/api/jobs/{finished}"
    brought = httpx.get(f"{address}/frames/0/workers").raise_for_status().json()
    assert sum(worker["samples"] for worker in brought["workers"]) == 192 * 128 * 8
    open_job(page, farm, finished)
    over = page.locator(".stage canvas").last
    expect(over).to_be_hidden()
    page.get_by_role("checkbox", name="Who rendered it").check()
    legend = page.get_by_role("list", name="Workers that rendered it")
    expect(legend.get_by_role("listitem")).to_have_count(len(brought["workers"]))
    expect(legend).to_contain_text(brought["workers"][0]["name"])
    expect(over).to_be_visible()
    expect(page).to_have_url(re.compile(r"[?&]by=1"))
    page.get_by_role("checkbox", name="Who rendered it").uncheck()
    expect(over).to_be_hidden()

    told = httpx.get(f"{address}/explain?x={x}&y={y}", timeout=60).raise_for_status().json()
    bright = next(path for path in told["paths"] if "brightest" in path["chosen"])
    told["samples"], told["mean"] = 32, [value / 16 for value in bright["value"]]  # as if this one had half of the light
    page.route("**/explain?*", lambda route: route.fulfill(json=told))
    page.goto("about:blank")  # another address of the same job keeps the page as it is
    open_job(page, farm, finished, f"?pins={x},{y}")
    page.get_by_role("button", name=f"Show the paths of pixel {x}, {y}").click()
    panel = page.get_by_role("region", name="Paths of a pixel")
    expect(panel).to_contain_text(f"A firefly: sample {bright['sample']} alone brings 50 % of this pixel's light.")
    expect(panel.get_by_role("radio", name="Brightest")).to_be_checked()
    assert watched.errors == []
