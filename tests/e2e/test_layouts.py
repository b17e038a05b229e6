"""Tests of saved layouts in a browser."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

from tests.e2e.conftest import Watched
from tests.service.conftest import Service

pytestmark = pytest.mark.long


def choose(page: Page, text: str) -> None:
    """Runs the first entry of the command palette that a text finds."""
    # A loaded page takes keys only once the service has sent its session.
    expect(page.get_by_role("button", name="Find", exact=True)).to_be_visible()
    page.keyboard.press("Control+k")
    page.keyboard.type(text)
    expect(page.get_by_role("dialog").get_by_role("option").first).to_contain_text(text)
    page.keyboard.press("Enter")


def test_layout_is_saved_and_shown_on_another_page(many: Service, watched: Watched) -> None:
    """A layout has the side's width, its tab and the exposure; another page opened later shows it, too."""
    page = watched.page
    page.set_viewport_size({"width": 1400, "height": 800})
    page.goto(f"{many.url}/#/jobs")
    page.locator(".job-row a.name").first.click()
    side, tab = page.locator("aside.side"), page.get_by_role("tab", selected=True)
    edge = page.get_by_role("separator", name="Sidebar width")
    usual = (side.bounding_box() or {})["width"]
    edge.focus()
    for _ in range(4):
        page.keyboard.press("ArrowLeft")
    wide = (side.bounding_box() or {})["width"]
    assert wide == usual + 64
    page.get_by_role("tab", name="Info").click()
    page.keyboard.press("e")
    choose(page, "Save layout")
    page.keyboard.type("Review")
    page.keyboard.press("Enter")

    choose(page, "Layout: Default")
    expect(tab).to_have_text("View")
    expect(page.get_by_text("+0.0 EV")).to_be_visible()
    assert (side.bounding_box() or {})["width"] == usual
    choose(page, "Layout: Review")
    expect(tab).to_have_text("Info")
    expect(page.get_by_text("+0.5 EV")).to_have_count(1)
    choose(page, "Hide the sidebar")
    expect(side).to_be_hidden()

    page.goto(f"{many.url}/#/workers")
    page.reload()
    choose(page, "Layout: Review")
    page.goto(f"{many.url}/#/jobs")
    page.locator(".job-row a.name").nth(1).click()
    expect(tab).to_have_text("Info")
    assert (side.bounding_box() or {})["width"] == wide
    choose(page, "Delete layout: Review")
    page.keyboard.press("Control+k")
    page.keyboard.type("review")
    expect(page.get_by_role("option", name="Layout: Review")).to_have_count(0)
    assert [error for error in watched.errors if "409" not in error] == []  # these jobs have no films
