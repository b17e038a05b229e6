"""A thread that begins its tasks by itself, a little later.

A thread that is woken takes the processor and the interpreter at once, on a machine whose cores are all busy. A slot's thread
would lose them just before its kernel runs. So tasks are only put down, and the thread looks for them several times a second.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future

__all__ = ["POLL_S", "PollingThread"]

POLL_S = 0.1

Task = Callable[[], None]

log = logging.getLogger(__name__)


class PollingThread:
    """A thread for tasks in order, which begin within POLL_S. It starts with the first task, or with `start`."""

    def __init__(self, name: str, every: Task | None = None) -> None:
        """Creates the object without a thread. every: called when the thread has looked for tasks, until it raises an error."""
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._every = every
        self._tasks: deque[tuple[Task, Future[None]]] = deque()
        self._wake = threading.Event()
        self._is_over = self._has_started = False

    def submit(self, task: Task) -> Future[None]:
        """Puts a task down without waking the thread. Returns its future."""
        future: Future[None] = Future()
        self._tasks.append((task, future))
        self.start()
        return future

    def start(self) -> None:
        """Starts the thread, unless it has started."""
        if not self._has_started:
            self._has_started = True
            self._thread.start()

    def hasten(self) -> None:
        """Wakes the thread, so that it begins its tasks at once."""
        self._wake.set()

    def close(self) -> None:
        """Waits until all tasks are done, and ends the thread."""
        self._is_over = True
        self._wake.set()
        if self._has_started:
            self._thread.join()

    def _run(self) -> None:
        while True:
            self._wake.wait(POLL_S)
            self._wake.clear()
            is_over = self._is_over  # read before the tasks are: none comes afterwards
            while self._tasks:
                task, future = self._tasks.popleft()
                try:
                    task()
                except BaseException as error:
                    future.set_exception(error)
                else:
                    future.set_result(None)
            if is_over:
                return
            if self._every is not None:
                try:
                    self._every()
                except Exception:  # the tasks must be done in any case: others wait for them
                    log.exception("%s: what is done several times a second failed", self._thread.name)
                    self._every = None
