"""Repeats a call while it raises TemporaryError."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import TypeVar

from worker.exchange.errors import DamagedError, TemporaryError

__all__ = ["retry_temporary"]

MAX_DAMAGED = 3  # after this many the blob is damaged at its source

log = logging.getLogger(__name__)
T = TypeVar("T")


def retry_temporary(call: Callable[[], T], seconds: float, pause_s: float = 1.0) -> T:
    """Returns the result of `call`. While it raises TemporaryError, retries for `seconds`, then raises the last error.

    Raises a DamagedError at its third occurrence, since the data is then damaged at its source. pause_s: seconds between
    attempts. Each distinct reason is logged once.
    """
    deadline = time.monotonic() + seconds
    said = ""
    damages = 0
    while True:
        try:
            return call()
        except TemporaryError as error:
            damages += isinstance(error, DamagedError)
            if time.monotonic() + pause_s > deadline or damages >= MAX_DAMAGED:
                raise
            if str(error) != said:
                said = str(error)
                log.warning("%s; trying again for up to %.0f s", said, seconds)
            time.sleep(pause_s)
