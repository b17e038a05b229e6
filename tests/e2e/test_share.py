"""Tests of share links in a browser: created on a job's page, opened without an account, withdrawn."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.conftest import Watched
from tests.helpers import running_redis
from tests.service.conftest import OBJ, Service, until
from tests.service.peer_worker import PeerWorker

pytestmark = pytest.mark.long


def test_share_link_is_created_opened_and_revoked(browser: Browser, watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    server = running_redis(tmp_path)
    with server:
        service = Service(tmp_path / "data", server, host="0.0.0.0")
        token = (tmp_path / "data" / "owner-token").read_text().strip()
        with (
            httpx.Client(base_url=service.url, headers={"Authorization": f"Bearer {token}"}, verify=False) as owner,
            PeerWorker(service.options["redis_url"], service.url, service.options["token"]),
        ):
            owner.post("/api/users", json={"name": "anna", "role": "submit"}).raise_for_status()
            code = owner.post("/api/links", json={"user": "anna"}).raise_for_status().json()["code"]
            scene = owner.post("/api/scenes", files={"files": ("cover.obj", OBJ)}).raise_for_status().json()["id"]
            until(lambda: owner.get(f"/api/scenes/{scene}").json()["status"] == "ready", "it is prepared")
            asked = {"scene": scene, "width": 32, "height": 32, "spp": 4, "name": "The cover"}
            job = owner.post("/api/jobs", json=asked).raise_for_status().json()["id"]
            until(lambda: owner.get(f"/api/jobs/{job}").json()["state"] == "finished", "it is rendered")

            page.goto(f"{service.url}/#/login?code={code}")
            expect(page.get_by_role("heading", name="anna")).to_be_visible()
            page.goto(f"{service.url}/#/jobs/{job}")
            page.get_by_role("tab", name="Save").click()
            share = page.get_by_role("region", name="Share")
            share.get_by_role("button", name="Create link").click()
            address = share.locator("code").text_content() or ""
            assert address.startswith(f"{service.url}/shared/#rayfarm-share-")

            context = browser.new_context()
            guest = context.new_page()
            requested: list[str] = []
            guest.on("request", lambda request: requested.append(request.url))
            guest.goto(address)
            expect(guest.get_by_role("heading", name="The cover")).to_be_visible()
            expect(guest.get_by_role("status")).to_have_text("Finished")
            expect(guest.get_by_role("img", name="The cover")).to_be_visible()
            expect(guest.get_by_role("link", name="Save PNG")).to_have_attribute("download", "The cover.png")
            assert not [url for url in requested if "rayfarm-share-" in url.partition("#")[0]], "the secret is never in a URL"

            share.get_by_role("button", name="Withdraw the link").click()
            expect(share.locator("code")).to_have_count(0)
            guest.reload()
            expect(guest.get_by_role("alert")).to_contain_text("expired or was withdrawn")
            context.close()
        service.stop()
    assert watched.errors == []
