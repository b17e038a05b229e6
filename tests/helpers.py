"""Real processes for tests: a Redis server, and a whole farm started by `rayfarm up`."""

from __future__ import annotations

import json
import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import psutil
import pytest
import redis

from rayfarm.client import Client
from rayfarm.local import broker
from rayfarm.local.farm import free_port
from renderer.child_processes import spawn_guard
from renderer.sentences import Sentence

ROOT = Path(__file__).resolve().parent.parent
PORTS = 5  # that are tried for a server


class running_redis:  # noqa: N801 - used like a function
    """Redis server on a free port, which runs during a `with` block. `stop` and `start` may be called within the block."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.port = free_port("127.0.0.1")
        self.password = secrets.token_hex(8)
        self.process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        """The server's URL, with its password."""
        return f"redis://:{self.password}@127.0.0.1:{self.port}/0"

    def start(self) -> None:
        """Starts the server; fails if it does not answer within 10 s."""
        config = self.folder / "redis.conf"
        broker.write_config(config, "127.0.0.1", self.port, self.password)
        with (self.folder / "redis.log").open("ab") as log:
            self.process = process = subprocess.Popen(
                [str(broker.find_server()), str(config)], stdout=log, stderr=log, preexec_fn=spawn_guard()
            )
        try:
            wait_until(lambda: self._answers() or process.poll() is not None, 10, "Redis answers")
            assert process.returncode is None, (self.folder / "redis.log").read_text()
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    def _answers(self) -> bool:
        try:
            with redis.Redis.from_url(self.url) as store:
                return bool(store.ping())
        except redis.RedisError:
            return False

    def __enter__(self) -> str:
        for _ in range(PORTS - 1):
            try:
                self.start()
            except AssertionError:  # another process has taken the port meanwhile
                self.port = free_port("127.0.0.1")
            else:
                return self.url
        self.start()
        return self.url

    def __exit__(self, *_: object) -> None:
        self.stop()


def code_of(error: BaseException) -> str:
    """Returns the code of the sentence that an error carries; '' if its message is plain text."""
    return Sentence.from_text(str(error)).code


def wait_until(condition: Callable[[], bool], seconds: float, what: str) -> None:
    """Waits until a condition is true; fails with `what` after `seconds`."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail(f"after {seconds:g} s not true: {what}")
        time.sleep(0.05)


@dataclass
class Farm:
    """Farm in processes of its own, started by the command `rayfarm up`."""

    data: Path
    process: subprocess.Popen[bytes]
    url: str = ""
    token: str = ""
    log: Path = field(default_factory=Path)

    def client(self) -> Client:
        return Client(self.url)

    def pids(self) -> dict[str, int]:
        """Returns the current process ids of the farm's parts."""
        return dict(json.loads((self.data / "farm.json").read_text())["pids"])

    def family(self) -> list[psutil.Process]:
        """Returns all processes of the farm."""
        me = psutil.Process(self.process.pid)
        return [me, *me.children(recursive=True)]

    def logs(self) -> str:
        """Returns the last lines of all logs, for messages of failed tests."""
        files = [self.log, *sorted((self.data / "logs").glob("*.log"))]
        return "\n".join(f"--- {path.name}\n{path.read_text(errors='replace')[-3000:]}" for path in files if path.exists())


def start_farm(
    data: Path, workers: int, until: bytes = b"Ready", module: str = "rayfarm", gpu: str = "none", **environment: str
) -> Farm:
    """Starts `rayfarm up` on a free port; returns when it has printed `until`, by default when all slots are ready.

    module: the program, run with Python's `-m`. gpu: which graphics cards render; by default not even this machine's own.
    """
    command = [sys.executable, "-m", module, "up", "--port=0", f"--workers={workers}", f"--data={data}", "--no-browser"]
    return farm_of(command if gpu == "auto" else [*command, f"--gpu={gpu}"], data, ROOT, until, **environment)


def farm_of(command: list[str], data: Path, cwd: Path, until: bytes = b"Ready", **environment: str) -> Farm:
    """Starts a farm by a given command, with its data in `data`; returns when it has printed `until`.

    Jobs do not reuse films, so that repeated jobs are rendered again.
    """
    environment = {"RAYFARM_REUSE_FILMS": "false", "RAYFARM_IDLE_POSTERS": "false", **environment}
    log = data.parent / f"{data.name}-up.log"
    before = log.stat().st_size if log.exists() else 0  # of an earlier farm in this folder
    with log.open("ab") as out:
        process = subprocess.Popen(
            command,
            cwd=cwd,
            env={**os.environ, **environment},
            stdout=out,
            stderr=out,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=spawn_guard(),
        )
    farm = Farm(data, process, log=log)
    deadline = time.monotonic() + 240
    while until not in log.read_bytes()[before:]:
        if process.poll() is not None or time.monotonic() > deadline:
            stop_farm(farm)
            pytest.fail(f"the farm does not start\n{farm.logs()}")
        time.sleep(0.05)
    known = json.loads((data / "farm.json").read_text())
    farm.url, farm.token = known["url"], known["token"]
    return farm


def stop_farm(farm: Farm, sig: int = signal.SIGTERM) -> None:
    """Stops the farm with a signal; kills it if it does not end."""
    if farm.process.poll() is None:
        farm.process.send_signal(sig)
        try:
            farm.process.wait(30)
        except subprocess.TimeoutExpired:
            farm.process.kill()
            farm.process.wait()
