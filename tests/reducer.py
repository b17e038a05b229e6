"""A site's reducer as a process of its own, in the hands of a test or a benchmark."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import redis

from protocol.site import SiteReport, site_key
from renderer.child_processes import spawn_guard
from tests.helpers import ROOT, wait_until

__all__ = ["Reducing"]


class Reducing:
    """Started where it is made; what it has lies in `folder`, also for the next one."""

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
        """Its latest; None where it tells none any more."""
        data = self.store.get(site_key(self.name))
        return SiteReport.from_bytes(data) if isinstance(data, bytes) else None

    def kill(self) -> None:
        """With SIGKILL."""
        self.process.kill()
        self.process.wait()

    def stop(self) -> int:
        """As a person does; its exit code."""
        self.process.terminate()
        return self.process.wait(60)

    def _is_there(self) -> bool:
        assert self.process.poll() is None, self.log.read_text()
        report = self.report()
        return report is not None and report.pid == self.process.pid
