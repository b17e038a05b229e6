"""Runs the program `rayfarm` for tests, in a new process or in this one."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from rayfarm.cli import main
from tests.helpers import ROOT

__all__ = ["rayfarm", "run_program"]

LISTENS_TO = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def run_program(*arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs the program in a new process, and returns its exit code and output."""
    command = [sys.executable, "-m", "rayfarm", *map(str, arguments)]
    return subprocess.run(
        command, cwd=ROOT, env={**os.environ, "COLUMNS": "160", **environment}, capture_output=True, text=True, timeout=120
    )


def rayfarm(*arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs the program in this process, which has already loaded numba and the kernels; returns its exit code and output."""
    stdout, stderr, code = io.StringIO(), io.StringIO(), 0
    before, listened = dict(os.environ), {number: signal.getsignal(number) for number in LISTENS_TO}
    mask = os.umask(0o077)
    os.umask(mask)
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(stderr):
        patch.chdir(ROOT)
        patch.setattr(sys, "argv", ["rayfarm", *map(str, arguments)])
        for name, value in {"COLUMNS": "160", **environment}.items():
            patch.setenv(name, value)
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
        finally:
            for number, handler in listened.items():
                signal.signal(number, handler)
            os.umask(mask)  # `up` makes new files private to its user
            os.environ.clear()
            os.environ.update(before)
    return subprocess.CompletedProcess(sys.argv, code, stdout.getvalue(), stderr.getvalue())
