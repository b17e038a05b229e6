"""A reader: the forked, sandboxed child process that runs one job and sends messages over a pipe, as lines of JSON.

Messages:
    started   the job begins; `room`: bytes of address space that it can allocate
    answer    the result; the last message
    error     a sentence; the last message. `kind`: the exception's class, `machine`: whether the machine is at fault, `rest`: the
              sentence without its subject
    done      a request is finished
    call      requests a function call in the caller, for work that a reader may not do
    others    progress
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import pickle
import resource
import select
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from renderer.confine import faults, rules
from renderer.confine.limits import set_limits
from renderer.errors import MachineError, RayfarmError, SceneError
from renderer.library_messages import library_message
from renderer.sentences import Sentence, decoded, encoded

__all__ = ["Job", "Link", "Send", "call_parent", "error_message", "is_of_machine", "is_reader", "run_reader"]

Send = Callable[[dict[str, Any]], None]

LARGE = 1 << 30  # resident bytes: a larger reader does not wait for further requests
TAKEN = b"null\n"  # the caller has handled all messages of a request
_MOST_TRACE = 4000
_OUT_OF_MEMORY_SCORE = "900"  # the kernel ends this process before others

# File system or kernel errors independent of the file: full, read-only, damaged, or out of processes, files, memory.
_MACHINE_ERRORS = {
    *(errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EACCES, errno.EPERM),
    *(errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ESTALE, errno.EFBIG),
}


def is_of_machine(error: OSError) -> bool:
    """Returns True if an error that ended a job is caused by this machine, not by the file."""
    return error.errno in _MACHINE_ERRORS


@dataclass(frozen=True)
class Job:
    """A reader's job, pickled by the caller: the function to call with a Link, the accessible paths, and the limits.

    reads, writes: paths that the reader may read and write, as bytes, since names need not be UTF-8. temporary: the folder for
    temporary files.
    """

    work: Callable[[Link], dict[str, Any]]
    reads: tuple[bytes, ...]
    writes: tuple[bytes, ...]
    temporary: bytes
    memory_bytes: int
    seconds: float


class Link:
    """The reader's connection to its caller: one pipe in each direction."""

    def __init__(self, request_fd: int, reply_fd: int) -> None:
        self._asked, self._said = request_fd, reply_fd
        self._buffer = b""

    def send(self, message: dict[str, Any]) -> None:
        """Sends a message, which must be convertible to JSON."""
        data = memoryview(json.dumps(encoded(message)).encode() + b"\n")
        while data:
            data = data[os.write(self._said, data) :]

    def job(self) -> Job:
        """Receives the job, which the caller sends first."""
        size = int.from_bytes(self._read_exactly(8), "little")
        job = pickle.loads(self._read_exactly(size))
        assert isinstance(job, Job)
        return job

    def call_parent(self, name: str, /, **arguments: Any) -> Any:
        """Calls the function `name` in the caller, for work that a reader may not do; returns its result.

        Raises SceneError with the caller's sentence if the function fails.
        """
        self.send({"call": name, **arguments})
        reply = decoded(json.loads(self._line(None) or b"{}"))
        if "error" in reply:
            raise SceneError(reply["error"])
        return reply["reply"]

    def requests(self, idle_s: float) -> Iterator[dict[str, Any]]:
        """Yields requests until none arrives for `idle_s` seconds, the caller has ended, or this process has become too large.

        Waits without limit while the caller handles the messages of the last request, since the caller needs the files that they
        name.
        """
        patience: float | None = idle_s
        while line := self._line(patience):
            request = json.loads(line)
            patience = idle_s if request is None else None
            if request is not None:
                yield request
                self.send({"done": True})
            elif _in_memory() > LARGE:
                return

    def _line(self, patience: float | None) -> bytes | None:
        while b"\n" not in self._buffer:
            if not select.select([self._asked], [], [], patience)[0] or not (data := os.read(self._asked, 1 << 16)):
                return None
            self._buffer += data
        line, self._buffer = self._buffer.split(b"\n", 1)
        return line

    def _read_exactly(self, size: int) -> bytes:
        parts = bytearray()
        while len(parts) < size:
            data = os.read(self._asked, min(size - len(parts), 1 << 20))
            if not data:
                raise EOFError
            parts += data
        return bytes(parts)


