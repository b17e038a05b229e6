"""Sends a slot's sums in a thread while the slot renders its next batch."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from contextvars import copy_context
from functools import partial
from typing import Self

from worker.exchange.polling_thread import PollingThread

__all__ = ["Send", "SumsSender"]

Send = Callable[[], None]


class SumsSender:
    """Context manager with a thread that sends results in order, at most one behind the slot.

    The thread ends with the context, so none runs when the slot forks a reader. Kernels run without the interpreter's lock. A
    result is held back until the next kernel runs: packing it would delay the next rendering, since both need that lock.
    """

    def __init__(self, every: Send | None = None) -> None:
        """Creates the object. every: called in the thread several times a second from `begin` on."""
        self._thread = PollingThread("sums", every)
        self._held: Send | None = None
        self._pending: Future[None] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Waits until all results are sent. Raises the error of the latest `send`, unless another one propagates."""
        try:
            self.wait()
        finally:
            self._thread.close()

    def submit(self, send: Send) -> None:
        """Holds `send` back until `begin`, after the previous result is sent. Raises the error of the previous `send`."""
        self.wait()
        self._held = partial(copy_context().run, send)

    def begin(self) -> None:
        """Lets the thread send the result that is held back, if any. Called when the next kernel is about to run."""
        self._release()
        self._thread.start()

    def begin_now(self) -> None:
        """Does the same, and wakes the thread. Called when the slot is about to wait for something else than a kernel."""
        self._release()
        self._thread.hasten()

    def send_now(self, send: Send) -> None:
        """Calls `send` in this thread, after the previous result is sent. Raises the error of either `send`."""
        self.wait()
        send()

    def wait(self) -> None:
        """Waits until the submitted result is sent. Raises the error of `send`."""
        self._release()
        pending, self._pending = self._pending, None
        if pending is not None:
            if not pending.done():
                self._thread.hasten()
            pending.result()

    def _release(self) -> None:
        held, self._held = self._held, None
        if held is not None:
            self._pending = self._thread.submit(held)
