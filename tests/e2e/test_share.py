"""Tests of share links in a browser: created on a job's page, opened without an account, withdrawn; and of notes on a picture."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest
from playwright.sync_api import Browser, Dialog, Page, expect

from service.access.roles import Role
from tests.e2e.conftest import Watched
from tests.helpers import running_redis
from tests.service.conftest import OBJ, Service, until
from tests.service.peer_worker import PeerWorker

pytestmark = pytest.mark.long


@dataclass
class Studio:
    """A service with logins, a user anna, and a finished job."""

    service: Service
    job: str


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Studio]:
    folder = tmp_path_factory.mktemp("studio")
    server = running_redis(folder)
    with server:
        service = Service(folder / "data", server, host="0.0.0.0")
        token = (folder / "data" / "owner-token").read_text().strip()
        with (
            httpx.Client(base_url=service.url, headers={"Authorization": f"Bearer {token}"}, verify=False) as owner,
            PeerWorker(service.options["redis_url"], service.url, service.options["token"]),
        ):
            owner.post("/api/users", json={"name": "anna", "role": "submit"}).raise_for_status()
            scene = owner.post("/api/scenes", files={"files": ("cover.obj", OBJ)}).raise_for_status().json()["id"]
            until(lambda: owner.get(f"/api/scenes/{scene}").json()["status"] == "ready", "it is prepared")
            asked = {"scene": scene, "width": 32, "height": 32, "spp": 4, "name": "The cover"}
            job = owner.post("/api/jobs", json=asked).raise_for_status().json()["id"]
            until(lambda: owner.get(f"/api/jobs/{job}").json()["state"] == "finished", "it is rendered")
            yield Studio(service, job)
        service.stop()


@pytest.fixture
def anna(studio: Studio, watched: Watched) -> Page:
    """Returns a page with anna's session, on the job."""
    page = watched.page
    access = studio.service.farm.access
    page.goto(f"{studio.service.url}/#/login?code={access.keys.create('link', 'anna', Role.SUBMIT, lasts_s=600)[0]}")
    expect(page.get_by_role("heading", name="anna")).to_be_visible()
    page.goto(f"{studio.service.url}/#/jobs/{studio.job}")
    return page


def new_link(page: Page, service: Service, permission: str) -> str:
    """Creates a share link on a job's page; returns its address."""
    page.get_by_role("tab", name="Save").click()
    share = page.get_by_role("region", name="Share")
    share.get_by_label("Permission").select_option(permission)
    share.get_by_role("button", name="Create link").click()
    address = share.locator("code").text_content() or ""
    assert address.startswith(f"{service.url}/shared/#rayfarm-share-")
    return address


def test_share_link_is_created_opened_and_revoked(browser: Browser, studio: Studio, anna: Page, watched: Watched) -> None:
    expect(anna.locator(".stage")).to_have_attribute("data-film", "here")
    anna.keyboard.press("e")
    address = new_link(anna, studio.service, "View only")
    context = browser.new_context()
    guest = context.new_page()
    requested: list[str] = []
    guest.on("request", lambda request: requested.append(request.url))
    guest.goto(address)
    expect(guest.get_by_role("heading", name="The cover")).to_be_visible()
    expect(guest.get_by_role("status")).to_have_text("Finished")
    expect(guest.get_by_role("img", name="The cover")).to_be_visible()
    expect(guest.get_by_role("link", name="Save PNG")).to_have_attribute("download", "The cover.png")
    expect(guest.get_by_role("heading", name="Notes")).to_be_hidden()
    (picture,) = {url for url in requested if "/shared/image.png" in url}
    assert parse_qs(urlsplit(picture).query) == {"exposure": ["0.5"], "tonemap": ["neutral"], "frame": ["0"]}, (
        "the guest sees what anna saw"
    )
    assert not [url for url in requested if "rayfarm-share-" in url.partition("#")[0]], "the secret is never in a URL"

    share = anna.get_by_role("region", name="Share")
    share.get_by_role("button", name="Withdraw the link").click()
    expect(share.locator("code")).to_have_count(0)
    guest.reload()
    expect(guest.get_by_role("alert")).to_contain_text("expired or was withdrawn")
    context.close()
    assert watched.errors == []


