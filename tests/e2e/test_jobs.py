"""Tests of a list of ten thousand jobs in a browser, on a service without workers."""

from __future__ import annotations

import re
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from service.store.models import Job
from tests.e2e.conftest import Watched
from tests.e2e.site import Site, call
from tests.service.conftest import Service, until


def visible_rows(page: Page) -> Locator:
    return page.locator(".virtual-rows .job-row:not(.unknown)")


def shown_states(service: Service, ids: list[str]) -> set[str]:
    return {job["state"] for job in service.http.get("/api/jobs", params={"ids": ",".join(ids)}).json()}


@pytest.mark.long
def test_jobs_are_searched_and_sorted_by_url(many: Service, watched: Watched) -> None:
    page = watched.page
    page.goto(f"{many.url}/#/jobs")
    expect(page.get_by_role("button", name="All 10,000")).to_be_visible()
    expect(page.get_by_role("button", name="Active 20")).to_be_visible()
    expect(visible_rows(page).first).to_contain_text("take 9999")
    assert visible_rows(page).count() < 60  # only those near the screen exist

    page.keyboard.press("End")
    page.evaluate("scrollTo(0, document.documentElement.scrollHeight)")
    expect(page.get_by_text("Kitchen take 0", exact=True)).to_be_visible()

    page.get_by_label("Search jobs").fill("truck 43")
    expect(page.get_by_role("button", name=re.compile(r"^All \d\d$"))).to_be_visible()
    page.get_by_role("button", name="Failed").click()
    page.get_by_label("Order").select_option("oldest")
    expect(page).to_have_url(re.compile(r"#/jobs\?(?=.*search=truck\+43)(?=.*show=failed)(?=.*sort=oldest)"))
    expect(visible_rows(page).first).to_contain_text("Milk truck take 437")

    # Changes of the URL apply at once, also by going back.
    page.evaluate("location.hash = '#/jobs?show=active&sort=oldest'")
    expect(visible_rows(page).first).to_contain_text("Milk truck take 1")
    expect(page.get_by_label("Search jobs")).to_have_value("")
    page.go_back()
    expect(page.get_by_role("button", name="Failed")).to_have_attribute("aria-pressed", "true")
    page.evaluate("location.hash = '#/jobs?search=nothing+is+so'")
    expect(page.get_by_text("No job matches")).to_be_visible()
    assert watched.errors == []


@pytest.mark.long
def test_bulk_change_of_selected_jobs_can_be_undone(many: Service, watched: Watched) -> None:
    page = watched.page
    page.goto(f"{many.url}/#/jobs?show=active")
    expect(visible_rows(page).first).to_contain_text("take 9501")
    paused = [f"{i:020x}" for i in range(9501, 7500, -500)]
    visible_rows(page).nth(0).get_by_role("checkbox").click()
    visible_rows(page).nth(4).locator("a.name").click(modifiers=["Shift"])
    bar = page.get_by_role("toolbar", name="Selected jobs")
    expect(bar).to_contain_text("5 selected")
    for name, applies in (("Pause", False), ("Resume", True), ("Cancel", True), ("Set priority", True), ("Delete", True)):
        expect(bar.get_by_role("button", name=name)).to_be_visible(visible=applies)  # of paused jobs
    expect(bar.get_by_role("link", name="Compare")).to_be_hidden()

    bar.get_by_role("button", name="Cancel").click()
    expect(page.get_by_text("5 jobs cancelled", exact=True)).to_be_visible()
    expect(page.get_by_role("button", name="Active 15")).to_be_visible()
    assert shown_states(many, paused) == {"cancelled"}
    page.get_by_role("button", name="Undo").click()
    expect(page.get_by_role("button", name="Active 20")).to_be_visible()
    until(lambda: shown_states(many, paused) == {"paused"}, "they are as they were")

    # Deletion applies to everything listed, visible or not, once the undo period has passed.
    page.evaluate("location.hash = '#/jobs?show=failed&search=kitchen'")
    expect(page.get_by_role("button", name="Failed 500")).to_be_visible()
    page.keyboard.press("Control+a")
    expect(bar).to_contain_text("500 selected")
    page.keyboard.press("Delete")
    expect(visible_rows(page)).to_have_count(0)
    page.keyboard.press("z")
    expect(visible_rows(page).first).to_be_visible()
    # When a row is removed, the next row gets the focus.
    page.keyboard.press("ArrowDown")
    second = visible_rows(page).nth(1).locator("a.name").get_attribute("href")
    visible_rows(page).first.get_by_role("button", name="Delete").press("Enter")
    expect(page.get_by_role("button", name="Failed 500")).to_be_visible()
    expect(page.locator(f"a.name[href='{second}']")).to_be_focused()
    page.keyboard.press("z")
    page.keyboard.press("x")
    expect(bar).to_contain_text("1 selected")
    bar.get_by_role("button", name="Delete").click()
    page.mouse.move(700, 5)  # an undo message stays while the pointer is on it
    expect(page.get_by_role("button", name="Failed 499")).to_be_visible(timeout=12_000)
    assert watched.errors == []


