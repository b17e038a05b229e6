"""Tests that items of a project are visible only to its members, on every route and socket."""

from __future__ import annotations

import contextlib
import io
import json
import re
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import httpx
import pytest
from PIL import Image
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from service.http import gate
from service.http.access_requirements import NEEDS, PROJECT_RESOURCES, resource_of
from service.store.models import Job
from tests.helpers import running_redis
from tests.service.api.test_access import caller
from tests.service.conftest import OBJ, Service, until
from tests.service.peer_worker import PeerWorker

HIDDEN = "moonlight"  # word in the names of all items in the project
# Routes with a path parameter that is not an item of a project.
OTHERS = re.compile(r"/api/(farm|tokens|users|projects|shares|quotas|workers|hooks|examples|shared)")
ROLE = {"anna": "submit", "ben": "submit"}


@dataclass
class People:
    """HTTP clients of three users, each with a token.

    anna is a member of the project, ben is a member of no project, and chief is an administrator.
    """

    anna: httpx.Client
    ben: httpx.Client
    chief: httpx.Client
    service: Service
    ids: dict[str, str]


@pytest.fixture(scope="module")
def people(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[People]:
    service = Service(tmp_path_factory.mktemp("projects") / "data", redis_server, host="0.0.0.0")
    with contextlib.ExitStack() as ends:
        ends.callback(service.stop)
        token = (service.options["data"] / "owner-token").read_text().strip()
        chief = ends.enter_context(caller(service, token))
        found = People(*(ends.enter_context(client_of(service, name)) for name in ROLE), chief, service, {})
        checked_json(chief.post("/api/projects", json={"name": "film"}), 201)
        checked_json(chief.put("/api/projects/film/members/anna"), 200)
        ends.enter_context(PeerWorker(service.options["redis_url"], service.url, service.options["token"]))
        found.ids = create_items(found.anna)
        yield found


def client_of(service: Service, name: str) -> httpx.Client:
    """Returns a client with the token of a new user."""
    from service.access.roles import Role

    access = service.farm.access
    access.users.add(name, Role.from_name(ROLE[name]), None)
    return caller(service, access.keys.create("token", name, Role.from_name(ROLE[name]), "test")[0])


def checked_json(answer: httpx.Response, status: int) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    found: dict[str, Any] = answer.json()
    return found


def create_items(anna: httpx.Client) -> dict[str, str]:
    """Creates one item of each kind in the project as anna; returns their ids by kind.

    All items have the same word in their names.
    """
    into = {"project": "film"}
    scene = checked_json(anna.post("/api/scenes", params=into, files={"files": (f"{HIDDEN}.obj", OBJ)}), 201)
    assert scene["project"] == "film"
    until(lambda: anna.get(f"/api/scenes/{scene['id']}").json()["status"] == "ready", "it is prepared")
    picture = checked_json(anna.post("/api/references", params=into, files={"file": (f"{HIDDEN}.png", png(7))}), 201)
    light = checked_json(anna.post("/api/environments", params=into, files={"file": (f"{HIDDEN}.png", png(8))}), 201)
    asked = {"scene": scene["id"], "width": 32, "height": 32, "spp": 4, "tile_size": 16, "name": HIDDEN}
    asked["environment"] = {"image": light["id"]}
    job = checked_json(anna.post("/api/jobs", json=asked), 201)
    assert (job["project"], job["user"]) == ("film", "anna")
    until(lambda: anna.get(f"/api/jobs/{job['id']}").json()["state"] == "finished", "it is rendered")
    return {"scene": scene["id"], "reference": picture["id"], "environment": light["id"], "job": job["id"]}


def png(grey: int) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (8, 4), (grey, grey, grey)).save(file, "PNG")
    return file.getvalue()


def path_of(pattern: str, id: str) -> str:
    for name, value in {"{id}": id, "{n}": "0", "{frame}": "0", "{extension}": "png", "{spp}": "4"}.items():
        pattern = pattern.replace(name, value)
    return pattern


def test_every_path_with_id_is_classified() -> None:
    for method, pattern in NEEDS:
        named = resource_of(pattern, pattern)
        if "{" in pattern and named is None:
            assert OTHERS.match(pattern), f"{method} {pattern}: whose is it? Say so in service/http/access_requirements.py"
        collection = pattern.split("/")[2] if pattern.startswith("/api/") else ""
        assert collection not in PROJECT_RESOURCES or "{" not in pattern or named is not None, pattern


