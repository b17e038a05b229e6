"""The caller's side: runs jobs in confined readers, receives their messages, and turns each outcome into a result or an error.

A reader's messages are JSON and are treated as untrusted. The caller must check the files that the reader wrote.
"""

from __future__ import annotations

import atexit
import contextlib
import itertools
import json
import os
import pickle
import select
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from renderer.cache_folders import cache_home
from renderer.confine.launcher import MOST_REQUEST
from renderer.confine.limits import callers_limit_phrase, importer_memory
from renderer.confine.reader import TAKEN, Job, Link, Send
from renderer.confine.reader_errors import Bounds, TooLargeError, error_of, error_of_exit, timeout_error
from renderer.confine.rules import available_features
from renderer.errors import MachineError, RayfarmError, SceneError
from renderer.library_messages import library_message
from renderer.sentences import Sentence, decoded, encoded, joined_sentences

__all__ = ["Bounds", "Reader", "TooLargeError", "begin_launcher", "confinement", "error_of", "error_of_exit", "run"]

_ROOT = Path(__file__).resolve().parents[2]
_START = "import json, sys\nsys.path[:] = json.loads(sys.argv.pop(1))\nfrom renderer.confine.launcher import main\nmain()\n"
# Environment variables passed to readers: locations of libraries and kernels, and numbers of threads. Nothing else.
_PASSED = ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "RAYFARM_AVX512", "TZ", "NUMBA_THREADING_LAYER")
_PASSED_ENDINGS = ("_NUM_THREADS",)
_MOST_MESSAGE = 256 << 20  # bytes
_MOST_FILES = 10_000  # whose sizes are compared
_UNKNOWN_CALL = Sentence("reader-call-unknown", "is not possible while a scene is read")
_ENDING_S = 10.0  # within which a reader that has closed its pipe must end
_READY_S = 600.0  # for a launcher that compiles kernels first


class _Launcher:
    """The caller's handle of the launcher, the process that forks readers; shared by this process and its forks."""

    def __init__(self, preload: Sequence[str]) -> None:
        """Starts the launcher. Raises MachineError if that fails."""
        kind = socket.SOCK_SEQPACKET if sys.platform == "linux" else socket.SOCK_DGRAM
        try:
            self.socket, theirs = socket.socketpair(socket.AF_UNIX, kind)
        except OSError as error:
            raise MachineError(
                Sentence(
                    "machine-file-handles-exhausted",
                    "this machine cannot open another file ({error})",
                    error=library_message(error),
                )
            ) from error
        self._words = _temporary_log()
        command = [sys.executable, "-I", "-X", "utf8", "-c", _START, json.dumps(_import_path())]
        with theirs:
            try:
                self._process = subprocess.Popen(
                    [*command, str(theirs.fileno()), json.dumps(list(preload))],
                    env=_environment(),
                    cwd="/",
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=self._words if self._words is not None else subprocess.DEVNULL,
                    pass_fds=(theirs.fileno(),),
                    start_new_session=True,
                )
            except OSError as error:
                self.socket.close()
                raise MachineError(
                    Sentence(
                        "machine-processes-exhausted",
                        "this machine cannot start another process ({error})",
                        error=library_message(error),
                    )
                ) from error
        # Not waited for: it ends with its callers, and is often the child of another one than the last of them.
        self._process.returncode = 0

    def send(self, preload: Sequence[str], descriptors: Sequence[int]) -> None:
        """Requests a new reader from the launcher. Raises OSError if the launcher has ended.

        preload: modules to import first. descriptors: the reader's ends of the pipes.
        """
        data = json.dumps({"preload": list(preload)}).encode()
        assert len(data) < MOST_REQUEST
        socket.send_fds(self.socket, [data], list(descriptors))

    def close(self) -> None:
        """Closes this process's ends of the pipes. The launcher ends when all callers have done so."""
        self.socket.close()
        if self._words is not None:
            self._words.close()

    def error_output(self) -> str:
        """Returns the last line of the launcher's standard error output."""
        if self._words is None:
            return ""
        with contextlib.suppress(OSError):
            return os.pread(self._words.fileno(), 1 << 16, 0).decode("utf-8", "replace").strip().rpartition("\n")[2][:300]
        return ""


_lock = threading.Lock()
_current: _Launcher | None = None


def begin_launcher(preload: Sequence[str] = ()) -> None:
    """Starts the launcher unless it is running, to save the first reader that time. Raises MachineError if that fails."""
    global _current
    with _lock:
        if _current is None:
            _current = _Launcher(preload)


@atexit.register
def _close_current() -> None:
    if _current is not None:
        _current.close()


def confinement() -> tuple[str, bool]:
    """Returns (a sentence on how readers are sandboxed on this machine, whether all sandbox features are available)."""
    has, lacks = available_features()
    kept = ", ".join([*has, "limits and an empty environment"])
    sentence = f"files are read in processes of their own, confined by {kept}"
    return (f"{sentence}; this system lacks {' and '.join(lacks)}" if lacks else sentence), not lacks


