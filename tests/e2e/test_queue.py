"""Tests of the job queue in a browser: dependencies, deadlines, and fair shares."""

from __future__ import annotations

import time

import pytest
from playwright.sync_api import expect

from protocol.terms import Terms
from service.events import RowWritten
from service.store.models import Job
from tests.e2e.conftest import Watched
from tests.service.conftest import Service, until


@pytest.mark.long
def test_job_shows_dependencies_and_deadline(many: Service, watched: Watched) -> None:
    page = watched.page
    first = many.submit("scene1", name="The first")
    job = many.submit("scene1", name="The second", after=[first])
    page.goto(f"{many.url}/#/jobs/{job}")
    page.get_by_role("tab", name="Info").click()
    panel = page.get_by_role("region", name="Queue")
    expect(panel.get_by_role("link", name="The first")).to_have_attribute("href", f"#/jobs/{first}")
    progress = page.get_by_role("region", name="Progress")
    expect(progress.get_by_text('Waits until "The first" is finished.')).to_be_visible()
    panel.get_by_role("button", name="Start without waiting").click()
    expect(panel.get_by_role("link", name="The first")).to_be_hidden()
    assert many.job(job)["waits_for"] == []

    panel.get_by_text("Queue").click()
    panel.get_by_label("Deadline").fill("2035-05-01T08:00")
    panel.get_by_label("Deadline").blur()
    expect(panel.get_by_text("Deadline: Tue, May 1, 08:00 AM.")).to_be_visible()
    panel.get_by_label("Max slots").fill("3")
    panel.get_by_label("Needs").fill("gpu, memory_gb=32")
    panel.get_by_label("Priority").fill("5")
    panel.get_by_label("Priority").blur()
    until(lambda: (many.job(job)["max_slots"], many.job(job)["priority"]) == (3, 5), "the job is changed")
    assert many.job(job)["needs"] == ["gpu", "memory_gb=32"]
    with many.farm.sessions.begin() as session:
        row = session.get_one(Job, job)
        row.deadline, row.late = time.time() - 60, time.time() - 120
    many.farm.events.publish(RowWritten("job", job))
    expect(panel.get_by_role("status")).to_contain_text("Its deadline has passed")
    for id in (job, first):
        many.patch(id, state="cancelled")
    expect(panel).to_be_hidden()
    assert watched.errors == []


@pytest.mark.long
def test_job_is_renamed_and_note_is_listed(many: Service, watched: Watched) -> None:
    page = watched.page
    job = many.submit("scene1", name="Take 1")
    page.goto(f"{many.url}/#/jobs/{job}")
    expect(page.get_by_role("heading", name="Take 1")).to_be_visible()
    page.keyboard.press("F2")
    page.get_by_label("Name of the picture").fill("thrown away")
    expect(page.get_by_role("heading", level=1)).to_have_text("Take 1")  # for screen readers, also beside the field
    page.keyboard.press("Escape")
    page.get_by_role("button", name="Rename").click()
    page.get_by_label("Name of the picture").fill("The cover")
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", name="The cover")).to_be_visible()
    page.get_by_role("button", name="Add a description").click()
    page.get_by_label("Description", exact=True).fill("warmer lamp\nsays <b>Anna</b>")
    page.keyboard.press("Control+Enter")
    expect(page.locator(".note-text")).to_have_text("warmer lamp\nsays <b>Anna</b>")
    until(lambda: many.job(job)["note"] == "warmer lamp\nsays <b>Anna</b>", "the note is kept")
    page.goto(f"{many.url}/#/jobs?search=warmer")
    expect(page.locator(".job-row")).to_have_count(1)
    expect(page.locator(".job-row")).to_contain_text("The cover")
    expect(page.locator(".job-row")).to_contain_text("warmer lamp")
    assert watched.errors == []
    many.patch(job, state="cancelled")


@pytest.mark.long
def test_shares_are_shown_and_changed(many: Service, watched: Watched) -> None:
    page = watched.page
    many.http.put("/api/shares/user:anna", json={"weight": 2, "max_slots": 8}).raise_for_status()
    page.goto(f"{many.url}/#/workers")
    page.get_by_role("heading", name="Shares").click()
    expect(page.get_by_label("Weight of anna")).to_have_value("2")
    expect(page.get_by_label("Slots of anna at most")).to_have_value("8")
    page.get_by_label("Weight of anna").fill("0.5")
    page.get_by_label("Slots of anna at most").fill("")
    page.get_by_label("Slots of anna at most").blur()

    def terms() -> list[object]:
        rows = many.http.get("/api/shares").json()
        return [row[name] for row in rows if row["share"] == "user:anna" for name in ("weight", "max_slots")]

    until(lambda: terms() == [0.5, None], "the share is changed", say=terms)
    assert watched.errors == []
    many.http.delete("/api/shares/user:anna").raise_for_status()


@pytest.mark.long
def test_working_hours_of_machine_are_changed(many: Service, watched: Watched) -> None:
    page = watched.page
    peers = (many.worker(name="attic", tags=("gpu", "kind:test-kind"), slots=4), many.worker(name="cellar"))
    for peer in peers:
        peer._threads.pop(0)  # reports but takes no work, since the scenes have no files
    with peers[0] as attic, peers[1]:
        page.goto(f"{many.url}/#/workers")
        new, old = (page.locator(".machine").filter(has_text=name) for name in ("attic", "cellar"))
        expect(new).to_contain_text("Tags: gpu")
        old.get_by_text("Hours and limits").click()
        expect(old).to_contain_text("an older release, so it can only be paused")
        new.get_by_text("Hours and limits").click()
        new.get_by_label("Hours", exact=True).fill("Sat-Sun")
        new.get_by_label("Max slots").fill("3")
        new.get_by_label("Nice level").fill("7")
        new.get_by_label("Nice level").blur()
        until(lambda: attic.terms == Terms("Sat-Sun", slots=3, nice=7), "it is told", say=lambda: attic.terms)
        attic.rests = "Outside its hours: Sat-Sun."
        expect(new.locator(".chip")).to_have_text("Inactive")
        expect(new).to_contain_text("Outside its hours: Sat-Sun.")
        expect(new.get_by_role("button", name="Pause")).to_be_visible()
        new.get_by_label("Hours", exact=True).fill("Mondays")
        new.get_by_label("Hours", exact=True).blur()
        expect(page.get_by_text("give hours as Mon-Fri 19:00-07:00, Sat-Sun")).to_be_visible()
    assert all("422" in error for error in watched.errors), watched.errors
