"""Tests of share links: what they show, to which clients, and until when."""

from __future__ import annotations

import io
import time
from typing import Any

import httpx
import pytest
from fastapi import Response
from PIL import Image

from service.access.roles import Role
from service.http.access_requirements import NEEDS
from service.routes import share_links
from service.scheduling.artifacts.artifact_result import ArtifactResult
from service.store.models import Key
from tests.service.api.test_access import ask, caller, shape
from tests.service.api.test_projects import HIDDEN, People, checked_json, people  # noqa: F401 - `people` is a fixture

pytestmark = pytest.mark.usefixtures("people")


def new_link(client: httpx.Client, job: str, **asked: Any) -> tuple[str, dict[str, Any]]:
    """Creates a share link to a job; returns (the link's secret, the link as the API describes it)."""
    link = checked_json(client.post(f"/api/jobs/{job}/links", json=asked), 201)
    page, _, secret = link["path"].partition("#")
    assert page == "shared/"
    return secret, link


def test_share_link_shows_job_without_account(people: People) -> None:  # noqa: F811
    secret, link = new_link(people.anna, people.ids["job"], days=2)
    assert link["expires"] - time.time() == pytest.approx(2 * 86400, abs=60)
    with caller(people.service, secret) as guest:
        job = guest.get("/api/shared").raise_for_status().json()
        assert (job["name"], job["state"], job["width"], job["frames"]) == (HIDDEN, "finished", 32, [0])
        assert job["expires"] == link["expires"]
        picture = guest.get("/api/shared/image.png").raise_for_status()
        assert picture.headers["cache-control"] == "no-store"
        own = people.anna.get(f"/api/jobs/{people.ids['job']}/frames/0/image.png").content
        assert Image.open(io.BytesIO(picture.content)).tobytes() == Image.open(io.BytesIO(own)).tobytes()
        query = {"exposure": 2, "tonemap": "srgb"}
        brighter = guest.get("/api/shared/image.png", params=query).raise_for_status().content
        own = people.anna.get(f"/api/jobs/{people.ids['job']}/frames/0/image.png", params=query).content
        assert Image.open(io.BytesIO(brighter)).tobytes() == Image.open(io.BytesIO(own)).tobytes()
        assert guest.get("/api/shared/image.png", params={"exposure": 99}).status_code == 422
        assert guest.get("/api/shared/image.png", params={"mix": "no-such-group:2"}).status_code == 422
    page = httpx.get(f"{people.service.url}/shared/", verify=False)
    assert "share.js" in page.text


def test_link_has_few_pictures_denoised(people: People, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    """A link may have a limited number of pictures denoised; stored ones are not counted."""
    secret, _ = new_link(people.anna, people.ids["job"])
    stored: list[ArtifactResult | None] = [None]
    monkeypatch.setattr(share_links, "MAX_DENOISED", 2)
    monkeypatch.setattr(type(people.service.farm.engine), "denoised", lambda *_: stored[0])
    reached: list[str] = []

    async def image(job: str, *_: Any, **more: Any) -> Response:
        reached.append(job)
        return Response(b"")

    monkeypatch.setattr(share_links.frames, "image", image)
    with caller(people.service, secret) as guest:
        answers = [guest.get("/api/shared/image.png", params={"denoise": True}) for _ in range(3)]
        assert [answer.status_code for answer in answers] == [200, 200, 429]
        assert answers[-1].json()["code"] == "share-link-denoised-often" and 0 < int(answers[-1].headers["Retry-After"]) <= 600
        assert guest.get("/api/shared/image.png").status_code == 200
        stored[0] = ArtifactResult("0" * 64, "v", 1)
        assert guest.get("/api/shared/image.png", params={"denoise": True}).status_code == 200
    assert len(reached) == 4


def test_share_link_gives_no_other_access(people: People) -> None:  # noqa: F811
    secret, _ = new_link(people.anna, people.ids["job"])
    with caller(people.service, secret) as guest:
        for (method, pattern), need in NEEDS.items():
            if shape(need) != "anyone":
                real = pattern.replace("{id}", people.ids["job"])
                assert ask(guest, method, real) == 401, (method, pattern)
        assert guest.get("/api/session").json()["name"] is None


def test_unknown_expired_and_revoked_links_are_rejected(people: People) -> None:  # noqa: F811
    job = people.ids["job"]
    with caller(people.service) as nobody, caller(people.service, "rayfarm-share-guessed") as guesser:
        for guest in (nobody, guesser):
            assert {guest.get("/api/shared").status_code, guest.get("/api/shared/image.png").status_code} == {404}
    with caller(people.service, people.anna.headers["authorization"].split()[1]) as token:
        assert token.get("/api/shared").status_code == 404, "a token is no share link"
    secret, link = new_link(people.anna, job)
    with caller(people.service, secret) as guest:
        assert link["id"] in [each["id"] for each in people.anna.get(f"/api/jobs/{job}/links").json()]
        assert people.anna.delete(f"/api/jobs/other/links/{link['id']}").status_code == 404
        assert guest.get("/api/shared").status_code == 200
        assert people.anna.delete(f"/api/jobs/{job}/links/{link['id']}").status_code == 204
        assert guest.get("/api/shared").status_code == 404
        assert "withdrawn" in guest.get("/api/shared").json()["detail"]
        assert people.anna.delete(f"/api/jobs/{job}/links/{link['id']}").status_code == 404
    secret, link = new_link(people.anna, job)
    with people.service.farm.sessions.begin() as session:
        row = session.get(Key, link["id"])
        assert row is not None
        row.expires = time.time() - 1
    with caller(people.service, secret) as guest:
        assert guest.get("/api/shared").status_code == 404
    assert link["id"] not in [each["id"] for each in people.anna.get(f"/api/jobs/{job}/links").json()]


def test_creating_share_link_needs_change_permission(people: People) -> None:  # noqa: F811
    path = f"/api/jobs/{people.ids['job']}/links"
    _, link = new_link(people.anna, people.ids["job"])
    assert people.ben.post(path, json={}).status_code == 404, "not a member of the project"
    assert people.ben.get(path).status_code == 404
    assert people.ben.delete(f"{path}/{link['id']}").status_code == 404
    looks, _ = people.service.farm.access.keys.create("token", "anna", Role.VIEW, "looks")
    with caller(people.service, looks) as viewer:
        assert {viewer.post(path, json={}).status_code, viewer.get(path).status_code} == {403}
    for days in (0, -1, 366, 1e300):
        assert people.anna.post(path, json={"days": days}).status_code == 422
    assert people.anna.post("/api/jobs/nothing/links", json={}).status_code == 404


def test_share_link_is_limited_by_its_creator(people: People) -> None:  # noqa: F811
    access = people.service.farm.access
    access.users.add("carl", Role.SUBMIT, None)
    checked_json(people.chief.put("/api/projects/film/members/carl"), 200)
    with caller(people.service, access.keys.create("token", "carl", Role.SUBMIT, "test")[0]) as carl:
        secret, _ = new_link(carl, people.ids["job"])
    with caller(people.service, secret) as guest:
        assert guest.get("/api/shared").status_code == 200
        people.chief.delete("/api/projects/film/members/carl").raise_for_status()
        assert guest.get("/api/shared").status_code == 404
        checked_json(people.chief.put("/api/projects/film/members/carl"), 200)
        assert guest.get("/api/shared").status_code == 200
        access.users.remove("carl")
        assert guest.get("/api/shared").status_code == 404
