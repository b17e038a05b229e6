"""Tests of `rayfarm worker` without a farm: it ends with an error message, or waits and prints what it waits for."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from rayfarm import graphics_card, joining
from rayfarm.commands import worker as worker_command
from rayfarm.errors import CommandError
from renderer.cuda.cards import Cards
from renderer.cuda.driver import Card
from tests.foreign_server import NOT_A_FARM, foreign_server, json_answer
from tests.grids import grid
from tests.helpers import ROOT
from tests.rayfarm.program import rayfarm
from worker.__main__ import _options

WORKER = ("worker", "--slots=1")


@grid(
    ("module", "without"),
    [("rayfarm.commands.worker", "numpy httpx"), ("renderer.scene.readers.pbrt", "trimesh scipy.spatial")],
    ordinary=("rayfarm.commands.worker",),
)
def test_worker_imports_no_unused_library(module: str, without: str) -> None:
    """Libraries that a worker does not use are not imported, since its start delays the whole farm."""
    found = subprocess.check_output([sys.executable, "-c", f"import sys, {module}; print(*sys.modules)"], cwd=ROOT, text=True)
    assert not set(without.split()) & set(found.split())


@pytest.mark.long
@grid(
    ("answer", "words"),
    [
        NOT_A_FARM["html"],
        (json_answer({"redis_url": None, "instance": "i", "data_dir": ""}), "RAYFARM_PUBLIC_REDIS_URL"),
    ],
    ids=["html", "no redis_url"],
    ordinary=("no redis_url",),
)
def test_other_server_ends_worker_with_error(answer: bytes, words: str) -> None:
    with foreign_server(answer) as port:
        done = rayfarm(*WORKER, "--token=t", f"--join=127.0.0.1:{port}", RAYFARM_REDIS_URL="")
    assert done.returncode == 1
    assert words in done.stderr
    assert "starts again" not in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.long
def test_unreachable_redis_is_retried_until_ctrl_c() -> None:
    with foreign_server(json_answer({"redis_url": "redis://127.0.0.1:9/0", "instance": "i", "data_dir": ""})) as port:
        command = [sys.executable, "-m", "rayfarm", *WORKER, "--token=t", f"--join=127.0.0.1:{port}"]
        env = {**os.environ, "COLUMNS": "160", "RAYFARM_REDIS_URL": ""}
        process = subprocess.Popen(command, cwd=ROOT, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert process.stderr is not None
        said = ""
        deadline = time.monotonic() + 60
        while "no Redis server answers at redis://127.0.0.1:9/0" not in said and time.monotonic() < deadline:
            said += process.stderr.readline()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
        assert "no Redis server answers at redis://127.0.0.1:9/0" in said
        assert process.returncode == 0
        assert "Traceback" not in said + err


def test_invalid_options_give_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for join, sentence in (("127.0.0.1:9", "RAYFARM_CACHE"), ("http://exa mple", "not the address")):
        done = rayfarm(*WORKER, "--token=t", f"--join={join}", RAYFARM_CACHE=str(tmp_path / "file"))
        assert done.returncode == 1
        assert sentence in done.stderr
        assert "Traceback" not in done.stderr


@pytest.mark.long
def test_token_argument_gives_warning(tmp_path: Path) -> None:
    shown: list[str | None] = []

    class Refuses(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            shown.append(self.headers["Authorization"])
            self.send_error(401)

        def log_message(self, *_: object) -> None:
            pass

    (tmp_path / "token").write_text("of-a-file\n")
    with ThreadingHTTPServer(("127.0.0.1", 0), Refuses) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        join = f"--join=127.0.0.1:{server.server_port}"
        for how in (f"--token-file={tmp_path / 'token'}", "--token=seen"):
            done = rayfarm(*WORKER, join, how)
            assert done.returncode == 1
            assert ("can read --token" in done.stderr) == how.startswith("--token=")
        server.shutdown()
    assert shown == ["Bearer of-a-file", "Bearer seen"]
    done = rayfarm(*WORKER, "--join=127.0.0.1:9", "--token-file=/not/there")
    assert done.returncode == 1
    assert "/not/there" in done.stderr


@pytest.mark.parametrize("command", (("worker", "--join=127.0.0.1:9", "--token=t"), ("render", "no.obj", "-o", "no.png")))
def test_missing_card_gives_error(command: tuple[str, ...], tmp_path: Path) -> None:
    gpu, named = ("--gpu=only", "--gpu only") if command[0] == "worker" else ("--gpu", "--gpu")
    (tmp_path / "libcuda.so.1").write_text("no library")
    done = rayfarm(*command, gpu, LD_LIBRARY_PATH=str(tmp_path))
    assert done.returncode == 1
    said = done.stderr.replace("\n", " ")
    assert f"rayfarm: {named}: No graphics card is used: the NVIDIA driver's library cannot be loaded" in said
    assert "Leave out --gpu to render with the processor." in said
    assert "Traceback" not in done.stderr


def test_invalid_card_selection_gives_error() -> None:
    done = rayfarm("worker", "--join=127.0.0.1:9", "--token=t", "--gpu=first")
    assert done.returncode == 1
    assert "--gpu is 'first'; give auto, none, all, only, or numbers such as 0,1" in done.stderr.replace("\n", " ")


@pytest.mark.parametrize(("gpu", "slots"), (("auto", 2), ("none", 2), ("only", 1), ("all", 3), ("0", 3)))
def test_cards_option_is_passed_to_the_worker(gpu: str, slots: int, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[Any] = []
    found = Cards([Card(0, "RTX Test", (8, 6), 8 << 30, 1)], [])
    monkeypatch.setattr(worker_command, "run", lambda *given: started.append(given))
    monkeypatch.setattr(graphics_card, "find_cards", lambda: found)
    monkeypatch.setattr(worker_command, "use_log_format", lambda format: None)
    app = typer.Typer()
    worker_command.register(app)
    given = ["--join=127.0.0.1:9", "--token=t", "--slots=2", "--name=attic", "--nice=5"]
    done = CliRunner().invoke(app, given if gpu == "auto" else [*given, f"--gpu={gpu}"])
    assert done.exit_code == 0, done.output
    ((_, _, _, sentence, arguments, _),) = started
    common = ["--service", "http://127.0.0.1:9", "--slots", "2", "--transport=auto", "--nice=5"]
    assert arguments == [*common, f"--gpu={gpu}", "--name", "attic"]
    monkeypatch.setattr("sys.argv", ["worker", *arguments])
    assert (_options().slots, _options().gpu) == (2, gpu)
    assert f"with {slots} slots" in sentence


def test_refused_process_ends_the_command_with_its_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """If the process ends with an exit code after which no restart helps, the command shows its log and raises its message."""
    monkeypatch.setenv("RAYFARM_CACHE", str(tmp_path))
    program = """
import sys
print("rayfarm worker: started with", sys.stdin.readline().strip(), "\\nThe library ends.", flush=True)
sys.exit(3)
"""
    with pytest.raises(CommandError, match=r"started with .*ends-at-once"):
        joining.run("worker", [sys.executable, "-c", program], "t", "Joining.", ["ends-at-once"])
    shown = capfd.readouterr()
    assert "ends-at-once" in shown.err
    assert not list((tmp_path / "logs").glob("*.log"))