def test_project_content_is_404_for_others(people: People) -> None:
    asked = {"POST": {}, "PATCH": {"priority": 1}}
    walked = 0
    for method, pattern in NEEDS:
        found = resource_of(pattern, pattern)
        if found is None or method == "WS" or method == "DELETE":
            continue
        kind = found[0]
        real, none = people.ids[kind], "0" * len(people.ids[kind])
        query = {"x": 999, "y": 999} if pattern.endswith(("pixel", "explain")) else {}
        answers = [people.ben.request(method, path_of(pattern, id), json=asked.get(method), params=query) for id in (real, none)]
        assert [answer.status_code for answer in answers] == [404, 404], (method, pattern)
        assert answers[0].text == answers[1].text.replace(none, real), (method, pattern)
        of_hers = people.anna.request(method, path_of(pattern, real), json=asked.get(method), params=query)
        assert "There is no" not in of_hers.text or of_hers.status_code != 404, (method, pattern, of_hers.text)
        walked += 1
    assert walked > 20
    for kind, id in people.ids.items():
        assert people.ben.delete(f"/api/{kind}s/{id}").status_code == 404
        assert people.anna.get("/api/projects").json()[0]["counts"][kind] == 1


def test_lists_hide_project_content(people: People) -> None:
    told = 0
    for method, pattern in NEEDS:
        if method != "GET" or "{" in pattern or pattern == "/api/events" or pattern.startswith(("/docs", "/openapi")):
            continue
        for query in ({}, {"project": "film"}):
            answer = people.ben.get(pattern, params=query)
            assert HIDDEN not in answer.text, pattern
            assert not any(id in answer.text for id in people.ids.values()), pattern
            told += HIDDEN in people.anna.get(pattern, params=query).text
    assert told >= 8  # scenes, jobs, environments, references and more
    assert people.ben.get("/api/jobs/tallies").json()["finished"] == 0
    assert people.anna.get("/api/jobs/tallies").json()["finished"] == 1
    assert people.ben.get("/api/jobs", params={"search": HIDDEN, "ids": people.ids["job"]}).json() == []
    assert people.ben.get("/api/projects").json() == []
    assert people.anna.get("/api/jobs", params={"project": ""}).json() == []
    assert HIDDEN in people.chief.get("/api/scenes").text


def test_requests_cannot_refer_to_hidden_content(people: People) -> None:
    ids, ben = people.ids, people.ben
    size = {"width": 16, "height": 16, "spp": 1}
    refused = ben.post("/api/jobs", json={"scene": ids["scene"], **size})
    unknown = ben.post("/api/jobs", json={"scene": "0" * 20, **size})
    assert refused.status_code == unknown.status_code == 404
    assert refused.text == unknown.text.replace("0" * 20, ids["scene"])
    own = checked_json(ben.post("/api/scenes", files={"files": ("own.obj", OBJ)}), 201)
    assert own["id"] != ids["scene"], "the same files elsewhere are another scene"
    after = ben.post("/api/jobs", json={"scene": own["id"], "after": [ids["job"]], **size})
    assert (after.status_code, "no job" in after.text) == (404, True)
    lit = ben.post("/api/jobs", json={"scene": own["id"], "environment": {"image": ids["environment"]}, **size})
    assert (lit.status_code, "no image" in lit.text) == (422, True)
    added = ben.post("/api/scenes", files={"files": ("x.mtl", b"newmtl x")}, data={"base": ids["scene"]})
    assert (added.status_code, "no scene" in added.text) == (404, True)
    changed = checked_json(ben.post("/api/jobs/changes", json={"jobs": [ids["job"], "0"], "state": "deleted"}), 200)
    assert [len(changed["changed"]), len(changed["refused"])] == [0, 2]
    for route in ("scenes", "references", "environments", "examples/cornell-box"):
        files = {"files" if route == "scenes" else "file": ("x.png", png(9))}
        answer = ben.post(f"/api/{route}", params={"project": "film"}, files=files)
        assert (answer.status_code, "or you are not a member of it. GET /api/projects lists yours" in answer.text) == (
            404,
            True,
        ), route
    key = {"Idempotency-Key": "hers"}
    hers = checked_json(people.anna.post("/api/jobs", json={"scene": ids["scene"], **size}, headers=key), 201)
    probed = ben.post("/api/jobs", json={"scene": ids["scene"], **size}, headers=key)
    assert (probed.status_code, hers["id"] in probed.text) == (404, False)
    people.anna.delete(f"/api/jobs/{hers['id']}")


def test_extended_scene_stays_in_project(people: People) -> None:
    base = people.ids["scene"]
    more = checked_json(people.anna.post("/api/scenes", files={"files": ("x.mtl", b"newmtl x")}, data={"base": base}), 201)
    assert (more["project"], more["id"] != base) == ("film", True)
    assert people.ben.get(f"/api/scenes/{more['id']}").status_code == 404
    assert people.anna.delete(f"/api/scenes/{more['id']}").status_code == 204