_link: Link | None = None


def call_parent(name: str, /, **arguments: Any) -> Any:
    """Calls the function `name` in the process that started this reader, as `Link.call_parent` does.

    Returns None if this process is not a reader.
    """
    return None if _link is None else _link.call_parent(name, **arguments)


def is_reader() -> bool:
    """Returns True if this process is a reader."""
    return _link is not None


def run_reader(request_fd: int, reply_fd: int, parent: int, system: Iterable[str]) -> NoReturn:
    """Runs the job in a forked child, and exits.

    request_fd, reply_fd: the ends of the pipes to the caller. parent: id of the calling process; the child dies with it. system:
    paths that the job may read: the interpreter, its libraries and the kernels.
    """
    global _link
    code = 1
    _link = link = Link(request_fd, reply_fd)
    try:
        rules.die_with_parent(parent)
        os.setsid()
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGALRM):
            signal.signal(number, signal.SIG_DFL)
        _confine_and_run(link, system)
        code = 0
    except EOFError:  # the caller has gone
        pass
    except BaseException as error:
        with contextlib.suppress(OSError):
            link.send(error_message(error))
    finally:
        os._exit(code)


def _confine_and_run(link: Link, system: Iterable[str]) -> None:
    job = link.job()
    temporary = os.fsdecode(job.temporary)
    tempfile.tempdir = os.environ["TMPDIR"] = os.environ["HOME"] = temporary
    os.chdir(temporary)
    sys.dont_write_bytecode = True
    room = set_limits(job.memory_bytes, job.seconds)
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(_OUT_OF_MEMORY_SCORE)
    reads = [(path, rules.READ) for path in (*system, *map(os.fsdecode, job.reads))]
    writes = [(os.fsdecode(path), rules.WRITE) for path in job.writes]
    has_files = rules.restrict_files([*reads, (f"/proc/{os.getpid()}", rules.READ), *writes, ("/dev/null", rules.WRITE)])
    rules.forbid_new_privileges()
    rules.drop_capabilities(keep_reading=has_files)
    if not rules.filter_calls():
        rules.enter_empty_network()
    link.send({"started": True, "room": room})
    link.send({"answer": job.work(link)})


def error_message(error: BaseException) -> dict[str, Any]:
    """Returns the `error` message for an exception."""
    kind = f"{type(error).__module__}.{type(error).__qualname__}"
    if isinstance(error, MachineError):
        return {"error": str(error), "machine": True}
    if isinstance(error, RayfarmError):
        return {"error": str(error), "kind": kind}
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return {"error": "memory"}
    if isinstance(error, OSError) and is_of_machine(error):
        where = error.filename or "a file"
        if isinstance(where, bytes):
            where = os.fsdecode(where)
        if error.errno == errno.EFBIG:
            return {"error": "size"}
        return {
            "error": Sentence(
                "machine-files-unusable",
                "this machine cannot use its files ({error}: {where})",
                error=library_message(error),
                where=where,
            ),
            "machine": True,
        }
    if isinstance(error, RuntimeError) and faults.is_of_machine(error):
        return {
            "error": Sentence("machine-threads-exhausted", "this machine cannot start another thread (see ulimit -u and -v)"),
            "machine": True,
        }
    if isinstance(error, RecursionError):
        return {
            "error": Sentence("hierarchy-nested-too-deep", "is nested too deeply. Flatten its hierarchy."),
            "rest": True,
        }
    trace = traceback.format_exc()[-_MOST_TRACE:]
    return {
        "error": Sentence(
            "file-read-failed",
            "cannot be read ({name}: {error}). It may be damaged; export it again.",
            name=type(error).__name__,
            error=error,
        ),
        "rest": True,
        "trace": trace,
    }


def _in_memory() -> int:
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()
    except OSError:
        return 0
