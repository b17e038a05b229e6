"""Runs work in a forked child with limits on memory and time, so that no input can end the worker.

The child is forked rather than started anew: it has the parent's compiled kernels and readers, and starts within milliseconds.
The parent must be single-threaded, as the children of Celery's prefork pool are. The child may start any number of threads.
"""

from __future__ import annotations

import contextlib
import errno
import json
import logging
import os
import resource
import select
import signal
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from renderer.child_processes import die_with_parent, share_one_heap, signal_name
from worker.exchange.errors import MachineError, WorkError, is_of_machine

__all__ = ["Bounds", "Send", "answer_of", "begin", "end", "how_it_ended", "messages", "run_bounded"]

log = logging.getLogger(__name__)

Send = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class Bounds:
    """Limits for work in a child process, and the wording of its errors.

    memory_bytes: memory in addition to this process's current use. seconds: time limit, without the time in which the parent
    handles messages. faults: exceptions whose message becomes the error sentence. subject: the beginning of all other error
    sentences.
    """

    memory_bytes: int
    seconds: float
    faults: tuple[type[Exception], ...] = ()
    subject: str = "The file"


def run_bounded(
    work: Callable[[Send], dict[str, Any]],
    on_message: Send,
    memory_bytes: int,
    seconds: float,
    faults: tuple[type[Exception], ...] = (),
    subject: str = "The file",
) -> dict[str, Any]:
    """Runs `work` in a bounded child and returns its result, a JSON-ready dict.

    work: is passed a function that sends a JSON-ready dict to the parent's `on_message` at any time. memory_bytes: in addition to
    this process's current use. seconds: limit of working time. faults: exceptions whose message becomes the error sentence.
    Raises WorkError with a sentence that begins with `subject` for every other failure: an exception, memory, time, a crash.
    Raises MachineError if this machine is the cause.
    """
    bounds = Bounds(memory_bytes, seconds, faults, subject)
    child, reading = begin(work, bounds)
    answer: dict[str, Any] | None = None
    try:
        for message in messages(reading, bounds):
            if "answer" in message or "error" in message:
                answer = message
            else:
                on_message(message)
    finally:
        status = end(child, reading, answer is not None)
    if answer is None:
        raise WorkError(how_it_ended(status, bounds))
    return answer_of(answer, bounds)


def begin(work: Callable[[Send], dict[str, Any]], bounds: Bounds) -> tuple[int, int]:
    """Forks a child that runs `work` as in `run_bounded`; returns (process id, file descriptor for reading the child's messages).

    The last message has the result as `answer`, or an `error`. Raises MachineError if the fork fails.
    """
    parent = os.getpid()
    try:
        reading, writing = os.pipe()
    except OSError as error:
        raise MachineError(f"this machine has no file left to open ({error.strerror})") from error
    try:
        child = os.fork()
    except OSError as error:
        os.close(reading)
        os.close(writing)
        raise MachineError(f"this machine cannot start another process ({error.strerror})") from error
    if child == 0:
        os.close(reading)
        _child(work, writing, parent, bounds)
    os.close(writing)
    return child, reading


def end(child: int, reading: int, is_done: bool) -> int:
    """Ends a child and reaps it; returns its exit status.

    is_done: whether the child has sent its last message, and can be killed at once. Otherwise it has a second to end by itself,
    so that the status shows a crash.
    """
    os.close(reading)
    if is_done:
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)
        return os.waitpid(child, 0)[1]
    # The child either hangs, or has closed its pipe and is ending: a crash must keep its own signal.
    return _wait(child, 1.0)[1]


def answer_of(message: dict[str, Any], bounds: Bounds) -> dict[str, Any]:
    """Returns the result that the child's last message contains; raises WorkError or MachineError if it contains an error."""
    if "error" in message:
        sentence = message["error"]
        if message.get("machine"):
            raise MachineError(sentence)
        raise WorkError(sentence if message.get("plain") else f"{bounds.subject} {sentence}")
    answer: dict[str, Any] = message["answer"]
    return answer