def _discard_launcher(launcher: _Launcher) -> None:
    """Stops using a launcher, so that the next reader starts a new one."""
    global _current
    with _lock:
        if _current is launcher:
            _current = None


class Reader:
    """A confined process that runs one job. A context manager, which ends the process on leaving."""

    def __init__(
        self,
        work: Callable[[Link], dict[str, Any]],
        reads: Sequence[Path],
        writes: Sequence[Path],
        bounds: Bounds,
        preload: Sequence[str] = (),
        calls: Mapping[str, Callable[..., Any]] | None = None,
    ) -> None:
        """Starts the reader. work: a picklable function of an importable module.

        reads: files and folders. writes: folders; the first is for temporary files. preload: modules to import ("module", or
        "module:function" to call). calls: name -> function of this process that the reader may call. Raises MachineError if it
        cannot be started.
        """
        self.bounds = bounds
        self._calls = calls or {}
        self.is_over = self._is_started = False
        self._reads, self._room = tuple(reads), bounds.memory_bytes
        job = Job(
            work, _encoded_paths(reads), _encoded_paths(writes), os.fsencode(writes[0]), bounds.memory_bytes, bounds.seconds
        )
        data = pickle.dumps(job)
        for attempt in (1, 2):
            begin_launcher(preload)
            launcher = _current
            assert launcher is not None
            self._launcher: _Launcher = launcher
            try:
                self._begin(launcher, preload)
            except OSError as error:
                _discard_launcher(launcher)
                if attempt == 2:
                    raise _launcher_error(launcher, error.strerror or "") from error
                continue
            break
        with contextlib.suppress(BrokenPipeError):  # it has ended, which is seen below
            self._write(len(data).to_bytes(8, "little") + data)

    def _begin(self, launcher: _Launcher, preload: Sequence[str]) -> None:
        pipes: list[int] = []
        try:
            for _ in range(3):
                pipes += os.pipe()
            asked, asking, saying, said, reporting, reported = (pipes[i] for i in (0, 1, 2, 3, 4, 5))
            launcher.send(preload, (asked, said, reported))
        except OSError:
            for descriptor in pipes:
                os.close(descriptor)
            raise
        for descriptor in (asked, said, reported):
            os.close(descriptor)
        self._asking, self._saying, self._reporting = asking, saying, reporting

    def _write(self, data: bytes) -> None:
        view = memoryview(data)
        while view:
            view = view[os.write(self._asking, view) :]

    def result(self, on_message: Send = lambda message: None) -> dict[str, Any]:
        """Waits for the job's result and returns it. on_message: called with progress messages.

        Raises RayfarmError: the job's error, or one that describes how the reader ended.
        """
        for message in self._messages(self.bounds.seconds):
            if "answer" in message:
                answer: dict[str, Any] = message["answer"]
                return answer
            on_message(message)
        raise self._ended_error()

    def request(self, request: dict[str, Any], on_message: Send) -> bool:
        """Sends a further request to a reader whose job handles `Link.requests`; returns False if the job had already ended.

        Raises the errors of `result`.
        """
        try:
            self._write(json.dumps(request).encode() + b"\n")
            for message in self._messages(self.bounds.seconds):
                if "done" in message:
                    with contextlib.suppress(BrokenPipeError):
                        self._write(TAKEN)
                    return True
                if "answer" in message:
                    self.close()
                    return False
                on_message(message)
        except BrokenPipeError:
            pass
        except BaseException:
            self.close()
            raise
        ended = self._status()
        self.close()
        if ended.get("status") == 0:
            return False
        raise self._error_of_status(ended)

    def _messages(self, seconds: float) -> Iterator[dict[str, Any]]:
        """Yields messages until the reader closes its pipe.

        The time that the caller takes to handle a message does not count towards the reader's limit.
        """
        buffer = bytearray()
        while True:
            begun = time.monotonic()
            if seconds <= 0 or not _wait_readable(self._saying, seconds if self._is_started else seconds + _READY_S):
                self.close()
                raise timeout_error(self.bounds)
            if self._is_started:
                seconds -= time.monotonic() - begun
            data = os.read(self._saying, 1 << 16)
            if not data:
                return
            buffer += data
            if len(buffer) > _MOST_MESSAGE:
                raise SceneError(
                    Sentence(
                        "reader-output-too-large",
                        "{subject} cannot be read: its reader sent too much data.",
                        subject=self.bounds.subject,
                    )
                )
            if b"\n" not in data:
                continue
            *lines, rest = bytes(buffer).split(b"\n")
            buffer = bytearray(rest)
            for line in lines:
                message = json.loads(line)
                if not isinstance(message, dict):
                    raise SceneError(
                        Sentence(
                            "reader-output-malformed",
                            "{subject} cannot be read: its reader sent an invalid message.",
                            subject=self.bounds.subject,
                        )
                    )
                message = decoded(message)
                if "error" in message:
                    raise error_of(message, self.bounds)
                if "started" in message and not self._is_started:  # the first is sent before the job, so it can be trusted
                    self._is_started, self._room = True, int(message["room"])
                elif "call" in message:
                    self._answer_call(message)
                else:
                    yield message

    def _answer_call(self, message: dict[str, Any]) -> None:
        call = self._calls.get(str(message.pop("call")))
        try:
            reply = {"reply": call(**message)} if call is not None else {"error": _UNKNOWN_CALL}
        except SceneError as error:
            reply = {"error": str(error)}
        with contextlib.suppress(BrokenPipeError):
            self._write(json.dumps(encoded(reply)).encode() + b"\n")

    def _ended_error(self) -> RayfarmError:
        ended = self._status()
        self.close()
        return self._error_of_status(ended)

    def _error_of_status(self, ended: dict[str, Any]) -> RayfarmError:
        bounds = self.bounds
        if "failed" in ended:
            return MachineError(
                _with_limits(
                    Sentence(
                        "file-unreadable-here",
                        "{subject} cannot be read on this machine: {fault}.",
                        subject=bounds.subject,
                        fault=ended["failed"],
                    )
                )
            )
        if "status" not in ended:
            _discard_launcher(self._launcher)
            return _launcher_error(self._launcher, Sentence("launcher-ended", "it has ended"))
        return error_of_exit(int(ended["status"]), bounds, self._room, importer_memory(_largest_file(self._reads)))

    def _status(self) -> dict[str, Any]:
        """Returns the launcher's message on how the reader ended; empty if the launcher has ended or the reader does not end."""
        if not _wait_readable(self._reporting, _ENDING_S):
            return {}
        try:
            found = json.loads(os.read(self._reporting, 1 << 16) or b"{}")
        except ValueError:
            return {}
        return decoded(found) if isinstance(found, dict) else {}

    def close(self) -> None:
        """Ends the reader process and waits for its end."""
        if self.is_over:
            return
        self.is_over = True
        os.close(self._asking)  # the launcher kills it
        os.close(self._saying)
        _wait_readable(self._reporting, _ENDING_S)
        os.close(self._reporting)

    def __enter__(self) -> Reader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def run(
    work: Callable[[Link], dict[str, Any]],
    reads: Sequence[Path],
    writes: Sequence[Path],
    bounds: Bounds,
    on_message: Send = lambda message: None,
    preload: Sequence[str] = (),
    calls: Mapping[str, Callable[..., Any]] | None = None,
) -> dict[str, Any]:
    """Runs `work(link)` in a sandboxed reader process; returns its result. For the arguments and errors see Reader."""
    with Reader(work, reads, writes, bounds, preload, calls) as reader:
        return reader.result(on_message)


