"""Tests of login in the browser, on a farm reachable by other machines: by a link, logout, and by password."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Watched
from tests.helpers import running_redis
from tests.service.conftest import Service

PASSWORD = "four quiet words here"


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    server = running_redis(tmp_path)
    with server:
        service = Service(tmp_path / "data", server, host="0.0.0.0")
        yield service
        service.stop()


def test_login_by_link_logout_and_login_by_password(service: Service, watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    page.set_viewport_size({"width": 640, "height": 480})
    token = (tmp_path / "data" / "owner-token").read_text().strip()
    with httpx.Client(base_url=service.url, headers={"Authorization": f"Bearer {token}"}, verify=False) as owner:
        owner.post("/api/users", json={"name": "anna", "role": "submit"}).raise_for_status()
        code = owner.post("/api/links", json={"user": "anna"}).raise_for_status().json()["code"]

        page.goto(f"{service.url}/#/workers")
        expect(page.get_by_role("heading", name="Log in to Rayfarm")).to_be_visible()
        expect(page.get_by_role("navigation")).to_be_hidden()
        assert watched.errors == []

        page.goto(f"{service.url}/#/login?code={code}")  # in the same tab, only the URL changes
        expect(page.get_by_role("heading", name="anna")).to_be_visible()
        assert code not in page.url
        assert page.evaluate("[document.cookie, document.referrer]") == ["", ""]
        page.get_by_label("New password").fill(PASSWORD)
        page.get_by_role("button", name="Change the password").click()
        expect(page.get_by_text("All other browsers are logged out.")).to_be_visible()

        page.goto(f"{service.url}/#/workers")
        expect(page.get_by_role("heading", name="Workers", exact=True)).to_be_visible()
        page.get_by_role("button", name="More", exact=True).click()
        page.get_by_role("link", name="Logged in as anna").click()
        expect(page.get_by_role("link", name="Logged in as anna")).to_be_hidden()
        page.get_by_role("button", name="Log out").click()
        page.get_by_label("Name").fill("Anna ")
        page.get_by_label("Password").fill("not it")
        page.get_by_role("button", name="Log in").click()
        expect(page.get_by_role("alert")).to_contain_text("name or the password is wrong")
        page.get_by_label("Password").fill(PASSWORD)
        page.get_by_role("button", name="Log in").click()
        expect(page.get_by_role("heading", name="anna")).to_be_visible()

        owner.delete("/api/users/anna").raise_for_status()
        expect(page.get_by_role("heading", name="Log in to Rayfarm")).to_be_visible()


@pytest.mark.long
def test_used_login_link_shows_message(service: Service, watched: Watched) -> None:
    watched.page.goto(f"{service.url}/#/login?code=used")
    expect(watched.page.get_by_role("alert")).to_contain_text("This link was already used")
    assert "used" not in watched.page.url.partition("#")[2]


@pytest.mark.long
def test_administrator_adds_and_removes_users(service: Service, watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    token = (tmp_path / "data" / "owner-token").read_text().strip()
    with httpx.Client(base_url=service.url, headers={"Authorization": f"Bearer {token}"}, verify=False) as owner:
        code = owner.post("/api/links", json={}).raise_for_status().json()["code"]
        page.goto(f"{service.url}/#/login?code={code}")
        page.get_by_role("link", name="Logged in as owner").click()
        users = page.locator("section", has=page.get_by_role("heading", name="Users"))
        users.get_by_label("Name").fill("Ben")
        users.get_by_role("button", name="Add a user").click()
        expect(users.get_by_role("status")).to_contain_text("#/login?code=rayfarm-link-")
        users.get_by_label("Role of ben").select_option("view")
        tokens = page.locator("section", has=page.get_by_role("heading", name="Tokens"))
        tokens.get_by_label("Purpose").fill("nightly")
        tokens.get_by_role("button", name="Create a token").click()
        expect(tokens.get_by_role("status")).to_contain_text("rayfarm-token-")
        secret = tokens.get_by_role("status").locator("code").inner_text()
        with httpx.Client(base_url=service.url, headers={"Authorization": f"Bearer {secret}"}, verify=False) as script:
            assert script.get("/api/session").json()["role"] == "submit"
            tokens.get_by_role("button", name="Withdraw nightly").click()
            expect(tokens.get_by_role("listitem")).to_have_count(0)
            assert script.get("/api/jobs").status_code == 401
        page.get_by_text("Who did what").click()
        expect(page.get_by_role("cell", name="PATCH /api/users/{name}")).to_be_visible()
        assert [user["role"] for user in owner.get("/api/users").json()] == ["view"]
        users.get_by_role("button", name="Remove ben").click()
        expect(users.get_by_role("listitem")).to_have_count(0)
        assert owner.get("/api/users").json() == []
    assert watched.errors == []
