"""Tests of notes on pictures and of reviews: by users and by guests of share links, within limits, and by nobody else."""

from __future__ import annotations

import json
import time
from typing import Any

import httpx
import pytest
from sqlalchemy import func, select

from service.access.rate_limit import RateLimit
from service.access.roles import Role
from service.jobs import notes
from service.store.models import Key, ReviewNote
from tests.rayfarm.program import rayfarm
from tests.service.api.test_access import caller
from tests.service.api.test_projects import People, checked_json, people  # noqa: F401 - `people` is a fixture
from tests.service.api.test_share_links import new_link

pytestmark = pytest.mark.usefixtures("people", "unused_rate")

SCRIPT = "<img src=x onerror=alert(1)>"


@pytest.fixture
def unused_rate(people: People) -> None:  # noqa: F811
    people.service.farm.access.note_rate = RateLimit(60.0)


def guest_of(people: People, job: str) -> tuple[httpx.Client, dict[str, Any]]:  # noqa: F811
    """Returns a client that uses a new link to a job which allows notes, and the link as the API describes it."""
    secret, link = new_link(people.anna, job, permission="comment")
    return caller(people.service, secret), link


def second_job(people: People) -> str:  # noqa: F811
    asked = {"scene": people.ids["scene"], "width": 8, "height": 8, "spp": 1}
    return str(checked_json(people.anna.post("/api/jobs", json=asked), 201)["id"])


def test_users_and_guests_write_reply_resolve_and_judge(people: People) -> None:  # noqa: F811
    job = people.ids["job"]
    path = f"/api/jobs/{job}/notes"
    assert people.anna.get(f"/api/jobs/{job}").json()["review"] is None
    guest, link = guest_of(people, job)
    with guest:
        shared = guest.get("/api/shared").json()
        assert (shared["may_comment"], shared["review"], link["permission"]) == (True, None, "comment")
        asked = {"text": f" {SCRIPT}\r\nTwo lines ", "author": "Carla", "x": 0.25, "y": 1.0}
        note = checked_json(guest.post("/api/shared/notes", json=asked), 201)
        assert note["text"] == f"{SCRIPT}\nTwo lines", "text stays text"
        assert (note["author"], note["guest"], note["frame"], note["x"], note["y"]) == ("Carla", True, 0, 0.25, 1.0)
        reply = checked_json(people.anna.post(path, json={"text": "Done", "reply_to": note["id"], "author": "Ben"}), 201)
        assert (reply["author"], reply["guest"], reply["reply_to"], reply["x"]) == ("anna", False, note["id"], None)
        assert people.anna.get(f"/api/jobs/{job}").json()["review"].items() >= {"notes": 2, "open": 1, "state": None}.items()
        done = checked_json(people.anna.patch(f"{path}/{note['id']}", json={"resolved": True}), 200)
        assert done["resolved_by"] == "anna" and done["resolved"] == pytest.approx(time.time(), abs=60)
        assert not done["resolved_guest"]
        assert people.anna.patch(f"{path}/{reply['id']}", json={"resolved": True}).status_code == 409
        assert people.anna.post(path, json={"text": "Again", "reply_to": reply["id"]}).status_code == 409
        verdict = {"state": "changes-requested", "author": "Carla"}
        judged = checked_json(guest.put("/api/shared/review", json=verdict), 200)
        assert judged.items() >= {"state": "changes-requested", "by": "Carla", "guest": True, "open": 0, "notes": 2}.items()
        assert [each["id"] for each in guest.get("/api/shared/notes").json()] == [note["id"], reply["id"]]
        again = checked_json(guest.patch(f"/api/shared/notes/{note['id']}", json={"resolved": False, "author": "Carla"}), 200)
        assert (again["resolved"], again["resolved_by"], again["resolved_guest"]) == (None, None, False)
        claimed = checked_json(guest.patch(f"/api/shared/notes/{note['id']}", json={"resolved": True, "author": "anna"}), 200)
        assert (claimed["resolved_by"], claimed["resolved_guest"]) == ("anna", True), "the name that a guest typed is unverified"
        checked_json(guest.patch(f"/api/shared/notes/{note['id']}", json={"resolved": False, "author": "Carla"}), 200)
    approved = checked_json(people.anna.put(f"/api/jobs/{job}/review", json={"state": "approved"}), 200)
    assert approved.items() >= {"state": "approved", "by": "anna", "guest": False, "open": 1}.items()
    listed = next(each for each in people.anna.get("/api/jobs").json() if each["id"] == job)
    assert listed["review"] == approved
    withdrawn = checked_json(people.anna.put(f"/api/jobs/{job}/review", json={"state": None}), 200)
    assert (withdrawn["state"], withdrawn["by"], withdrawn["at"]) == (None, None, None)
    assert people.anna.delete(f"{path}/{note['id']}").status_code == 204
    assert people.anna.get(path).json() == [], "replies are deleted with their note"
    lines = people.service.farm.access.audit.latest(20)
    of_link = [line for line in lines if line["who"] == f"link {link['id']}"]
    assert {line["what"].partition(" ")[0] for line in of_link} == {"POST", "PATCH", "PUT"}
    assert all(job in line["about"] and SCRIPT not in str(line) for line in of_link)
    assert any(line["what"] == "DELETE /api/jobs/{id}/notes/{note}" and line["who"] == "anna" for line in lines)


