"""Sets up a worker's log: lines on standard error, or JSON objects (telemetry/log_lines.py).

A failure of Redis or the network is logged as one line, without the libraries' tracebacks.
"""

from __future__ import annotations

import logging
import sys

import redis

from renderer.printable import LogRecord
from telemetry.log_lines import JsonLines, as_json, level, uses_json
from worker.telemetry.batch_warnings import WarningHandler
from worker.telemetry.log_tail import LogTail

__all__ = ["set_up"]

TEXT = "%(asctime)s %(levelname)s %(message)s"


def set_up() -> tuple[LogTail, JsonLines | None]:
    """Logs to standard error, in this process and every slot. Returns the log's tail, and the JSON formatter or None."""
    logging.setLogRecordFactory(LogRecord)
    tail = LogTail()
    tail.setFormatter(logging.Formatter(TEXT))
    lines = as_json("worker") if uses_json() else None
    root = logging.getLogger()
    if lines is None:
        handler = logging.StreamHandler(sys.stderr)
        handler.setFormatter(logging.Formatter(TEXT))
        root.addHandler(handler)
        root.setLevel(level())
        logging.getLogger("httpx").setLevel(logging.WARNING)
    root.addHandler(tail)
    root.addHandler(WarningHandler())
    for each in root.handlers:
        each.addFilter(_without_traceback)
    return tail, lines


def _without_traceback(record: logging.LogRecord) -> bool:
    """Logging filter that replaces the traceback of a lost connection by its message. Always returns True."""
    error = record.exc_info[1] if record.exc_info else None
    if isinstance(error, (redis.RedisError, OSError)):
        said = record.getMessage().rstrip()
        record.msg = said if str(error) in said else f"{said} ({error})"
        record.args = ()
        record.exc_info = record.exc_text = None
    return True
