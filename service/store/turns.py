"""Turns of a process's threads at a database that takes one writer at a time.

SQLite lets waiting writers poll: under many submissions one of them may wait for seconds while others come again and again. Here
they stand in line, and those that must not wait go first.
"""

from __future__ import annotations

import heapq
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count

from service.errors import Unavailable

__all__ = ["Turns"]


class Turns:
    """Safe to use from any thread. Not to be taken twice by one."""

    def __init__(self) -> None:
        self._free = threading.Condition()
        self._is_taken = False
        self._line: list[tuple[bool, int]] = []  # who waits: the least goes next
        self._numbers = count()

    @contextmanager
    def taken(self, patience_s: float, is_urgent: bool = False) -> Iterator[None]:
        """Wait for a turn, and keep it for as long as the block lasts. is_urgent: before all that are not. Raises Unavailable."""
        ticket = not is_urgent, next(self._numbers)
        with self._free:
            heapq.heappush(self._line, ticket)
            try:
                if not self._free.wait_for(lambda: not self._is_taken and self._line[0] == ticket, patience_s):
                    sentence = f"The database does not answer (others have written for {patience_s:g} s)."
                    raise Unavailable(sentence, advice="Try again.")
                self._is_taken = True
            finally:
                self._line.remove(ticket)
                heapq.heapify(self._line)
                self._free.notify_all()
        try:
            yield
        finally:
            with self._free:
                self._is_taken = False
                self._free.notify_all()
