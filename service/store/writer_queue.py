"""Fair queue for the threads of a process that write to a database with a single writer.

Writers that wait for SQLite poll its lock, so with many submissions one of them can wait for seconds while others succeed. In
this queue they are served in order, urgent ones first.
"""

from __future__ import annotations

import heapq
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count

from renderer.sentences import Sentence
from service.errors import Unavailable

__all__ = ["WriterQueue"]


class WriterQueue:
    """Fair queue of writers. Thread-safe, not reentrant."""

    def __init__(self) -> None:
        self._free = threading.Condition()
        self._is_taken = False
        self._line: list[tuple[bool, int]] = []  # heap of waiting threads: the smallest is next
        self._numbers = count()

    @contextmanager
    def wait_for_turn(self, timeout_s: float, is_urgent: bool = False) -> Iterator[None]:
        """Context manager that waits until the caller may write, and blocks other writers during its block.

        timeout_s: longest wait in seconds, after which Unavailable is raised. is_urgent: whether to precede all waiting writers
        that are not urgent.
        """
        ticket = not is_urgent, next(self._numbers)
        with self._free:
            heapq.heappush(self._line, ticket)
            try:
                if not self._free.wait_for(lambda: not self._is_taken and self._line[0] == ticket, timeout_s):
                    sentence = Sentence(
                        "database-write-timeout",
                        "The database does not answer (it was locked for {seconds} s).",
                        seconds=f"{timeout_s:g}",
                    )
                    raise Unavailable(sentence, advice=Sentence("advice-retry", "Try again."))
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