def closing(people: People, who: httpx.Client, path: str) -> tuple[int, str]:
    url = f"{people.service.url.replace('http', 'ws', 1)}{path}"
    with connect(url, additional_headers={"Authorization": who.headers["authorization"]}) as socket:
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                socket.recv(timeout=20)
        assert closed.value.rcvd is not None
        return closed.value.rcvd.code, closed.value.rcvd.reason


def test_websocket_of_hidden_job_closes_like_missing_job(people: People) -> None:
    for path, kind in (("/api/jobs/{}/live", "job"), ("/api/scenes/{}/viewport", "scene")):
        none = "0" * len(people.ids[kind])
        code, reason = closing(people, people.ben, path.format(people.ids[kind]))
        assert (code, reason.replace(people.ids[kind], none)) == closing(people, people.ben, path.format(none))
        assert code == 4404


def test_removed_member_loses_access_at_once(people: People, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate, "REAUTHORIZE_EVERY_S", 0.1)
    checked_json(people.chief.put("/api/projects/film/members/ben"), 200)
    job = f"/api/jobs/{people.ids['job']}"
    assert people.ben.get(job).status_code == 200
    ended: list[tuple[int, str]] = []
    thread = threading.Thread(target=lambda: ended.append(closing(people, people.ben, f"{job}/live")))
    thread.start()
    until(lambda: people.service.farm.broadcast.watchers == 1, "ben watches")
    checked_json(people.chief.delete("/api/projects/film/members/ben"), 200)
    assert people.ben.get(job).status_code == 404
    thread.join(30)
    assert ended
    assert ended[0][0] == gate.NOT_THERE, "not as somebody who is logged out"
    assert "You can no longer see this: you are not a member of its project any more" in ended[0][1]


def test_read_only_member_cannot_change_content(people: People) -> None:
    found = checked_json(people.chief.put("/api/projects/film/members/ben", json={"role": "view"}), 200)
    assert found["roles"] == {"anna": "submit", "ben": "view"}
    try:
        ids, into = people.ids, {"project": "film"}
        walked = 0
        for method, pattern in NEEDS:
            thing = resource_of(pattern, pattern)
            if thing is None or method in ("GET", "WS"):
                continue
            answer = people.ben.request(method, path_of(pattern, ids[thing[0]]))
            assert (answer.status_code, "but not change it. Ask the administrator of this farm" in answer.text) == (403, True), (
                method,
                pattern,
                answer.text,
            )
            walked += 1
        assert walked >= 5
        assert HIDDEN in people.ben.get("/api/jobs").text
        asked = {"scene": ids["scene"], "width": 8, "height": 8, "spp": 1}
        refused = [
            people.ben.post("/api/jobs", json=asked),
            people.ben.post("/api/scenes", params=into, files={"files": ("mine.obj", OBJ)}),
            people.ben.post("/api/scenes", data={"base": ids["scene"]}, files={"files": ("mine.obj", OBJ + b"# mine\n")}),
            people.ben.post("/api/references", params=into, files={"file": ("mine.png", png(9))}),
            people.ben.post("/api/environments", params=into, files={"file": ("mine.png", png(9))}),
        ]
        assert [answer.status_code for answer in refused] == [403] * len(refused), [answer.text for answer in refused]
        many = checked_json(people.ben.post("/api/jobs/changes", json={"jobs": [ids["job"]], "state": "deleted"}), 200)
        assert (many["changed"], len(many["refused"])) == ([], 1)
        assert "but not change it. Ask the administrator of this farm" in many["refused"][0]["why"]
        checked_json(people.ben.post("/api/scenes", files={"files": ("mine.obj", OBJ + b"# his\n")}), 201)
        assert people.anna.get(f"/api/jobs/{ids['job']}").json()["name"] == HIDDEN

        checked_json(people.chief.put("/api/projects/film/members/ben"), 200)
        checked_json(people.ben.patch(f"/api/jobs/{ids['job']}", json={"pinned": True}), 200)
    finally:
        checked_json(people.chief.delete("/api/projects/film/members/ben"), 200)


def test_event_stream_hides_project_content(people: People) -> None:
    told: dict[str, str] = {"anna": "", "ben": ""}

    def listen(name: str, client: httpx.Client) -> None:
        with client.stream("GET", "/api/events") as stream:
            for text in stream.iter_text():
                told[name] += text
                if "the last" in told[name]:
                    return

    threads = [threading.Thread(target=listen, args=(name, getattr(people, name)), daemon=True) for name in told]
    for thread in threads:
        thread.start()
    until(lambda: all("retry" in text for text in told.values()), "both listen")
    asked = {"scene": people.ids["scene"], "width": 16, "height": 16, "spp": 1, "name": HIDDEN}
    job = checked_json(people.anna.post("/api/jobs", json=asked), 201)["id"]
    until(lambda: people.anna.get(f"/api/jobs/{job}").json()["state"] == "finished", "it is rendered")
    until(lambda: job in told["anna"], "she is told")
    assert people.anna.delete(f"/api/jobs/{job}").status_code == 204
    checked_json(people.anna.post("/api/scenes", files={"files": ("the last.obj", OBJ + b"# the last\n")}), 201)
    for thread in threads:
        thread.join(20)
        assert not thread.is_alive()
    assert HIDDEN in told["anna"]
    assert HIDDEN not in told["ben"]
    assert job not in told["ben"]
    assert not any(id in told["ben"] for id in people.ids.values())