def test_links_that_only_show_give_no_access_to_notes(people: People) -> None:  # noqa: F811
    job = people.ids["job"]
    note = checked_json(people.anna.post(f"/api/jobs/{job}/notes", json={"text": "internal"}), 201)
    secret, link = new_link(people.anna, job)
    assert link["permission"] == "view"
    with caller(people.service, secret) as viewer, caller(people.service) as nobody:
        shared = viewer.get("/api/shared").json()
        assert (shared["may_comment"], shared["review"]) == (False, None)
        for guest, status in ((viewer, 403), (nobody, 404)):
            answers = [
                guest.get("/api/shared/notes"),
                guest.post("/api/shared/notes", json={"text": "x", "author": "x"}),
                guest.patch(f"/api/shared/notes/{note['id']}", json={"resolved": True, "author": "x"}),
                guest.put("/api/shared/review", json={"state": "approved", "author": "x"}),
            ]
            assert [answer.status_code for answer in answers] == [status] * 4
            assert not any("internal" in answer.text for answer in answers)
    looks, _ = people.service.farm.access.keys.create("token", "anna", Role.VIEW, "looks")
    with caller(people.service, looks) as reader:
        assert reader.get(f"/api/jobs/{job}/notes").json() == [note]
        assert reader.post(f"/api/jobs/{job}/notes", json={"text": "x"}).status_code == 403
    assert people.ben.get(f"/api/jobs/{job}/notes").status_code == 404, "not a member of the project"
    people.anna.delete(f"/api/jobs/{job}/notes/{note['id']}").raise_for_status()


def test_guest_reaches_notes_of_own_job_only_and_until_the_end(people: People) -> None:  # noqa: F811
    job, other = people.ids["job"], second_job(people)
    theirs = checked_json(people.anna.post(f"/api/jobs/{other}/notes", json={"text": "of the other"}), 201)
    guest, link = guest_of(people, job)
    with guest:
        assert guest.get("/api/shared/notes").json() == []
        for answer in (
            guest.patch(f"/api/shared/notes/{theirs['id']}", json={"resolved": True, "author": "x"}),
            guest.post("/api/shared/notes", json={"text": "x", "author": "x", "reply_to": theirs["id"]}),
        ):
            assert (answer.status_code, answer.json()["code"]) == (404, "note-not-found")
        assert guest.post(f"/api/jobs/{other}/notes", json={"text": "x"}).status_code == 401
        assert people.anna.get(f"/api/jobs/{other}/notes").json() == [theirs]
        with people.service.farm.sessions.begin() as session:
            row = session.get(Key, link["id"])
            assert row is not None
            row.expires = time.time() - 1
        assert guest.post("/api/shared/notes", json={"text": "x", "author": "x"}).status_code == 404
    assert people.anna.get(f"/api/jobs/{job}/notes").json() == []
    people.anna.delete(f"/api/jobs/{other}").raise_for_status()
    with people.service.farm.sessions() as session:
        assert session.scalar(select(func.count()).where(ReviewNote.job == other)) == 0


def test_link_allows_notes_only_while_its_creator_may_change_the_job(people: People) -> None:  # noqa: F811
    guest, _ = guest_of(people, people.ids["job"])
    with guest:
        assert guest.get("/api/shared/notes").status_code == 200
        checked_json(people.chief.put("/api/projects/film/members/anna", json={"role": "view"}), 200)
        assert guest.get("/api/shared/notes").status_code == 403
        assert guest.get("/api/shared").json()["may_comment"] is False
        checked_json(people.chief.put("/api/projects/film/members/anna", json={"role": "submit"}), 200)
        assert guest.get("/api/shared/notes").status_code == 200


