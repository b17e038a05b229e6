"""Tests of the project menu: uploads go into the selected project, and lists show only its items."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Watched
from tests.e2e.test_login import service  # noqa: F401
from tests.service.conftest import OBJ, Service, until


@pytest.mark.long
def test_project_menu_filters_lists_for_members(
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
        expect(switch).to_be_hidden()

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

        owner.put("/api/projects/feature/members/anna", json={"role": "view"}).raise_for_status()
        page.reload()
        expect(page.locator(".card", has_text="shared").get_by_role("button")).to_have_count(1)
        expect(page.locator(".card", has_text="secret").get_by_role("button")).to_have_count(0)
        expect(page.get_by_role("button", name="Choose files")).to_be_visible()
        switch.select_option(label="feature")
        expect(page.get_by_text("secret", exact=True).first).to_be_visible()
        expect(page.get_by_role("button", name="Choose files")).to_be_hidden()
        page.get_by_role("link", name="secret").click()
        expect(page.get_by_role("heading", name="secret")).to_be_visible()
        expect(page.get_by_role("button", name="Delete this scene")).to_be_hidden()
        page.goto(f"{service.url}/#/")

        owner.delete("/api/projects/feature/members/anna").raise_for_status()
        page.reload()
        expect(page.get_by_text("shared", exact=True).first).to_be_visible()
        expect(page.get_by_text("secret", exact=True)).to_have_count(0)
        expect(switch).to_be_hidden()
        expect(page.get_by_role("heading", name="Examples")).to_be_visible()

        owner.patch("/api/users/anna", json={"role": "view"}).raise_for_status()
        page.reload()
        expect(page.get_by_text("shared", exact=True).first).to_be_visible()
        for what in (page.get_by_role("heading", name="Examples"), page.get_by_role("button", name="Choose files")):
            expect(what).to_be_hidden()
        page.goto(f"{service.url}/#/jobs")
        expect(page.get_by_role("heading", name="Jobs")).to_be_visible()
        page.keyboard.press("?")
        expect(page.get_by_role("dialog")).to_contain_text("Next job")
        expect(page.get_by_role("dialog")).not_to_contain_text("Delete the selection")
        page.goto(f"{service.url}/#/")
        scene = owner.get("/api/scenes", params={"project": ""}).json()[0]["id"]
        owner.delete(f"/api/scenes/{scene}").raise_for_status()
        expect(page.get_by_text("Nothing here yet")).to_be_visible()


def _projects(owner: httpx.Client) -> dict[str, str]:
    return {each["name"]: each["project"] for each in owner.get("/api/scenes").json()}


@pytest.mark.long
def test_administrator_manages_projects_and_limits(service: Service, watched: Watched, tmp_path: Path) -> None:  # noqa: F811
    page = watched.page
    token = (tmp_path / "data" / "owner-token").read_text().strip()
    with httpx.Client(base_url=service.url, headers={"Authorization": f"Bearer {token}"}, verify=False) as owner:
        for name in ("anna", "ben"):
            owner.post("/api/users", json={"name": name, "role": "submit"}).raise_for_status()
        owner.post("/api/tokens", json={"name": "nightly", "role": "submit", "days": 1}).raise_for_status()
        code = owner.post("/api/links", json={}).raise_for_status().json()["code"]
        page.goto(f"{service.url}/#/login?code={code}")
        page.get_by_role("link", name="Logged in as owner").click()

        part = page.locator("section", has=page.get_by_role("heading", name="Projects", exact=True))
        part.get_by_label("Name", exact=True).fill("Feature")
        part.get_by_role("button", name="Create a project").click()
        expect(page.get_by_label("Project", exact=True)).to_be_visible()
        part.get_by_label("New member of feature", exact=True).select_option("ben")
        part.get_by_label("Role of the new member of feature").select_option("view")
        part.get_by_role("button", name="Add").click()
        expect(part.get_by_label("Role of ben in feature")).to_have_value("view")
        part.get_by_label("Role of ben in feature").select_option("submit")
        until(lambda: _feature(owner)["roles"] == {"ben": "submit"}, "he may render there")
        part.get_by_role("button", name="Add").click()
        expect(part.get_by_text("All users are members.")).to_be_visible()
        part.get_by_role("button", name="Take ben out of feature").click()
        expect(part.get_by_text("1 member", exact=True)).to_be_visible()
        assert _feature(owner)["members"] == ["anna"]

        limits = page.locator("section", has=page.get_by_role("heading", name="Limits of users and tokens"))
        limits.get_by_label("Uploads and films, GB: anna").fill("2.5")
        limits.get_by_label("Unfinished jobs: anna").fill("7")
        limits.get_by_label("Samples a day, millions: anna").fill("3")
        limits.get_by_label("Samples a day, millions: anna").blur()
        until(
            lambda: _limits(owner, "user:anna") == (2_500_000_000, 7, 3_000_000),
            "she has limits",
            say=lambda: _limits(owner, "user:anna"),
        )
        expect(limits.get_by_text("own limits")).to_have_count(1)
        limits.get_by_role("button", name="Use the default limits for anna").click()
        until(lambda: _limits(owner, "user:anna") == (None, None, None), "she has none")
        limits.get_by_role("button", name="Limit a token too").click()
        limits.get_by_label("Unfinished jobs: nightly of owner").fill("1")
        limits.get_by_label("Unfinished jobs: nightly of owner").blur()
        (row,) = owner.get("/api/tokens", params={"all": True}).json()
        until(lambda: _limits(owner, f"token:{row['id']}") == (None, 1, None), "the token has one")

        part.get_by_role("button", name="Remove feature").click()
        expect(page.get_by_label("Project", exact=True)).to_be_hidden()
        assert owner.get("/api/projects").json() == []
    assert watched.errors == []


def _feature(owner: httpx.Client) -> dict[str, Any]:
    found: dict[str, Any] = owner.get("/api/projects").json()[0]
    return found


def _limits(owner: httpx.Client, whose: str) -> tuple[int | None, ...] | None:
    rows = {row["whose"]: row["limits"] for row in owner.get("/api/quotas").json()}
    return tuple(rows[whose].values()) if whose in rows else None