def test_guest_and_user_exchange_notes_on_open_pages(browser: Browser, studio: Studio, anna: Page, watched: Watched) -> None:
    address = new_link(anna, studio.service, "View and notes")
    anna.get_by_role("tab", name="Notes").click()
    context = browser.new_context(viewport={"width": 375, "height": 700}, has_touch=True)
    guest = context.new_page()
    dialogs: list[Dialog] = []  # a script in a note would open one
    for page in (guest, anna):
        page.on("dialog", lambda dialog: dialogs.append(dialog))
    guest.goto(address)
    guest.get_by_role("button", name="Add note").click()
    box = guest.get_by_role("img", name="The cover").bounding_box()
    assert box
    guest.touchscreen.tap(box["x"] + 0.25 * box["width"], box["y"] + 0.75 * box["height"])
    guest.get_by_label("New note", exact=True).fill("<img src=x onerror=alert(1)> too dark")
    guest.keyboard.press("Escape")
    expect(guest.get_by_label("New note", exact=True)).to_be_hidden()
    guest.get_by_role("button", name="Add note").click()
    expect(guest.get_by_label("New note", exact=True)).to_have_value("<img src=x onerror=alert(1)> too dark")
    guest.touchscreen.tap(box["x"] + 0.25 * box["width"], box["y"] + 0.75 * box["height"])
    guest.get_by_role("button", name="Save note").click()
    expect(guest.get_by_role("alert")).to_have_text("Give your name.")
    guest.get_by_label("Your name").fill("Carla")
    guest.get_by_role("button", name="Save note").click()
    pin = guest.get_by_role("button", name="Note 1 by Carla: <img")
    expect(pin).to_be_visible()
    around, box = pin.bounding_box(), guest.get_by_role("img", name="The cover").bounding_box()
    assert around and box  # its point is at its lower left
    assert abs(around["x"] - box["x"] - 0.25 * box["width"]) < 3
    assert abs(around["y"] + around["height"] - box["y"] - 0.75 * box["height"]) < 3

    # On the open page of a user, without a reload.
    thread = anna.locator(".note-thread")
    expect(thread).to_contain_text("<img src=x onerror=alert(1)> too dark")
    expect(thread).to_contain_text("guest")
    expect(anna.locator(".tab-count")).to_have_text("1")
    anna.get_by_role("tab", name="View").click()
    anna.get_by_role("button", name="Note 1 by Carla: <img").click()  # seen in every tab, and opens its note
    expect(thread).to_be_visible()
    anna.get_by_role("button", name="Note 1 by Carla").focus()
    anna.keyboard.press("Enter")
    expect(anna.get_by_role("button", name="Note 1: show its place")).to_be_focused()
    expect(thread).to_have_class(re.compile("current"))
    thread.get_by_role("button", name="Reply").click()
    anna.keyboard.type("Brighter now")
    anna.keyboard.press("Control+Enter")
    expect(guest.locator("#notes li")).to_contain_text("Brighter now")
    guest.locator("#notes li").get_by_role("button", name="Resolve").click()
    guest.get_by_role("button", name="Approve").click()
    expect(anna.get_by_text("Approved by Carla (guest)")).to_be_visible()
    expect(anna.get_by_text("Resolved (1)")).to_be_visible()
    expect(anna.get_by_role("button", name="Note 1 by Carla")).to_have_class(re.compile("done"))  # while it is chosen

    # By keyboard: a note at the pixel under the cursor, its pin moved by arrow keys; then deleted.
    anna.locator("#main").focus()
    anna.keyboard.press("ArrowRight")
    anna.keyboard.press("Shift+N")
    anna.keyboard.type("Here")
    anna.get_by_role("button", name="New note's pin").focus()
    anna.keyboard.press("ArrowLeft")
    anna.keyboard.press("Enter")
    anna.keyboard.press("Control+Enter")
    expect(thread.filter(has_text="Here")).to_be_visible()
    note = anna.evaluate(f"fetch('api/jobs/{studio.job}/notes').then((answer) => answer.json())")[-1]
    assert (note["text"], note["author"], note["guest"]) == ("Here", "anna", False)
    assert note["x"] == pytest.approx(16.5 / 32 - 0.01) and note["y"] == pytest.approx(16.5 / 32)
    thread.filter(has_text="Here").get_by_role("button", name="Delete the note").click()
    expect(thread.filter(has_text="Here")).to_have_count(0)
    anna.get_by_role("button", name="Undo").click()
    expect(thread.filter(has_text="Here")).to_be_visible()
    context.close()
    assert not dialogs
    assert watched.errors == []


def test_picture_stays_in_view_on_phones(studio: Studio, anna: Page) -> None:
    anna.set_viewport_size({"width": 375, "height": 700})
    anna.get_by_role("tab", name="Notes").click()
    anna.evaluate("document.scrollingElement.scrollTo(0, 300)")
    box = anna.locator(".stage-box").bounding_box()
    bar = anna.locator("#topbar").bounding_box()
    assert box and bar
    assert box["y"] >= bar["y"] + bar["height"] - 1, "below the bar"
    assert box["y"] + box["height"] < 0.6 * 700, "and room below it"
    assert anna.evaluate("document.documentElement.scrollWidth") == 375
