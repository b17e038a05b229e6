"""Tests of the queue options in the form of a new job."""

from __future__ import annotations

import ast
import json
import shlex

import pytest
from playwright.sync_api import Page, expect

from tests.e2e.site import call
from tests.e2e.test_settings_form import open_form, submitted_request

JOBS = [
    {"id": "j1", "name": "The set", "state": "running", "progress": 0.25, "created": 3},
    {"id": "j2", "name": "The hero", "state": "queued", "progress": 0, "created": 2},
    {"id": "j3", "name": "Done", "state": "finished", "progress": 1, "created": 1},
]
WORKERS = [{"name": "attic", "slots": 4, "samples_per_s": 1, "offer": {"tags": ["gpu"], "memory": 16e9}}]
FARM = "const farm = await import('/js/news/farm.js'); farm.jobs.set(a.jobs); farm.workers.set(a.workers); farm.scenes.set([]);"


@pytest.fixture
def form(page: Page) -> Page:
    call(page, "base/dom", FARM, {"jobs": JOBS, "workers": WORKERS})
    open_form(page)
    return page


@pytest.mark.long
def test_unchanged_options_are_not_requested(form: Page) -> None:
    asked = submitted_request(form)
    assert not {"deadline", "priority", "max_slots", "needs", "after", "verify", "fresh"} & asked.keys()


def test_queue_options_are_requested(form: Page) -> None:
    fold = form.locator(".queue-fold")
    fold.get_by_label("Deadline").fill("2035-05-01T08:00")
    fold.get_by_label("Priority").fill("5")
    fold.get_by_label("Max slots").fill("3")
    fold.get_by_label("Needs").fill("gpu, memory_gb=12")
    fold.get_by_label("After", exact=True).select_option(label="The hero")
    fold.get_by_label("After", exact=True).select_option(label="The set · 25 %")
    expect(fold.get_by_label("After", exact=True)).to_be_disabled()
    fold.get_by_role("button", name="Do not wait for The set").click()
    expect(fold.get_by_label("After", exact=True)).to_be_focused()
    fold.get_by_label("Verified, %").fill("2.5")
    fold.get_by_label("Render again from the first sample").check()
    fold.locator("summary").click()
    expect(fold.locator("summary")).to_contain_text(
        "priority 5 · 3 slots · gpu, memory_gb=12 · after 1 job · 2.5 % verified · anew"
    )
    asked = submitted_request(form)
    assert form.evaluate("new Date(window.asked.deadline) - new Date('2035-05-01T08:00')") == 0
    names = ("priority", "max_slots", "needs", "after", "verify", "fresh")
    assert [asked[name] for name in names] == [5, 3, ["gpu", "memory_gb=12"], ["j2"], 0.025, True]


@pytest.mark.long
def test_invalid_option_shows_error_at_its_field(form: Page) -> None:
    fold = form.locator(".queue-fold")
    fold.locator("summary").click()
    for label, wrong, said, right in (
        ("Needs", "GPU", "“GPU” is not valid", "gpu"),
        ("Deadline", "2001-05-01T08:00", "this time has passed", ""),
        ("Max slots", "0", "is at least 1", ""),
        ("Verified, %", "101", "lies between 0 and 100", ""),
    ):
        fold.evaluate("fold => { fold.open = true }")
        fold.get_by_label(label).fill(wrong)
        fold.evaluate("fold => { fold.open = false }")
        assert submitted_request(form) is None
        expect(fold.get_by_role("alert").filter(has_text=said)).to_be_visible()
        expect(fold.get_by_label(label)).to_be_focused()
        fold.get_by_label(label).fill(right)
    fold.get_by_label("Needs").fill("gpu, cloud")
    fold.get_by_label("Needs").blur()
    expect(fold.locator(".lacking")).to_have_text("No connected worker has cloud: the job waits for one.")
    fold.get_by_label("Needs").fill("gpu, memory_gb=32")
    fold.get_by_label("Needs").blur()
    expect(fold.locator(".lacking")).to_contain_text("has all of these")
    fold.get_by_label("Needs").fill("gpu, memory_gb=16")
    fold.get_by_label("Needs").blur()
    expect(fold.locator(".lacking")).to_be_hidden()
    assert submitted_request(form)["needs"] == ["gpu", "memory_gb=16"]


@pytest.mark.long
def test_request_is_shown_as_program_code(form: Page) -> None:
    fold = form.locator(".by-program")
    form.locator(".queue-fold").get_by_label("Priority").fill("5")
    curl, python = (fold.get_by_label(name, exact=True) for name in ("curl", "Python"))
    expect(curl).to_contain_text('"priority":5')
    expect(python).to_contain_text("priority=5")
    asked = submitted_request(form)
    _, _, body = shlex.split(curl.text_content() or "")[-3:]
    assert json.loads(body) == asked
    tree = ast.parse(python.text_content() or "")
    call = next(node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func) == "farm.submit")
    said = {each.arg: ast.literal_eval(each.value) for each in call.keywords}
    assert {"scene": ast.literal_eval(call.args[0]), **said} == asked
