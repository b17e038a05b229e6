"""Processes that `rayfarm up` and `rayfarm worker` start first, so that their imports run in parallel with the command line's.

Each waits until the supervisor writes its options to its standard input (renderer.child_processes.wait_for_start_line), and
ends with this process. This module imports little, since every import before `start_processes` delays the processes.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from renderer.child_processes import spawn_guard

__all__ = ["SERVICE", "WORKER", "end_processes", "start_processes", "take_process", "waiting_command"]

SERVICE, WORKER = "service.standby", "worker.standby"
_ROOT = Path(__file__).resolve().parents[2]
_loading: dict[str, subprocess.Popen[bytes]] = {}


def waiting_command(module: str) -> list[str]:
    """Returns the command line of a process that imports a module and then waits for its options."""
    return [sys.executable, "-m", module]


def start_processes(modules: Sequence[str]) -> None:
    """Starts one process for each module, which imports the module and waits for its options.

    If one cannot be started, the supervisor tries again later and reports the reason.
    """
    atexit.register(end_processes)
    for module in modules:
        try:
            _loading[module] = subprocess.Popen(
                waiting_command(module),
                cwd=_ROOT,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
                umask=0o077,
                preexec_fn=spawn_guard(),
            )
        except (OSError, subprocess.SubprocessError):
            return


def take_process(module: str) -> subprocess.Popen[bytes] | None:
    """Returns the waiting process of a module, which then belongs to the caller; None if there is none."""
    return _loading.pop(module, None)


def end_processes() -> None:
    """Ends the waiting processes that were not taken."""
    for process in _loading.values():
        process.kill()
        process.communicate()
    _loading.clear()
