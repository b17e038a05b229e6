"""Reports a worker's running tasks while the worker shuts down.

During a shutdown the event loop that normally sends reports has ended. If the report expired, the service would dispatch the
nearly finished work again.
"""

from __future__ import annotations

import threading
from typing import Any

from protocol.contract import HEARTBEAT_EVERY_S
from worker.heartbeat import Reporter
from worker.process.context import WorkerContext

__all__ = ["ShutdownReporter"]


class ShutdownReporter:
    """Sends reports from the parent process during a shutdown."""

    def __init__(self, worker: WorkerContext) -> None:
        self._worker = worker
        self._is_gone = threading.Event()
        self._thread: threading.Thread | None = None

    def begin(self, **_: Any) -> None:
        """Starts reporting that the worker takes no more tasks and finishes the running ones."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="leaving", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Stops reporting and deletes the report. Called when no task is running."""
        self._is_gone.set()
        if self._thread is not None:
            self._thread.join()
        Reporter(self._worker.redis_url).delete_report(self._worker.name)

    def _run(self) -> None:
        reporter = Reporter(self._worker.redis_url)
        while not self._is_gone.wait(HEARTBEAT_EVERY_S):
            reporter.write_report(self._worker.report(is_paused=True))
        reporter.redis.close()
