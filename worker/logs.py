"""A worker's log: lines on standard error. What Redis or the network do is a line too, and no page of the libraries' insides."""

from __future__ import annotations

import logging
import sys

import redis

from worker.log_tail import LogTail

__all__ = ["set_up"]


def set_up() -> LogTail:
    """Log to standard error, from here on and in every slot; returns the end of the log."""
    handler = logging.StreamHandler(sys.stderr)
    tail = LogTail()
    for each in (handler, tail):
        each.addFilter(_in_a_line)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s", handlers=[handler, tail])
    logging.getLogger("httpx").setLevel(logging.WARNING)
    return tail


def _in_a_line(record: logging.LogRecord) -> bool:
    """Celery shows where in itself a connection was lost, every time; what happened is enough to act on."""
    error = record.exc_info[1] if record.exc_info else None
    if isinstance(error, (redis.RedisError, OSError)):
        said = record.getMessage().rstrip()
        record.msg = said if str(error) in said else f"{said} ({error})"
        record.args = ()
        record.exc_info = record.exc_text = None
    return True
