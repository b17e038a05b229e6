"""Tests of the page on a phone: nothing is cut off, and no tool covers a picture until it is wanted."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Browser, expect

from tests.service.conftest import Service


@pytest.mark.long
def test_phone_shows_whole_titles_and_hides_bins(many: Service, browser: Browser) -> None:
    context = browser.new_context(viewport={"width": 375, "height": 700}, has_touch=True, is_mobile=True)
    page = context.new_page()
    page.goto(many.url)
    card = page.locator(".latest .card").first
    chip = card.locator(".chip").bounding_box()
    assert chip and chip["width"] < 40, "an icon, whose word would cover the picture"
    facts = card.locator(".facts-line").first
    assert facts.evaluate("line => line.scrollWidth <= line.clientWidth")
    bin = card.get_by_role("button", name=re.compile("^Delete"))
    expect(bin).to_have_css("opacity", "0")
    session = context.new_cdp_session(page)
    box = card.bounding_box()
    assert box
    touch = {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 4}
    session.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [touch]})
    expect(bin).to_have_css("opacity", "1")
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    expect(page).to_have_url(re.compile(r"/(#/)?$"))
    page.wait_for_timeout(300)  # the browser counts a card as hovered over once the finger has left it
    expect(bin).to_have_css("opacity", "1")
    page.get_by_role("heading", name="Latest pictures").tap()
    expect(bin).to_have_css("opacity", "0")

    page.goto(f"{many.url}/#/jobs")
    expect(page.get_by_role("button", name="Cancelled 2,000")).to_be_in_viewport(ratio=1)
    expect(page.get_by_label("Order")).to_be_hidden()
    page.get_by_role("button", name="Filters").tap()
    page.get_by_label("Order").select_option("oldest")
    page.reload()
    expect(page.get_by_label("Order")).to_have_value("oldest")
    expect(page.get_by_label("Order")).to_be_visible()
    page.goto(many.url)

    card.locator("a.name").tap()
    title = page.locator(".job-title h1")
    expect(title).to_contain_text("take")
    assert title.evaluate("title => title.scrollWidth <= title.clientWidth"), "it is not cut off"
    assert page.evaluate("document.documentElement.scrollWidth") <= 375
    save, picture = page.get_by_role("button", name="Save", exact=True).bounding_box(), page.locator(".stage-box").bounding_box()
    assert save and picture and save["y"] >= picture["y"] + picture["height"], "the tools are below the picture"
    context.close()
