"""A site reducer in a separate process, controlled by a test or benchmark."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import redis

from protocol.site import SiteReport, site_key
from renderer.child_processes import spawn_guard
from tests.helpers import ROOT, wait_until

__all__ = ["ReducerProcess"]


class ReducerProcess:
    """Process of a site reducer, started by the constructor. Its data stays in `folder`, where a later process finds it."""

    def __init__(self, store: redis.Redis, service: str, token: str, folder: Path, name: str = "attic", port: int = 0) -> None:
        self.store = store
        self.name = name
        self.log = folder / "reducer.log"
        command = [sys.executable, "-m", "worker.site.reducer", f"--service={service}", f"--name={name}"]
        command += ["--host=127.0.0.1", "--address=127.0.0.1", f"--port={port}", f"--folder={folder / 'sites'}"]
        told = os.environ | {"RAYFARM_TOKEN": token}
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(command, cwd=ROOT, stdout=log, stderr=log, env=told, preexec_fn=spawn_guard())
        wait_until(self._is_there, 60, "the reducer is there")

    def report(self) -> SiteReport | None:
        """Returns the reducer's latest report; None if it has stopped reporting."""
        data = self.store.get(site_key(self.name))
        return SiteReport.from_bytes(data) if isinstance(data, bytes) else None

    def kill(self) -> None:
        """Kills the process with SIGKILL."""
        self.process.kill()
        self.process.wait()

    def stop(self) -> int:
        """Stops the process as by Ctrl-C; returns its exit code."""
        self.process.terminate()
        return self.process.wait(60)

    def _is_there(self) -> bool:
        assert self.process.poll() is None, self.log.read_text()
        report = self.report()
        return report is not None and report.pid == self.process.pid
