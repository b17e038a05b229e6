"""The process of `rayfarm worker`, started before the command knows its options: what both import takes as long as all else
until a worker is ready, and is imported at the same time.

It is told what to do on its standard input, once (worker/told.py). Where the command ends without a word, so does it.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import rayfarm
from worker.machine.children import spawn_guard

__all__ = ["ROOT", "begin", "is_of_use", "told"]

ROOT = Path(rayfarm.__file__).resolve().parent.parent

_process: subprocess.Popen[bytes] | None = None


def is_of_use(words: Sequence[str]) -> bool:
    """Whether what was typed will start a worker, as far as can be seen by now."""
    asks = {"-h", "--help"} & set(words)
    return words[:1] == ["worker"] and not asks and any(word.partition("=")[0] == "--join" for word in words)


def begin() -> None:
    """Start it. Its words are for the log, which it is told of: until then it has none. What goes wrong goes wrong once more when
    the worker is started in the usual way, which says it."""
    global _process
    with contextlib.suppress(OSError):
        _process = subprocess.Popen(
            [sys.executable, "-m", "worker", "--told"],
            cwd=ROOT,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=spawn_guard(),
        )


def told(options: Sequence[str], environment: Mapping[str, str], log: Path) -> subprocess.Popen[bytes] | None:
    """Let it begin, by these options of `python -m worker`; None where it was not started, or has died. Raises OSError where
    there is no room for its log."""
    global _process
    process, _process = _process, None
    if process is None:
        return None
    log.parent.mkdir(parents=True, exist_ok=True)
    log.touch()
    assert process.stdin is not None
    try:
        with process.stdin as words:
            words.write(json.dumps({"options": options, "environment": environment, "log": str(log)}).encode() + b"\n")
    except BrokenPipeError:
        return None
    return process if process.poll() is None else None
