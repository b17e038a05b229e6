"""Tests that the page shows the reason if a film is lost or the service busy, and retries after the time that it states."""

from __future__ import annotations

import json
from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, Route, expect
from sqlalchemy import select

from service.store.models import Frame, Job
from tests.e2e.conftest import Watched
from tests.service.conftest import Service

GONE = "The film of this job is missing. Set the job to running to render it again."
PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c4944415408d763f8cfc0000003010100c9fe92ef0000000049454e44ae426082"
)


@pytest.fixture
def finished(many: Service, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Yields the id of a still that the database lists as finished with all its samples, although it has no film."""
    monkeypatch.setattr(many.farm.scrubber, "check_first", lambda job: None)  # otherwise it would be rendered again at once
    newest = select(Job.id).where(Job.state == "finished", Job.shot.is_(None)).order_by(Job.created.desc())
    with many.farm.sessions.begin() as session:
        job = session.scalars(newest).first()
        assert job is not None
        frame = session.get_one(Frame, (job, 0))
        frame.samples = frame.target
    yield job
    with many.farm.sessions.begin() as session:
        session.get_one(Frame, (job, 0)).samples = 0


def reject_requests(route: Route) -> None:
    problem = {"status": 409, "detail": GONE, "code": "job-film-gone", "params": {}}
    route.fulfill(status=409, content_type="application/problem+json", body=json.dumps(problem))


def busy(route: Route) -> None:
    problem = {"status": 503, "detail": "2 other pictures that you asked for are not ready yet. Try again in a moment."}
    route.fulfill(status=503, headers={"Retry-After": "1"}, content_type="application/problem+json", body=json.dumps(problem))


@pytest.mark.long
def test_page_shows_why_finished_picture_is_lost(many: Service, finished: str, watched: Watched) -> None:
    page = watched.page
    page.route(f"**/jobs/{finished}/frames/0/*", reject_requests)
    page.route(f"**/jobs/{finished}/frames/0/*?**", reject_requests)
    page.goto(f"{many.url}/#/jobs/{finished}")
    notice = page.locator(".stage-missing")
    expect(notice).to_contain_text(GONE)
    page.get_by_role("tab", name="Save").click()
    page.get_by_role("link", name="PNG", exact=True).click()
    alert = page.get_by_role("alert")
    expect(alert).to_contain_text("PNG: not saved")
    expect(alert).to_contain_text(GONE)
    changed: list[str | None] = []

    def note(route: Route) -> None:
        if route.request.method == "PATCH":
            changed.append(route.request.post_data)
        route.continue_()

    page.route(f"**/api/jobs/{finished}", note)
    notice.get_by_role("button", name="Render it again").click()
    expect(notice).to_be_hidden()
    assert changed == ['{"state":"running"}']
    many.patch(finished, state="cancelled")


@pytest.mark.long
def test_lost_picture_message_is_translated(many: Service, finished: str, watched: Watched) -> None:
    page = watched.page
    page.add_init_script("localStorage['rayfarm.language'] = 'de'")
    page.route(f"**/jobs/{finished}/frames/0/*", reject_requests)
    page.route(f"**/jobs/{finished}/frames/0/*?**", reject_requests)
    page.goto(f"{many.url}/#/jobs/{finished}")
    expect(page.locator(".stage-missing")).to_contain_text("Der Film dieses Jobs ist weg.")


def test_pictures_and_downloads_are_retried_when_service_is_busy(page: Page) -> None:
    tries = 0

    def soon(route: Route) -> None:
        nonlocal tries
        tries += 1
        if tries % 3:
            busy(route)
        else:
            named = {"Content-Disposition": 'inline; filename="a picture.png"'}
            route.fulfill(content_type="image/png", headers=named, body=PIXEL)

    page.route("**/picture.png", soon)
    width = page.evaluate("""async () => {
        const { showImage } = await import("/js/news/images.js");
        const image = document.body.appendChild(new Image());
        await showImage(image, "/picture.png");
        return image.naturalWidth;
    }""")
    assert (width, tries) == (1, 3)
    with page.expect_download() as saved:
        page.evaluate("""async () => {
            const { saveFile } = await import("/js/news/images.js");
            await saveFile("/picture.png");
        }""")
    assert saved.value.suggested_filename == "a picture.png"
    assert tries == 6
    page.route("**/gone.png", reject_requests)
    sentence = page.evaluate("""async () => {
        const { showImage } = await import("/js/news/images.js");
        return showImage(document.body.appendChild(new Image()), "/gone.png").catch(({ message }) => message);
    }""")
    assert sentence == GONE
