"""The process that forks readers: started once by a program, with an empty environment and without its descriptors.

The launcher imports modules and loads kernels when a job first needs them, so that a reader starts within milliseconds. It never
opens an untrusted file. It has one thread, and ends when every process that holds the other end of its socket has ended.

A request is one datagram: JSON with `preload`, and three descriptors: the job's pipe, the pipe for messages, and the pipe on
which the launcher sends the reader's exit status. When a caller closes the job's pipe, the launcher kills the reader.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import select
import signal
import socket
import sys
import sysconfig
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from renderer.confine import reader
from renderer.errors import MachineError
from renderer.library_messages import library_message
from renderer.sentences import Sentence, encoded

__all__ = ["MOST_REQUEST", "main"]

MOST_REQUEST = 1 << 15
_POLL_MS = 2000  # how often the parent is polled where the socket does not report its end (macOS)
# System files: libraries, the time zone, the number of processors.
_SYSTEM = (
    *("/usr/lib", "/usr/lib64", "/usr/local/lib", "/lib", "/lib64", "/etc/ld.so.cache", "/etc/localtime", "/usr/share/zoneinfo"),
    *("/proc/cpuinfo", "/proc/meminfo", "/proc/stat", "/proc/sys/vm", "/sys/devices/system", "/sys/fs/cgroup"),
    *("/dev/null", "/dev/urandom", "/dev/random", "/dev/zero"),
)


@dataclass
class _Running:
    """A running reader process, and the file descriptors that the launcher keeps open for it.

    asked: the pipe on which the caller sends the job. status: the pipe to which the launcher writes the reader's exit status.
    """

    pid: int
    asked: int
    status: int


class _Launcher:
    def __init__(self, control: socket.socket) -> None:
        self._control = control
        self._parent = os.getppid()
        self._running: dict[int, _Running] = {}
        self._done: dict[str, str] = {}  # what was preloaded -> "", or the error
        self._woken, waking = os.pipe()
        os.set_blocking(waking, False)
        signal.signal(signal.SIGCHLD, lambda number, frame: None)
        signal.set_wakeup_fd(waking, warn_on_full_buffer=False)
        self._waking = waking
        self._poll = select.poll()
        self._poll.register(control, select.POLLIN)
        self._poll.register(self._woken, select.POLLIN)

    def answer_requests(self) -> None:
        """Handles requests until all callers have closed their ends of the socket."""
        while os.getppid() == self._parent:
            for descriptor, _ in self._poll.poll(_POLL_MS):
                if descriptor == self._control.fileno():
                    if not self._accept_request():
                        return
                elif descriptor == self._woken:
                    os.read(self._woken, 1 << 12)
                elif descriptor in self._running:  # the caller has closed its end
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(self._running[descriptor].pid, signal.SIGKILL)
                    self._poll.unregister(descriptor)
            self._reap_children()

    def _accept_request(self) -> bool:
        data, descriptors, _, _ = socket.recv_fds(self._control, MOST_REQUEST, 3)
        if not data:
            return False
        if len(descriptors) != 3:
            for descriptor in descriptors:
                os.close(descriptor)
            return True
        asked, said, status = descriptors
        why = next((said_why for each in json.loads(data)["preload"] if (said_why := self.preload(each))), None)
        if why is None:
            why = self._fork(asked, said, status)
        os.close(said)
        if why is not None:
            _write_status(status, {"failed": why})
            os.close(asked)
        return True

    def preload(self, name: str) -> str:
        """Imports a module ("module") and, for "module:function", calls the function; does so once per name.

        Returns the text of the error, or "".
        """
        if name not in self._done:
            module, _, function = name.partition(":")
            try:
                found = importlib.import_module(module)
                if function:
                    getattr(found, function)()
            except MachineError as error:
                return str(error)
            except (MemoryError, OSError, ImportError) as error:
                return Sentence(
                    "module-not-loadable",
                    "{name} cannot be loaded here ({kind}: {error})",
                    name=name,
                    kind=type(error).__name__,
                    error=library_message(error),
                )
            self._done[name] = ""
            gc.freeze()
        return ""

    def _fork(self, request_fd: int, reply_fd: int, status: int) -> str | None:
        system = _common_paths()
        parent = os.getpid()
        try:
            pid = os.fork()
        except OSError as error:
            return Sentence("process-not-startable", "it cannot start another process ({error})", error=library_message(error))
        if pid == 0:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            keep = {request_fd, reply_fd}
            for descriptor in [int(path.name) for path in Path("/dev/fd").iterdir()]:
                if descriptor > 2 and descriptor not in keep:
                    with contextlib.suppress(OSError):
                        os.close(descriptor)
            nothing = os.open(os.devnull, os.O_RDWR)
            for standard in (0, 1, 2):
                os.dup2(nothing, standard)
            os.close(nothing)
            reader.run_reader(request_fd, reply_fd, parent, system)
        self._running[request_fd] = _Running(pid, request_fd, status)
        self._poll.register(request_fd, 0)  # reports only that the other end is closed
        return None

    def _reap_children(self) -> None:
        by_pid = {running.pid: running for running in self._running.values()}
        while by_pid:
            try:
                pid, status, usage = os.wait4(-1, os.WNOHANG)
            except ChildProcessError:
                return
            if pid == 0:
                return
            if (running := by_pid.pop(pid, None)) is None:
                continue
            del self._running[running.asked]
            with contextlib.suppress(KeyError, OSError):
                self._poll.unregister(running.asked)
            os.close(running.asked)
            _write_status(running.status, {"status": status, "seconds": usage.ru_utime + usage.ru_stime})


def _write_status(status: int, message: dict[str, Any]) -> None:
    with contextlib.suppress(OSError):
        os.write(status, json.dumps(encoded(message)).encode())
    os.close(status)


def _common_paths() -> list[str]:
    """Returns the paths that every reader may read: the interpreter, installed packages, this package, and the kernel cache."""
    paths = sysconfig.get_paths()
    found = {*_SYSTEM, *(paths[name] for name in ("stdlib", "platstdlib", "purelib", "platlib"))}
    found |= {f"{prefix}/{name}" for prefix in (sys.prefix, sys.base_prefix) for name in ("lib", "lib64", "pyvenv.cfg", "bin")}
    found |= {entry for entry in sys.path if Path(entry).name in ("site-packages", "dist-packages")}
    for name, module in list(sys.modules.items()):
        if "." not in name:
            found |= set(getattr(module, "__path__", ())) or {getattr(module, "__file__", None) or "/dev/null"}
    if "renderer.jit" in sys.modules:
        found.add(str(sys.modules["renderer.jit"].cache_folder()))
    return sorted(found)


def main() -> None:
    """Runs the launcher.

    Command line: the descriptor of the socket on which requests arrive, and a JSON list of modules to preload at the start.
    """
    control = socket.socket(fileno=int(sys.argv[1]))
    os.set_inheritable(control.fileno(), False)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    launcher = _Launcher(control)
    for name in json.loads(sys.argv[2]):
        try:
            launcher.preload(name)
        except Exception:
            traceback.print_exc()
    launcher.answer_requests()
    os._exit(0)
