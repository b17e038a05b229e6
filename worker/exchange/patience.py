"""Trying again: a worker's own trouble may pass."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import TypeVar

from worker.exchange.errors import DamagedError, Trouble

__all__ = ["patiently"]

DAMAGES_ALLOWED = 3  # a blob that arrives damaged as often is damaged where it comes from

log = logging.getLogger(__name__)
T = TypeVar("T")


def patiently(call: Callable[[], T], seconds: float, pause_s: float = 1.0) -> T:
    """What `call` returns, tried again for `seconds` while it raises Trouble; then that is raised.

    The log says once for each reason what is waited for.
    """
    deadline = time.monotonic() + seconds
    said = ""
    damages = 0
    while True:
        try:
            return call()
        except Trouble as error:
            damages += isinstance(error, DamagedError)
            if time.monotonic() + pause_s > deadline or damages >= DAMAGES_ALLOWED:
                raise
            if str(error) != said:
                said = str(error)
                log.warning("%s; trying again for up to %.0f s", said, seconds)
            time.sleep(pause_s)
