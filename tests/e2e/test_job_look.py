"""Test that a job keeps the exposure and tone curve with which it was ordered, wherever the page shows it."""

from __future__ import annotations

import re

import httpx
import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Farm, Watched

pytestmark = pytest.mark.long


def test_job_opens_with_the_look_it_was_ordered_with(farm: Farm, watched: Watched) -> None:
    scene = httpx.post(f"{farm.url}/api/examples/cornell-box").raise_for_status().json()["id"]
    page = watched.page
    page.goto(f"{farm.url}/#/scenes/{scene}")
    page.get_by_role("spinbutton", name="Width", exact=True).fill("96")
    page.get_by_role("spinbutton", name="Height", exact=True).fill("64")
    page.get_by_role("radiogroup", name="Quality").get_by_text("Custom").click()
    page.get_by_label("Samples per pixel").fill("4")
    page.get_by_role("slider", name="Exposure in stops").fill("1.5")
    with page.expect_response(lambda answer: answer.request.method == "POST" and answer.url.endswith("/api/jobs")) as sent:
        page.get_by_role("button", name="Render").click()
    job = sent.value.json()["id"]
    assert (sent.value.json()["exposure"], sent.value.json()["tonemap"]) == (1.5, "neutral")
    exposure = page.get_by_role("slider", name="Exposure")
    expect(exposure).to_have_value("1.5")
    assert "ev=" not in page.url, "it is the job's own"
    with page.expect_request(lambda request: f"/{job}/frames/0/image.jpg" in request.url and "exposure=1.5" in request.url):
        page.goto(f"{farm.url}/#/jobs")
    page.locator(f"a[href='#/jobs/{job}']").first.click()
    expect(exposure).to_have_value("1.5")
    exposure.dblclick()
    expect(page).to_have_url(re.compile(r"ev=0\b"))
    page.reload()
    expect(exposure).to_have_value("0")
    page.keyboard.press("Control+k")
    page.keyboard.type("Layout: Default")
    page.keyboard.press("Enter")
    expect(exposure).to_have_value("1.5")
    page.goto(f"{farm.url}/#/scenes/{scene}?like={job}")
    expect(page.get_by_role("slider", name="Exposure in stops")).to_have_value("1.5")
    page.goto(f"{farm.url}/#/compare/{job}/{job}")
    expect(exposure).to_have_value("1.5")
    assert watched.errors == []
