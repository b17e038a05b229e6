"""Keeps reporting a worker's running tasks while it shuts down.

The event loop that otherwise reports them has ended by then; if the report expired, that work would be handed out again, though
it is nearly done.
"""

from __future__ import annotations

import threading
from typing import Any

from protocol.contract import HEARTBEAT_EVERY_S
from worker.heartbeat import Reporter
from worker.process.context import WorkerContext

__all__ = ["ShutdownReporter"]


class ShutdownReporter:
    """Reports from the parent process during shutdown."""

    def __init__(self, worker: WorkerContext) -> None:
        self._worker = worker
        self._is_gone = threading.Event()
        self._thread: threading.Thread | None = None

    def begin(self, **_: Any) -> None:
        """Starts reporting: the worker takes no more tasks, and finishes those that are running."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="leaving", daemon=True)
            self._thread.start()

    def end(self) -> None:
        """Stops reporting and deletes the report, when no task is running."""
        self._is_gone.set()
        if self._thread is not None:
            self._thread.join()
        Reporter(self._worker.redis_url).leave(self._worker.name)

    def _run(self) -> None:
        reporter = Reporter(self._worker.redis_url)
        while not self._is_gone.wait(HEARTBEAT_EVERY_S):
            reporter.beat(self._worker.report(is_paused=True))
        reporter.redis.close()
