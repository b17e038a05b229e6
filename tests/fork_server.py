"""A server that forks the processes of pytest-xdist, so that libraries which most of them use are imported once.

pytest-xdist starts each process by a command line. Here that is this file with the path of the server's socket: a small process
that sends its standard streams to the server, where a fork takes them over, and ends with the fork.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import shlex
import shutil
import socket
import subprocess
import sys
import tempfile
import warnings
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from execnet import XSpec

__all__ = ["ForkServer"]

# What the tests of at least four parts import. No module may start threads, which a fork would lack, and none may contain
# assertions of tests, which pytest rewrites.
PRELOADED = (
    *("pytest", "hypothesis", "scipy.stats", "scipy.optimize", "scipy.integrate", "scipy.ndimage", "av", "celery", "httpx"),
    *("uvicorn", "websockets.sync.client", "rayfarm", "service.farm", "service.main", "worker.tasks", "renderer.render"),
)
_STREAMS = 3


class ForkServer:
    """A running server. Its forks end with it, and it ends with the process that has started it."""

    def __init__(self) -> None:
        from renderer.child_processes import spawn_guard

        self._folder = tempfile.mkdtemp(prefix="forks-")
        self._address = f"{self._folder}/socket"
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(self._address)
            listener.listen()
            number = listener.fileno()
            command = [sys.executable, "-m", "tests.fork_server", "serve", str(number)]
            self._process = subprocess.Popen(command, pass_fds=[number], preexec_fn=spawn_guard())

    def use_for(self, specs: Sequence[XSpec]) -> None:
        """Makes pytest-xdist start the processes of these specifications through the server."""
        for spec in specs:
            spec.python = shlex.join([sys.executable, "-I", "-S", __file__, self._address])

    def stop(self) -> None:
        """Ends the server and all its forks."""
        self._process.kill()
        self._process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)


def serve(listener: socket.socket) -> None:
    """Forks a process for each connection. Returns in each fork, whose standard streams are those that it has received."""
    import gc

    gc.disable()
    for name in PRELOADED:
        with contextlib.suppress(Exception):  # raised again in the tests that import it
            importlib.import_module(name)
    with contextlib.suppress(ImportError):
        _load_declarations()
    gc.freeze()
    while True:
        connection, _ = listener.accept()
        with warnings.catch_warnings(action="ignore"):  # Python 3.12 warns of OpenBLAS's threads, which stop before a fork
            forked = os.fork()
        if forked == 0:
            break
        connection.close()
    from renderer.child_processes import die_with_parent

    listener.close()
    die_with_parent()
    _, streams, _, _ = socket.recv_fds(connection, 1, _STREAMS)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    connection.detach()  # closed when this process ends, which ends `_follow`
    gc.enable()


def _load_declarations() -> None:
    """Loads Numba's declarations for the compile target of kernels, which takes longer than compiling a small kernel."""
    from renderer.target import KernelDispatcher

    target = KernelDispatcher.targetdescr
    target.typing_context.refresh()
    target.target_context.refresh()


def _follow(address: str) -> None:
    """Passes the standard streams of this process to the server, and returns when the fork that uses them has ended."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(address)
        socket.send_fds(connection, [b"\0"], range(_STREAMS))
        for number in range(_STREAMS):
            os.close(number)
        connection.recv(1)


if __name__ == "__main__":
    if sys.argv[1] == "serve":
        serve(socket.socket(fileno=int(sys.argv[2])))
        # As in a process of `python -c CODE`, where CODE is that of execnet.
        sys.argv = ["-c"]
        main = sys.modules["__main__"] = ModuleType("__main__")
        exec(eval(sys.stdin.readline()), vars(main))
    else:
        _follow(sys.argv[1])