@pytest.mark.long
def test_hidden_work_of_worker_is_shown_as_busy(people: People) -> None:
    asked = {"scene": people.ids["scene"], "width": 64, "height": 64, "spp": 100_000, "tile_size": 16}
    job = checked_json(people.anna.post("/api/jobs", json=asked), 201)["id"]

    def slots(client: httpx.Client) -> str:
        return json.dumps([worker["current"] for worker in client.get("/api/workers").json()])

    until(lambda: job in slots(people.anna), "a slot has it in hand")
    until(lambda: '"hidden": true' in slots(people.ben), "he sees that one is busy")
    assert job not in slots(people.ben)
    assert people.anna.delete(f"/api/jobs/{job}").status_code == 204


def test_idempotency_keys_are_per_user(people: People) -> None:
    scene = checked_json(people.ben.post("/api/scenes", files={"files": ("open.obj", OBJ + b"# open\n")}), 201)["id"]
    until(lambda: people.ben.get(f"/api/scenes/{scene}").json()["status"] == "ready", "it is prepared")
    asked = {"scene": scene, "width": 8, "height": 8, "spp": 1}
    key = {"Idempotency-Key": "nightly"}
    jobs = [
        checked_json(client.post("/api/jobs", json=asked, headers=key), 201)["id"]
        for client in (people.anna, people.ben, people.anna)
    ]
    assert (jobs[0] == jobs[2], jobs[0] == jobs[1]) == (True, False)
    again = people.anna.post("/api/jobs", json=asked, headers=key)
    assert (again.headers["Idempotent-Replayed"], again.headers["Location"]) == ("true", f"/api/jobs/{jobs[0]}")
    with people.service.farm.sessions.begin() as session:
        session.get_one(Job, jobs[0]).idempotency_key = "of before"
    old = {"Idempotency-Key": "of before"}
    assert people.anna.post("/api/jobs", json=asked, headers=old).json()["id"] == jobs[0]
    other = checked_json(people.ben.post("/api/jobs", json=asked, headers=old), 201)["id"]
    assert other not in jobs
    for job in {*jobs, other}:
        assert people.chief.delete(f"/api/jobs/{job}").status_code == 204
    assert people.chief.delete(f"/api/scenes/{scene}").status_code == 204


def test_users_see_only_their_shares(people: People) -> None:
    shares = {name: {row["share"] for row in client.get("/api/shares").json()} for name, client in _clients(people).items()}
    assert shares == {"anna": {"user:anna"}, "ben": {"user:ben"}, "chief": {"user:anna", "user:ben"}}
    try:
        checked_json(people.chief.put("/api/shares/project:film", json={"weight": 2}), 200)
        shares = {name: {row["share"] for row in client.get("/api/shares").json()} for name, client in _clients(people).items()}
        assert ["project:film" in shares[name] for name in ("anna", "ben", "chief")] == [True, False, True]
        assert people.chief.put("/api/shares/project:", json={}).status_code == 422
    finally:
        checked_json(people.chief.delete("/api/shares/project:film"), 200)
    assert not any("project:" in row["share"] for row in people.chief.get("/api/shares").json())


def _clients(people: People) -> dict[str, httpx.Client]:
    return {"anna": people.anna, "ben": people.ben, "chief": people.chief}


def test_administrators_create_and_delete_projects(people: People) -> None:
    assert people.anna.post("/api/projects", json={"name": "mine"}).status_code == 403
    assert people.anna.put("/api/projects/film/members/ben").status_code == 403
    for name in ("Film", "a b", "../x", ""):
        assert people.chief.post("/api/projects", json={"name": name}).status_code == 422
    assert people.chief.post("/api/projects", json={"name": "film"}).status_code == 409
    assert people.chief.put("/api/projects/film/members/nobody").status_code == 404
    assert people.chief.put("/api/projects/none/members/anna").status_code == 404
    full = people.chief.delete("/api/projects/film")
    assert (full.status_code, "1 scene" in full.text) == (409, True)
    checked_json(people.chief.post("/api/projects", json={"name": "short"}), 201)
    assert people.chief.delete("/api/projects/short").status_code == 204
    assert [found["name"] for found in people.chief.get("/api/projects").json()] == ["film"]
