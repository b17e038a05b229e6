"""The service in a separate process, which tests may kill."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx

from rayfarm.local.farm import free_port
from renderer.child_processes import spawn_guard
from tests.helpers import ROOT
from tests.service.conftest import TOKEN

__all__ = ["LEASE_S", "Started"]

LEASE_S = 1.0


class Started:
    """A service in a separate process, with its URL, its log file and an HTTP client."""

    def __init__(self, data: Path, name: str, **settings: Any) -> None:
        port = free_port("127.0.0.1")
        self.url = f"http://127.0.0.1:{port}"
        self.log = data.parent / f"{name}.log"
        told = {
            "data": data,
            "token": TOKEN,
            "port": port,
            "lease_s": LEASE_S,
            "reuse_films": False,
            "batch_deadline": 2.0,
            **settings,
        }
        environment = {f"RAYFARM_{name.upper()}": str(value) for name, value in told.items()}
        command = [sys.executable, "-m", "service", "--no-access-log", f"--port={port}"]
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                command, cwd=ROOT, env={**os.environ, **environment}, stdout=log, stderr=log, preexec_fn=spawn_guard()
            )
        self.http = httpx.Client(base_url=self.url, timeout=20)

    def says(self, path: str = "/readyz") -> str:
        """Returns `ready`, or the message of the readiness probe at `path`, or the error of an unanswered request."""
        try:
            answer = self.http.get(path).json()
        except httpx.HTTPError as error:
            return str(error)
        return str(answer.get("status", answer.get("detail")))

    def is_ready(self) -> bool:
        return self.says() == "ready"

    def stands_by(self) -> bool:
        return "stands by" in self.says()

    def job(self, id: str) -> dict[str, Any]:
        answer = self.http.get(f"/api/jobs/{id}")
        return answer.json() if answer.is_success else {"samples": -1, "state": answer.text}

    def end(self) -> None:
        self.process.send_signal(signal.SIGCONT)
        self.process.kill()
        self.process.wait()
        self.http.close()
