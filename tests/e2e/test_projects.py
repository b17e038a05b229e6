"""The switch of project: what is uploaded goes there, and lists show what is in it."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Watched
from tests.e2e.test_login import service  # noqa: F401
from tests.service.conftest import OBJ, Service, until

pytestmark = pytest.mark.browser


def test_the_switch_is_there_for_members_and_chooses_what_is_shown(
    service: Service,  # noqa: F811
    watched: Watched,
    tmp_path: Path,
) -> None:
    page = watched.page
    token = (tmp_path / "data" / "owner-token").read_text().strip()
    with httpx.Client(base_url=service.url, headers={"Authorization": f"Bearer {token}"}, verify=False) as owner:
        owner.post("/api/users", json={"name": "anna", "role": "submit"}).raise_for_status()
        owner.post("/api/projects", json={"name": "feature"}).raise_for_status()
        owner.post("/api/scenes", files={"files": ("shared.obj", OBJ)}).raise_for_status()
        code = owner.post("/api/links", json={"user": "anna"}).raise_for_status().json()["code"]
        switch = page.get_by_label("Project", exact=True)

        page.goto(f"{service.url}/#/login?code={code}")
        expect(page.get_by_role("heading", name="anna")).to_be_visible()
        expect(switch).to_have_count(0)

        owner.put("/api/projects/feature/members/anna").raise_for_status()
        page.goto("about:blank")
        page.goto(service.url)
        expect(page.get_by_text("shared", exact=True).first).to_be_visible()
        switch.select_option(label="feature")
        expect(switch).to_have_value("p:feature")
        expect(page.get_by_role("navigation")).to_be_visible()
        expect(page.get_by_text("shared", exact=True)).to_have_count(0)

        with page.expect_file_chooser() as chooser:
            page.get_by_role("button", name="Choose files").click()
        chooser.value.set_files([{"name": "secret.obj", "mimeType": "text/plain", "buffer": OBJ}])
        expect(page.get_by_text("secret").first).to_be_visible()
        until(lambda: _projects(owner) == {"secret": "feature", "shared": ""}, "it is uploaded")

        page.goto(f"{service.url}/#/")
        switch.select_option(label="All projects")
        expect(page.get_by_text("shared", exact=True).first).to_be_visible()
        expect(page.get_by_text("secret", exact=True).first).to_be_visible()

        owner.delete("/api/projects/feature/members/anna").raise_for_status()
        page.reload()
        expect(page.get_by_text("shared", exact=True).first).to_be_visible()
        expect(page.get_by_text("secret", exact=True)).to_have_count(0)
        expect(switch).to_have_count(0)


def _projects(owner: httpx.Client) -> dict[str, str]:
    return {each["name"]: each["project"] for each in owner.get("/api/scenes").json()}