def _child(
    work: Callable[[Send], dict[str, Any]],
    writing: int,
    parent: int,
    bounds: Bounds,
) -> None:
    """Runs `work` in the forked child and ends the process; never returns."""

    def send(message: dict[str, Any]) -> None:
        data = memoryview(json.dumps(message).encode() + b"\n")
        while data:
            data = data[os.write(writing, data) :]

    code = 1
    try:
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGALRM):
            signal.signal(number, signal.SIG_DFL)
        die_with_parent(parent)
        share_one_heap()
        _limit(bounds.memory_bytes, bounds.seconds)
        send({"answer": work(send)})
        code = 0
    except bounds.faults as error:
        send({"error": str(error), "plain": True})
    except MemoryError:
        send({"error": _too_large(bounds.memory_bytes)})
    except OSError as error:
        if error.errno == errno.ENOMEM:
            send({"error": _too_large(bounds.memory_bytes)})
        elif is_of_machine(error):
            where = error.filename or "a file"
            send({"error": f"this machine cannot write its files ({error.strerror}: {where})", "machine": True})
        else:
            send(_unreadable(error))
    except RecursionError:
        send({"error": "is nested too deeply. Flatten its hierarchy."})
    except BaseException as error:
        traceback.print_exc()
        send(_unreadable(error))
    finally:
        os._exit(code)


def _too_large(memory_bytes: int) -> str:
    return f"needs more than the {memory_bytes / 2**30:.1f} GiB that this worker grants one scene. Simplify it."


def _unreadable(error: BaseException) -> dict[str, Any]:
    return {"error": f"cannot be read ({type(error).__name__}: {error}). It may be damaged; export it anew."}


def _limit(memory_bytes: int, seconds: float) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (_address_space() + memory_bytes,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    cores = os.cpu_count() or 1
    cpu = int(seconds * cores) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (cpu, cpu))


def _address_space() -> int:
    """Returns the bytes of address space that this process has now."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    except OSError:
        return 4 << 30


def messages(reading: int, bounds: Bounds) -> Iterator[dict[str, Any]]:
    """Yields the child's messages until the child closes the pipe.

    Raises WorkError if the waits for messages add up to more than the bounds' seconds. The time in which the receiver handles a
    message does not count, so an unreachable Redis does not use up the child's time.
    """
    buffer = b""
    seconds = bounds.seconds
    while True:
        begun = time.monotonic()
        if seconds <= 0 or not select.select([reading], [], [], seconds)[0]:
            raise WorkError(
                f"{bounds.subject} took longer than {bounds.seconds:.0f} seconds. Make it smaller, or split it into several."
            )
        seconds -= time.monotonic() - begun
        data = os.read(reading, 1 << 16)
        if not data:
            return
        *lines, buffer = (buffer + data).split(b"\n")
        yield from (json.loads(line) for line in lines)


def _wait(child: int, seconds: float) -> tuple[int, int]:
    """Waits until the child ends, kills it after `seconds`, and reaps it; returns (process id, exit status)."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return pid, status
        time.sleep(0.01)
    with contextlib.suppress(ProcessLookupError):
        os.kill(child, signal.SIGKILL)
    return os.waitpid(child, 0)


def how_it_ended(status: int, bounds: Bounds) -> str:
    """Returns an error sentence for a child that ended without a result. status: exit status, as of os.waitpid."""
    subject, memory_bytes = bounds.subject, bounds.memory_bytes
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        name = signal_name(number)
        if number in (signal.SIGABRT, signal.SIGKILL, signal.SIGSEGV, signal.SIGBUS):
            return (
                f"{subject} made its reader crash ({name}): it is damaged, "
                f"or needs more than the {memory_bytes / 2**30:.1f} GiB that this worker grants one scene."
            )
        return f"{subject} made its reader crash ({name}). It may be damaged; export it anew."
    return f"{subject} could not be prepared (its reader ended without an answer). It may be damaged; export it anew."