@pytest.mark.long
def test_events_of_hidden_jobs_change_only_counts(many: Service, watched: Watched) -> None:
    page = watched.page
    page.goto(many.url)
    latest = page.get_by_label("Latest pictures")
    expect(latest.get_by_role("link").nth(1)).to_contain_text("take 9999")
    before: list[Any] = latest.locator("a.name").all_inner_texts()
    old = f"{501:020x}"
    many.patch(old, priority=5)
    page.get_by_role("link", name="Jobs", exact=True).click()
    expect(visible_rows(page).first).to_contain_text("take 9999")
    many.http.delete(f"/api/jobs/{old}").raise_for_status()
    expect(page.get_by_role("button", name="Active 19")).to_be_visible()
    page.get_by_role("link", name="Scenes").click()
    expect(latest.locator("a.name")).to_have_text(before)
    assert watched.errors == []


@pytest.mark.long
def test_job_deleted_by_another_client_disappears(many: Service, watched: Watched) -> None:
    page = watched.page
    paused = f"{1001:020x}"
    page.goto(f"{many.url}/#/jobs/{paused}")
    expect(page.get_by_role("heading", name="Milk truck take 1001")).to_be_visible()
    many.http.delete(f"/api/jobs/{paused}").raise_for_status()
    expect(page.get_by_text("This picture was deleted")).to_be_visible()
    page.wait_for_timeout(300)
    expect(page.locator("#tray > *")).to_have_count(0)


@pytest.mark.long
def test_repeated_errors_are_counted_and_limited(page: Page, site: Site) -> None:
    page.goto(f"{site.url}/index.html")
    expect(page.locator("main h1").first).to_be_visible()  # a reloaded page has no errors of the previous one
    body = "for (const text of a) m.showError(text[0], text[1], {ofPage: text[2]});"
    call(page, "shell/tray", body, [["Lost", "No room.", False]] * 3 + [[f"Fault {i}", "Alas.", True] for i in range(4)])
    titles = page.locator("#tray .title")
    expect(titles).to_have_text(["Fault 1", "Fault 2", "Fault 3"])
    call(page, "shell/tray", "m.clearPageErrors(); for (const t of a) m.showError(t, 'No room.');", ["Lost", "Lost"])
    expect(titles).to_have_text(["Lost (2 times)"])


STUB = """
    window.told = [];
    class Told { constructor(title, options) { window.told.push([title, options.body]); } close() {} }
    Told.permission = "default";
    Told.requestPermission = async () => (Told.permission = "granted");
    window.Notification = Told;
    Document.prototype.hasFocus = () => false;
"""


@pytest.mark.long
def test_end_of_job_is_notified_if_enabled(many: Service, watched: Watched) -> None:
    page = watched.page
    page.add_init_script(STUB)
    ids = [f"{i:020x}" for i in (9994, 9999)]  # cancelled, so the engine ignores them

    def turn(state: str) -> None:
        with many.farm.sessions.begin() as session:
            for id in ids:
                session.get_one(Job, id).state = state
        for id in ids:
            many.farm.broadcast.report_change("job", id)

    page.goto(f"{many.url}/#/jobs")
    bell = page.get_by_role("button", name="Notify me when a job ends")
    for wanted in (False, True):
        turn("running")
        expect(page.get_by_role("link", name="Jobs", exact=False).locator(".tally").first).to_have_text("2")
        if wanted:
            bell.click()
            expect(bell).to_have_attribute("aria-pressed", "true")
        turn("finished")
        if wanted:
            until(lambda: bool(page.evaluate("window.told")), "it is told")
            title, body = page.evaluate("window.told")[0]
            assert title == "2 jobs ended" and "Cornell box take 9994: finished" in body
        else:
            expect(page.get_by_role("link", name="Jobs", exact=False).locator(".tally").first).to_be_hidden()
            page.wait_for_timeout(1200)
            assert page.evaluate("window.told") == []
    turn("cancelled")
    assert watched.errors == []
