"""A PostgreSQL server of this machine, for the length of a test."""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
import tempfile
from pathlib import Path

from rayfarm.local.farm import free_port

__all__ = ["find_postgres", "running_postgres"]


def find_postgres() -> Path | None:
    """The folder of the server's programs; Debian keeps them off the PATH."""
    if found := shutil.which("pg_ctl"):
        return Path(found).parent
    return next((path.parent for path in sorted(Path("/usr/lib/postgresql").glob("*/bin/pg_ctl"), reverse=True)), None)


class running_postgres:  # noqa: N801 - used like a function
    """An empty server on a free port of loopback. PostgreSQL refuses to be root: then it runs as nobody."""

    def __init__(self, binaries: Path) -> None:
        self._binaries = binaries
        self._folder = Path(tempfile.mkdtemp(prefix="postgres-"))  # a short path: the name of a socket has 107 bytes
        self._data = self._folder / "data"
        self._user = pwd.getpwnam("nobody") if os.geteuid() == 0 else None
        if self._user is not None:
            os.chown(self._folder, self._user.pw_uid, self._user.pw_gid)

    def start(self) -> str:
        """Start it; its URL."""
        port = free_port("127.0.0.1")
        self._run("initdb", "-D", str(self._data), "-U", "farm", "-A", "trust", "--no-sync")
        options = f"-h 127.0.0.1 -p {port} -k {self._folder} -F"
        self._run("pg_ctl", "-D", str(self._data), "-l", str(self._folder / "log"), "-o", options, "-w", "start")
        return f"postgresql+psycopg://farm@127.0.0.1:{port}/postgres"

    def stop(self) -> None:
        """Stop it, and remove what it wrote."""
        self._run("pg_ctl", "-D", str(self._data), "-m", "immediate", "-w", "stop")
        shutil.rmtree(self._folder)

    def _run(self, program: str, *arguments: str) -> None:
        who = {} if self._user is None else {"user": self._user.pw_uid, "group": self._user.pw_gid, "extra_groups": []}
        command = [str(self._binaries / program), *arguments]
        subprocess.run(command, check=True, cwd=self._folder, stdout=subprocess.DEVNULL, stdin=subprocess.DEVNULL, **who)