@pytest.mark.parametrize(
    ("change", "status", "code"),
    [
        ({"text": ""}, 422, "note-empty"),
        ({"text": " \n\t "}, 422, "note-empty"),
        ({"text": "\u200b \u2060"}, 422, "note-empty"),
        ({"text": "a" * 2001}, 422, None),
        ({"text": "a\x1b[31m"}, 422, "note-control-characters"),
        ({"text": "a\u202eb"}, 422, "note-control-characters"),
        ({"author": None}, 422, "note-author-missing"),
        ({"author": "  "}, 422, "note-author-missing"),
        ({"author": "\u200b"}, 422, "note-author-missing"),
        ({"author": "a\nb"}, 422, "name-control-characters"),
        ({"author": "a" * 61}, 422, None),
        ({"x": 0.5}, 422, None),
        ({"x": 0.5, "y": 1.01}, 422, None),
        ({"x": -1e300, "y": 0}, 422, None),
        ({"x": True, "y": 0}, 422, None),
        ({"frame": 7}, 404, "job-frame-not-found"),
        ({"frame": 0.1}, 404, "job-frame-not-found"),
        ({"reply_to": "nothing"}, 404, "note-not-found"),
        ({"reply_to": "nothing", "x": 0, "y": 0}, 422, None),
        ({"job": "other"}, 422, None),
    ],
)
def test_bad_notes_are_refused(people: People, change: dict[str, Any], status: int, code: str | None) -> None:  # noqa: F811
    people.service.farm.access.note_rate = RateLimit(60.0)
    secret = bad_notes_link(people)
    with caller(people.service, secret) as guest:
        answer = guest.post("/api/shared/notes", json={"text": "good", "author": "Carla", **change})
        assert answer.status_code == status, answer.text
        assert code is None or answer.json()["code"] == code
        assert guest.get("/api/shared/notes").json() == []


def bad_notes_link(people: People) -> str:  # noqa: F811
    """Returns the secret of a link that allows notes; the same for all cases."""
    if "link" not in people.ids:
        people.ids["link"] = new_link(people.anna, people.ids["job"], permission="comment")[0]
    return people.ids["link"]


def test_a_flood_of_notes_is_stopped(people: People, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    job = people.ids["job"]
    guest, _ = guest_of(people, job)
    with guest:
        asked = {"text": "spam", "author": "Mallory"}
        answers = [guest.post("/api/shared/notes", json=asked) for _ in range(notes.MAX_PER_ADDRESS + 5)]
        assert [answer.status_code for answer in answers] == [201] * notes.MAX_PER_ADDRESS + [429] * 5
        assert 1 <= int(answers[-1].headers["retry-after"]) <= 60
        assert answers[-1].json()["code"] == "notes-too-fast"
        assert people.anna.post(f"/api/jobs/{job}/notes", json={"text": "mine"}).status_code == 201, "users are not locked out"
        # The limits on the number, without waiting for minutes.
        people.service.farm.access.note_rate = RateLimit(60.0)
        monkeypatch.setattr(notes, "MAX_OF_LINK", notes.MAX_PER_ADDRESS + 1)
        assert [guest.post("/api/shared/notes", json=asked).status_code for _ in range(3)] == [201, 409, 409]
        monkeypatch.setattr(notes, "MAX_NOTES", notes.MAX_PER_ADDRESS + 3)
        mine = [people.anna.post(f"/api/jobs/{job}/notes", json={"text": "mine"}) for _ in range(2)]
        assert [answer.status_code for answer in mine] == [201, 409]
        assert mine[-1].json()["code"] == "notes-too-many"
    review = people.anna.get(f"/api/jobs/{job}").json()["review"]
    assert review["notes"] == review["open"] == notes.MAX_NOTES


def test_command_lists_writes_resolves_and_judges(people: People) -> None:  # noqa: F811
    job = second_job(people)
    secret = people.anna.headers["authorization"].split()[1]

    def run(*arguments: str) -> tuple[int, str]:
        done = rayfarm("notes", job[:8], *arguments, RAYFARM_SERVER=people.service.url, RAYFARM_API_TOKEN=secret)
        return done.returncode, done.stdout + done.stderr

    assert run()[1].startswith("No notes yet")
    code, listed = run("[bold]Too dark\x1b[31m", "--at", "4,2")
    assert (code, "note: '[bold]Too dark" in listed) == (1, True), listed
    code, listed = run("[bold]Too dark\nhere", "--at", "4,2")
    assert (code, "  4,2  anna, 20" in listed, "\n  [bold]Too dark\n  here\n" in listed) == (0, True, True), listed
    note = people.anna.get(f"/api/jobs/{job}/notes").json()[0]
    assert (note["x"], note["y"]) == (4.5 / 8, 2.5 / 8)
    code, listed = run("Softer now", "--reply", note["id"])
    assert (code, "\n      Softer now\n" in listed) == (0, True), listed
    code, listed = run("--resolve", note["id"], "--approve")
    assert (code, "Approved by anna, 20" in listed, "resolved by anna" in listed) == (0, True, True), listed
    code, text = run("--json")
    assert (code, json.loads(text)["review"]["state"], len(json.loads(text)["notes"])) == (0, "approved", 2)
    for wrong, words in (
        (("--at", "1,1"), "Give the text"),
        (("x", "--at", "8,0"), "8x8 pixels"),
        (("--approve", "--ask-changes"), "cannot be combined"),
        (("x", "--reply", note["id"], "--at", "1,1"), "cannot be combined"),
        (("--resolve", "nothing"), "no note"),
    ):
        code, text = run(*wrong)
        assert (code != 0, words in text) == (True, True), text
    people.anna.delete(f"/api/jobs/{job}").raise_for_status()
