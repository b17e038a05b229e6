"""A worker's log: lines on standard error. What Redis or the network do is a line too, and no page of the libraries' insides."""

from __future__ import annotations

import logging
import sys

import redis

__all__ = ["set_up"]


def set_up() -> None:
    """Log to standard error, from here on and in every slot."""
    handler = logging.StreamHandler(sys.stderr)
    handler.addFilter(_in_a_line)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s", handlers=[handler])
    logging.getLogger("httpx").setLevel(logging.WARNING)


def _in_a_line(record: logging.LogRecord) -> bool:
    """Celery shows where in itself a connection was lost, every time; what happened is enough to act on."""
    error = record.exc_info[1] if record.exc_info else None
    if isinstance(error, (redis.RedisError, OSError)):
        said = record.getMessage().rstrip()
        record.msg = said if str(error) in said else f"{said} ({error})"
        record.args = ()
        record.exc_info = record.exc_text = None
    return True
