"""A worker that was started before it was known what for is told on its standard input (rayfarm/early.py)."""

from __future__ import annotations

import json
import os
import sys

__all__ = ["be_told"]


def be_told() -> bool:
    """Wait for the line, and be the process that it describes: options, environment, and the log as standard output and error;
    nothing more is read. False where whoever started it has nothing to say."""
    line = sys.stdin.buffer.readline()
    if not line.endswith(b"\n"):
        return False
    said = json.loads(line)
    os.environ.update(said["environment"])
    sys.argv[1:] = said["options"]
    log = os.open(said["log"], os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for file, end in ((nothing, 0), (log, 1), (log, 2)):
        os.dup2(file, end)
    os.close(log)
    os.close(nothing)
    return True
