"""Tests of the Python client and its commands with a service of another release, and with servers that are no Rayfarm."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rayfarm.cli import main
from rayfarm.client import Client, ClientError
from rayfarm.console import bar
from rayfarm.named_files import by_name
from rayfarm.responses import Job, Scene, Worker, read
from tests.foreign_server import NOT_A_FARM, foreign_server, http_answer, json_answer
from tests.grids import grid
from tests.helpers import ROOT

OLD = json.loads((ROOT / "tests" / "data" / "release-0.1.0.json").read_text())
CORNELL = ROOT / "scenes" / "cornell-box.yaml"

ASKING: dict[str, Callable[[Client], Any]] = {
    "upload": lambda farm: farm.upload([CORNELL]),
    "scene": lambda farm: farm.scene("s"),
    "scenes": lambda farm: farm.scenes(),
    "wait_for_scene": lambda farm: farm.wait_for_scene("s"),
    "submit": lambda farm: farm.submit("s", width=16, height=16),
    "job": lambda farm: farm.job("j"),
    "jobs": lambda farm: farm.jobs(),
    "change": lambda farm: farm.change("j", priority=1),
    "wait": lambda farm: farm.wait("j"),
    "image": lambda farm: farm.image("j"),
    "frames": lambda farm: farm.frames("j"),
    "movie": lambda farm: farm.movie("j"),
    "digest": lambda farm: farm.digest("j"),
    "workers": lambda farm: farm.workers(),
}


def command(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    """Runs a command in this process; returns (exit code, standard output, standard error)."""
    before, sys.argv = sys.argv, ["rayfarm", *map(str, arguments)]
    try:
        with pytest.raises(SystemExit) as ended:
            main()
    finally:
        sys.argv = before
    said = capsys.readouterr()
    return int(ended.value.code or 0), said.out, said.err


@grid("name", NOT_A_FARM)
def test_every_method_detects_other_servers(name: str) -> None:
    answer, words = NOT_A_FARM[name]
    with foreign_server(answer) as port, Client(f"http://127.0.0.1:{port}") as farm:
        for method, ask in ASKING.items():
            with pytest.raises(ClientError, match="not a Rayfarm service") as said:
                ask(farm)
            if method in ("upload", "job", "digest") and name != "other JSON":
                assert words in str(said.value)


@grid("name", NOT_A_FARM)
def test_every_command_fails_with_message_for_other_servers(
    name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    with foreign_server(NOT_A_FARM[name][0]) as port:
        for arguments in (
            ["jobs"],
            ["jobs", "7f3a"],
            ["jobs", "--json"],
            ["submit", CORNELL],
            ["submit", CORNELL, "--wait", "-o", tmp_path / "out.png"],
        ):
            code, out, err = command(capsys, *arguments, f"--server=127.0.0.1:{port}")
            assert code == 1
            assert out == ""
            assert "it is not a Rayfarm service" in err
            assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_upload_accepts_paths_and_strings() -> None:
    here = Path("a")
    expected = {"x.obj": here / "x.obj", "x.mtl": here / "x.mtl"}
    assert by_name(["a/x.obj", here / "x.mtl"]) == expected
    assert by_name({"x.obj": "a/x.obj", "x.mtl": here / "x.mtl"}) == expected
    assert by_name("a/x.obj") == by_name(here / "x.obj") == {"x.obj": here / "x.obj"}


def test_list_from_farm_is_accepted() -> None:
    def answer(request: bytes) -> bytes:
        return json_answer({"name": "rayfarm", "version": "0.1.0"} if b"/api/info" in request else [])

    with foreign_server(answer) as port, Client(f"127.0.0.1:{port}") as farm:
        assert farm.jobs() == []
        assert farm.workers() == []


@grid(
    ("answer", "words"),
    [
        (http_answer(b"<html>Bad Gateway", "text/html", "502 Bad Gateway"), "answers 502"),
        (http_answer(b"", "text/html", "503 Service Unavailable"), "answers 503"),
        (http_answer(b"<html>login", "text/html", "401 Unauthorized"), "it asks for a login"),
        (http_answer(b'{"id": "x"', length=9000), "does not answer"),
        (b"SSH-2.0-OpenSSH_9.2\r\n", "does not answer"),
        (b"", "does not answer"),
        (
            http_answer(
                json.dumps({"status": 507, "detail": "The disk is full. Delete scenes or jobs."}).encode(),
                "application/problem+json",
                "507 Insufficient Storage",
            ),
            "Delete scenes or jobs",
        ),
    ],
)
def test_server_error_gives_message(answer: bytes, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with foreign_server(answer) as port:
        for arguments in (["jobs"], ["submit", CORNELL]):
            code, _, err = command(capsys, *arguments, f"--server=http://127.0.0.1:{port}")
            assert code == 1
            assert words in err
            assert "Traceback" not in err


def test_unreachable_farm_and_invalid_address_give_messages(capsys: pytest.CaptureFixture[str]) -> None:
    for server, words in (
        ("http://127.0.0.1:9", "No farm answers"),
        ("http://exa mple", "not the address"),
        ("http://[", "not the address"),
        ("ftp://host", "not the address"),
        ("host:99999", "not the address"),
    ):
        code, _, err = command(capsys, "jobs", "--server", server)
        assert code == 1
        assert words in err


def test_square_brackets_in_names_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    about = {"id": "98cb", "name": "[/nightly]", "role": "view", "user": "anna", "created": 0, "expires": None, "seen": None}
    with foreign_server(lambda asked: json_answer([about])) as port:
        code, said, _ = command(capsys, "token", "list", "--server", f"http://127.0.0.1:{port}")
    assert (code, "[/nightly]" in said) == (0, True)
    with bar() as progress:
        progress.add_task('Waits until "[/b]" is finished.')
        assert any('"[/b]"' in str(cell) for cell in progress.make_tasks_table(progress.tasks).columns[0].cells)


def test_loopback_bypasses_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HTTP_PROXY", "http_proxy", "ALL_PROXY", "all_proxy"):
        monkeypatch.setenv(name, "socks5://127.0.0.1:9")
    monkeypatch.setenv("NO_PROXY", "")
    with foreign_server(json_answer([{"id": "j"}])) as port, Client(f"http://127.0.0.1:{port}") as farm:
        assert farm.call("GET", "/api/jobs") == [{"id": "j"}]
    with pytest.raises(ClientError, match="proxy"):
        Client("http://studio.example:8000")


def test_ids_are_quoted_in_urls() -> None:
    asked: list[str] = []

    def answer(request: bytes) -> bytes:
        asked.append(request.split(b" ")[1].decode())
        return http_answer(b"{}", status="404 Not Found")

    with foreign_server(answer) as port, Client(f"http://127.0.0.1:{port}") as farm:
        for id in ("../scenes/s", "?limit=1", ""):
            with pytest.raises(ClientError):
                farm.change(id, priority=1)
        with pytest.raises(ClientError, match="cannot be sent"):
            farm.submit("s", noise=float("nan"))
    assert asked == ["/api/jobs/..%2Fscenes%2Fs", "/api/jobs/%3Flimit%3D1", "/api/jobs/-"]


def test_endless_response_is_aborted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rayfarm.client.MAX_ANSWER", 1 << 20)
    monkeypatch.setattr("rayfarm.client.MAX_PICTURE", 1 << 21)

    def endless(request: bytes) -> Iterator[bytes]:
        yield b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nConnection: close\r\n\r\n"
        while True:
            yield b" " * 65536

    with foreign_server(endless) as port, Client(f"127.0.0.1:{port}") as farm:
        for ask in (lambda: farm.job("j"), lambda: farm.image("j")):
            with pytest.raises(ClientError, match="exceeds the size limit"):
                ask()


def test_responses_of_other_releases_are_read() -> None:
    newer = {"scene": OLD["scene"] | {"owner": "Ann"}, "worker": OLD["worker"] | {"gpus": 2}}
    newer["job"] = OLD["job"] | {"deadline": 7.0, "frames": [OLD["job"]["frames"][0] | {"time": 0.5}]}
    for answers in (OLD, newer):
        scene = read(Scene, answers["scene"])
        assert (scene.status, scene.cameras[0].name, scene.counts["triangles"]) == ("ready", "front", 12)
        assert scene.cameras[0].view["fov"] == 40.0
        job = read(Job, answers["job"])
        assert (job.state, job.progress, job.frames[0].number, job.is_over) == ("finished", 1.0, 0, True)
        assert read(Worker, answers["worker"]).state == "ready"


def test_missing_field_is_named_in_error() -> None:
    for cls, name, missing in ((Scene, "scene", "status"), (Job, "job", "state"), (Worker, "worker", "slots")):
        cut = {key: value for key, value in OLD[name].items() if key != missing}
        with pytest.raises(ValueError, match=f"its {name} lacks {missing}"):
            read(cls, cut)
        with pytest.raises(ValueError, match=f"its {name} cannot be read \\({missing}"):
            read(cls, OLD[name] | {missing: {"of": "another type"}})


def farm_that(state: str, picture: bytes = b"", uploads: list[bytes] | None = None) -> Callable[[bytes], bytes]:
    """Returns a function that answers HTTP requests like a service of release 0.1.0 with one job, which is in `state`.

    picture: the bytes of the job's picture. uploads: if given, requests that upload scenes are appended to it.
    """

    def answer(request: bytes) -> bytes:
        if b"/api/scenes" in request:
            if uploads is not None:
                uploads.append(request)
            return json_answer(OLD["scene"])
        if b"/api/workers" in request:
            return json_answer([OLD["worker"]])
        if b"/image." in request:
            return http_answer(picture, "image/png").replace(b"Connection", b"X-Samples: 12\r\nConnection")
        return json_answer(OLD["job"] | {"state": state, "error": "The disk is full.", "message": "Waits for a worker."})

    return answer


def test_picture_is_downloaded_completely(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    output = tmp_path / "out.png"
    output.write_bytes(b"an older one")
    with foreign_server(farm_that("finished", b"\x89PNG...")) as port:
        code, _, err = command(capsys, "submit", CORNELL, "-o", output, f"--server=127.0.0.1:{port}")
    assert code == 0, err
    assert output.read_bytes() == b"\x89PNG..."
    assert list(tmp_path.iterdir()) == [output]


@pytest.mark.parametrize(
    ("denoises", "more", "is_shown"), [(True, (), True), (False, (), False), (True, ("--frames=0-1",), False)]
)
def test_still_is_shown_denoised_where_a_worker_denoises(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, denoises: bool, more: tuple[str, ...], is_shown: bool
) -> None:
    submitted = []

    def answer(request: bytes) -> bytes:
        return (
            json_answer([OLD["worker"] | {"denoises": denoises}]) if b"/api/workers" in request else farm_that("running")(request)
        )

    def submit(self: Client, scene: str, **asked: Any) -> Job:
        submitted.append(asked)
        return read(Job, OLD["job"])

    monkeypatch.setattr(Client, "submit", submit)
    with foreign_server(answer) as port:
        code, _, err = command(capsys, "submit", CORNELL, *more, f"--server=127.0.0.1:{port}")
    assert code == 0, err
    assert [asked.get("denoise", False) for asked in submitted] == [is_shown]


@pytest.mark.parametrize(("name", "query"), [("out.png", b"exposure=1.5&tonemap=agx"), ("out.exr", b"")])
def test_look_is_the_jobs_and_the_files(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str, query: bytes
) -> None:
    requests, submitted = [], []

    def submit(self: Client, scene: str, **asked: Any) -> Job:
        submitted.append(asked)
        return read(Job, OLD["job"])

    def answer(request: bytes) -> bytes:
        requests.append(request)
        return farm_that("finished", b"picture")(request)

    given = ("-o", tmp_path / name, "--exposure=1.5", "--tonemap=agx")
    monkeypatch.setattr(Client, "submit", submit)
    with foreign_server(answer) as port:
        code, _, err = command(capsys, "submit", CORNELL, *given, f"--server=127.0.0.1:{port}")
    assert code == 0, err
    assert [(asked["exposure"], asked["tonemap"]) for asked in submitted] == [(1.5, "agx")]
    (picture,) = (request.split()[1] for request in requests if b"/image." in request)
    assert query in picture and (b"exposure" in picture) == bool(query)


def test_failed_job_prints_its_error(capsys: pytest.CaptureFixture[str]) -> None:
    for state, words in (("failed", "The disk is full."), ("cancelled", "was cancelled before it was finished")):
        with foreign_server(farm_that(state)) as port:
            code, _, err = command(capsys, "submit", CORNELL, "--wait", f"--server=127.0.0.1:{port}")
        assert code == 1
        assert words in err


def test_output_path_is_checked_before_upload(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    uploads: list[bytes] = []
    (tmp_path / "folder.png").mkdir()

    def read_only(*_: Any, **__: Any) -> Any:
        raise OSError(30, "Read-only file system")

    with foreign_server(farm_that("finished", uploads=uploads)) as port:
        for output, words in (
            (tmp_path / "folder.png", "is a folder"),
            (tmp_path / "missing" / "out.png", "There is no folder"),
            (tmp_path / ("x" * 300 + ".png"), "cannot be written"),
        ):
            code, _, err = command(capsys, "submit", CORNELL, "-o", output, f"--server=127.0.0.1:{port}")
            assert code == 1
            assert words in err
        monkeypatch.setattr("rayfarm.output_files.tempfile.NamedTemporaryFile", read_only)
        code, _, err = command(capsys, "submit", CORNELL, "-o", tmp_path / "out.png", f"--server=127.0.0.1:{port}")
        assert code == 1
        assert "Read-only file system" in err
    assert uploads == []


def test_full_disk_keeps_older_picture(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "out.png"
    output.write_bytes(b"an older one")

    def full(self: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with foreign_server(farm_that("finished", b"\x89PNG...")) as port:
        code, _, err = command(capsys, "submit", CORNELL, "-o", output, f"--server=127.0.0.1:{port}")
    assert code == 1
    assert "No space left on device" in err
    assert f"The farm keeps the picture: http://127.0.0.1:{port}/#/jobs/" in err
    assert output.read_bytes() == b"an older one"
    assert list(tmp_path.iterdir()) == [output]


def test_truncated_picture_is_not_written(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    def answer(request: bytes) -> bytes:
        if b"/image." in request:
            return http_answer(b"\x89PNG", "image/png", length=5000).replace(b"Connection", b"X-Samples: 12\r\nConnection")
        return farm_that("finished")(request)

    with foreign_server(answer) as port:
        code, _, err = command(capsys, "submit", CORNELL, "-o", tmp_path / "out.png", f"--server=127.0.0.1:{port}")
    assert code == 1
    assert "does not answer" in err
    assert not list(tmp_path.iterdir())


def test_ctrl_c_ends_with_130(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: Any, **__: Any) -> Any:
        raise KeyboardInterrupt

    with foreign_server(farm_that("running")) as port:
        monkeypatch.setattr("rayfarm.client.time.sleep", interrupt)
        code, _, err = command(capsys, "submit", CORNELL, "--wait", f"--server=127.0.0.1:{port}")
        assert code == 130
        assert "The job continues" in err
        monkeypatch.setattr(Client, "jobs", interrupt)
        assert command(capsys, "jobs", f"--server=127.0.0.1:{port}")[0] == 130


def test_waiting_job_shows_reason(capsys: pytest.CaptureFixture[str]) -> None:
    def answer(request: bytes) -> bytes:
        return json_answer([OLD["job"] | {"state": "queued", "message": "Waits for a worker: none is connected.", "error": None}])

    with foreign_server(answer) as port:
        code, out, _ = command(capsys, "jobs", f"--server=127.0.0.1:{port}")
    assert code == 0
    assert "Waits for a worker: none is connected." in out


def test_unreachable_service_is_retried(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = [http_answer(b"", "text/html", "503 Service Unavailable"), b"", json_answer(OLD["job"])]
    sleep = time.sleep
    monkeypatch.setattr("rayfarm.client.time.sleep", lambda seconds: sleep(0.01))
    with foreign_server(lambda request: answers.pop(0)) as port, Client(f"127.0.0.1:{port}") as farm:
        assert farm.wait("j").state == "finished"