def _largest_file(paths: Sequence[Path]) -> int:
    """Returns the size in bytes of the largest file among `paths` and the first 10,000 files in their folders; 0 if none."""
    inside = (path for folder in paths for path in (folder.rglob("*") if folder.is_dir() else [folder]))
    largest = 0
    for path in itertools.islice(inside, _MOST_FILES):
        with contextlib.suppress(OSError):
            largest = max(largest, path.stat().st_size)
    return largest


def _launcher_error(launcher: _Launcher, why: str) -> MachineError:
    return MachineError(
        _with_limits(
            Sentence(
                "reader-not-startable",
                "this machine cannot run the process that reads scenes ({error}).",
                error=launcher.error_output() or why,
            )
        )
    )


def _with_limits(sentence: str) -> str:
    """Returns the sentence, followed by advice to raise this process's limits of memory and time if it has any."""
    limits = [limit for option in ("-v", "-t") if (limit := callers_limit_phrase(option)) is not None]
    return joined_sentences(sentence, Sentence("advice-raise-limit", "Raise {limit}.", limit=limits)) if limits else sentence


def _wait_readable(descriptor: int, seconds: float) -> bool:
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(seconds * 1000))


def _encoded_paths(paths: Sequence[Path]) -> tuple[bytes, ...]:
    return tuple(os.fsencode(path) for path in paths)


def _environment() -> dict[str, str]:
    """Returns the environment variables with which the launcher and its readers run."""
    passed = {name: value for name, value in os.environ.items() if name in _PASSED or name.endswith(_PASSED_ENDINGS)}
    return {
        **passed,
        "LANG": "C.UTF-8",
        "RAYFARM_CACHE": str(cache_home()),
        "PYTHONDONTWRITEBYTECODE": "1",
        "MALLOC_ARENA_MAX": "2",
    }


def _import_path() -> list[str]:
    """Returns this process's import path without the folder of the running script, where a file could shadow a library."""
    main = getattr(sys.modules.get("__main__"), "__file__", None)
    scripts = str(Path(main).resolve().parent) if main else ""
    found = [entry for entry in sys.path if entry and str(Path(entry).resolve()) != scripts]
    return found if str(_ROOT) in found else [str(_ROOT), *found]


def _temporary_log() -> IO[bytes] | None:
    """Returns a temporary file for the launcher's standard error; None if none can be created."""
    try:
        if hasattr(os, "memfd_create"):
            return os.fdopen(os.memfd_create("rayfarm-launcher"), "w+b", buffering=0)
        return tempfile.TemporaryFile(buffering=0)
    except OSError:
        return None
