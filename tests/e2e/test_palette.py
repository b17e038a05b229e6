"""Tests of the command palette in a browser."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Watched
from tests.service.conftest import Service


@pytest.mark.long  # page/test_palette.py tests which entries match, service/api/test_job_list.py which jobs are found
def test_palette_finds_pages_scenes_and_jobs(many: Service, watched: Watched) -> None:
    page = watched.page
    keys = page.keyboard
    page.goto(many.url)
    page.get_by_role("button", name="Find", exact=True).first.wait_for()
    keys.press("Control+k")
    field = page.get_by_role("combobox", name="Find scenes, jobs, actions")
    expect(field).to_be_focused()
    options = page.get_by_role("dialog").get_by_role("option")
    expect(options.first).to_have_attribute("aria-selected", "true")
    keys.press("ArrowUp")
    expect(options.last).to_have_attribute("aria-selected", "true")
    expect(field).to_have_attribute("aria-activedescendant", options.last.get_attribute("id") or "")
    expect(page.get_by_role("group", name="Actions").get_by_role("option").first).to_be_visible()

    keys.type("work")
    expect(options.first).to_contain_text("Workers")
    keys.press("Enter")
    expect(page).to_have_url(re.compile("#/workers"))
    expect(page.get_by_role("dialog")).to_have_count(0)

    # An old job, which the page has not loaded, is found by the service.
    keys.press("Control+k")
    keys.type("truck 437")
    option = page.get_by_role("group", name="Jobs").get_by_role("option")
    expect(option).to_have_text([re.compile("Milk truck take .*437")] * 7)
    keys.press("Enter")
    expect(page).to_have_url(re.compile(r"#/jobs/\w+"))

    # On a picture, what can be done with it comes first.
    page.locator(".job-title").wait_for()
    keys.press("Control+k")
    expect(options.filter(has_text="Compare with another picture")).to_be_visible()
    groups = page.get_by_role("dialog").get_by_role("group").evaluate_all("all => all.map((each) => each.ariaLabel)")
    assert groups[:2] == ["This picture", "Pages"]
    keys.type("cor")
    expect(page.get_by_role("group", name="Examples").get_by_role("option", name="Cornell box", exact=True)).to_be_visible()
    field.fill("layouts the page")
    expect(page.get_by_role("group", name="Guides").get_by_role("option").first).to_be_visible()
    keys.press("Escape")

    keys.press("Control+k")
    keys.type("no such thing")
    expect(page.get_by_text("Nothing found")).to_be_visible()
    keys.press("Escape")
    expect(page.get_by_role("dialog")).to_have_count(0)
    keys.press("Control+k")
    keys.press("Control+k")
    expect(page.get_by_role("dialog")).to_have_count(0)
    assert watched.errors == []
