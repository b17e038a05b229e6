"""A PostgreSQL server for one test process, and its databases."""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from sqlalchemy import create_engine, text
from sqlalchemy.engine import URL
from sqlalchemy.exc import OperationalError

from renderer.child_processes import spawn_guard
from service.store.database import connect

__all__ = ["PostgresServer", "find_postgres"]

PATIENCE_S = 60.0
# Options for temporary data: no durability, and no planner statistics.
QUICK = ("fsync=off", "synchronous_commit=off", "full_page_writes=off", "autovacuum=off", "jit=off")


def find_postgres() -> Path | None:
    """Returns the folder of PostgreSQL's server programs, or None if PostgreSQL is not installed.

    Debian does not put this folder on the PATH.
    """
    if found := shutil.which("pg_ctl"):
        return Path(found).parent
    return next((path.parent for path in sorted(Path("/usr/lib/postgresql").glob("*/bin/pg_ctl"), reverse=True)), None)


class PostgresServer:
    """A PostgreSQL server that listens on a Unix socket in its own folder, so that no ports can conflict.

    PostgreSQL refuses to run as root; if the tests do, the server runs as the user `nobody`. It always ends with this process.
    """

    def __init__(self, binaries: Path, options: Sequence[str] = QUICK) -> None:
        """binaries: folder of the server's programs. options: settings of the server, as `name=value`."""
        self._folder = Path(tempfile.mkdtemp(prefix="postgres-"))  # a short path: a socket's name is limited to 107 bytes
        user = pwd.getpwnam("nobody") if os.geteuid() == 0 else None
        if user is not None:
            os.chown(self._folder, user.pw_uid, user.pw_gid)
        who = {} if user is None else {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
        data = str(self._folder / "data")
        self._log = (self._folder / "log").open("wb")
        quiet = {"cwd": self._folder, "stdin": subprocess.DEVNULL, "stdout": self._log, "stderr": self._log, **who}
        initdb = [str(binaries / "initdb"), "-D", data, "-U", "farm", "-A", "trust", "-E", "UTF8", "--locale=C", "--no-sync"]
        subprocess.run(initdb, check=True, **quiet)  # type: ignore[call-overload]
        command = [str(binaries / "postgres"), "-D", data, "-k", str(self._folder), "-h", ""]
        command += [f"--{name}" for name in options]
        self._process = subprocess.Popen(command, preexec_fn=spawn_guard(), **quiet)  # type: ignore[call-overload]
        self._made = 0
        self._wait()
        self._administrator = create_engine(self.url("postgres"), isolation_level="AUTOCOMMIT")
        self.new_empty("template_of_tests")
        connect(self.url("template_of_tests"))[0].dispose()

    @property
    def pid(self) -> int:
        """Process id of the server's main process."""
        return self._process.pid

    def url(self, name: str) -> str:
        """Returns the URL of the server's database with this name."""
        return URL.create("postgresql+psycopg", "farm", database=name, query={"host": str(self._folder)}).render_as_string()

    def new(self) -> str:
        """Creates a database with the farm's tables, copied from a template; returns its URL."""
        self._made += 1
        name = f"farm_{self._made}"
        self._do(f"CREATE DATABASE {name} TEMPLATE template_of_tests")
        return self.url(name)

    def new_empty(self, name: str) -> str:
        """Creates a database without tables; returns its URL."""
        self._do(f"CREATE DATABASE {name}")
        return self.url(name)

    def drop(self, url: str) -> None:
        """Deletes a database even if it has open connections."""
        self._do(f"DROP DATABASE {url.rpartition('/')[2].partition('?')[0]} WITH (FORCE)")

    def stop(self) -> None:
        """Stops the server, and deletes its files."""
        self._administrator.dispose()
        self._process.kill()
        self._process.wait()
        self._log.close()
        shutil.rmtree(self._folder, ignore_errors=True)  # its processes end slightly later

    def _do(self, statement: str) -> None:
        with self._administrator.connect() as connection:
            connection.execute(text(statement))

    def _wait(self) -> None:
        engine = create_engine(self.url("postgres"))
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                engine.connect().close()
                break
            except OperationalError as error:
                if self._process.poll() is not None or time.monotonic() > deadline:
                    said = (self._folder / "log").read_text(errors="replace")
                    raise RuntimeError(f"PostgreSQL does not start ({error}):\n{said}") from error
                time.sleep(0.05)
        engine.dispose()
