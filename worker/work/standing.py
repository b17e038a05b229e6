"""A bounded child that stays for more work of the same kind: what it has read and compiled once can be used again."""

from __future__ import annotations

import contextlib
import json
import os
import resource
import select
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from worker.exchange.errors import WorkError
from worker.work.bounded import Bounds, Send, answer_of, begin, end, how_it_ended, messages

__all__ = ["Standing"]

_TAKEN = b"null\n"  # said when all that a request was answered with has been dealt with
LARGE = 1 << 30  # bytes in memory; a child that has more stays for nobody

Answer = Callable[[dict[str, Any], Send], None]


class Standing:
    """Begun where it is made; ends when nobody has asked for `idle_s`, and where a piece of work fails."""

    def __init__(self, make: Callable[[], Answer], leave: Callable[[], None], bounds: Bounds, idle_s: float) -> None:
        """make: called in the child for what answers requests. leave: called there when nobody asks any more.

        bounds: of each request; the memory is for all of them. Raises MachineError.
        """
        asked, asking = os.pipe()

        def work(send: Send) -> dict[str, Any]:
            os.close(asking)
            answer = make()
            for request in _requests(asked, idle_s):
                answer(request, send)
                send({"done": True})
            leave()
            return {}

        self._bounds = bounds
        self._asking = asking
        self._spent = 0.0
        try:
            self._child, self._reading = begin(work, replace(bounds, seconds=2 * bounds.seconds))
        except BaseException:
            os.close(asking)
            raise
        finally:
            os.close(asked)
        self.is_over = False

    def ask(self, request: dict[str, Any], on_message: Send) -> bool:
        """Have a request answered; False where the child had left before. on_message: told what it says meanwhile.

        Raises WorkError and MachineError where it fails, as `run_bounded` does; then it is over.
        """
        begun = time.monotonic()
        try:
            os.write(self._asking, json.dumps(request).encode() + b"\n")
            last = None
            for message in messages(self._reading, self._bounds):
                if "done" in message:
                    with contextlib.suppress(BrokenPipeError):  # it is gone, as the next request will find
                        os.write(self._asking, _TAKEN)
                    self._spent += time.monotonic() - begun
                    if self._spent > self._bounds.seconds:  # it may take as long once more, and the system ends it then
                        self.end()
                    return True
                if "answer" in message or "error" in message:
                    last = message
                else:
                    on_message(message)
        except BrokenPipeError:
            last = {"answer": {}}
        except BaseException:
            self.end()
            raise
        status = self._let_go(last is not None)
        if last is None and status != 0:  # 0: it left, and said so before this was asked
            raise WorkError(how_it_ended(status, self._bounds))
        if last is not None:
            answer_of(last, self._bounds)
        return False

    def end(self) -> None:
        """Let it go."""
        if not self.is_over:
            self._let_go(True)

    def _let_go(self, is_done: bool) -> int:
        self.is_over = True
        os.close(self._asking)
        return end(self._child, self._reading, is_done)


def _requests(asked: int, idle_s: float) -> Iterator[dict[str, Any]]:
    """Until nobody asks for `idle_s`. Who asked may take long over what was said, and needs the files that it is about."""
    buffer = b""
    patience: float | None = idle_s
    while select.select([asked], [], [], patience)[0] and (data := os.read(asked, 1 << 16)):
        *lines, buffer = (buffer + data).split(b"\n")
        for line in lines:
            request = json.loads(line)
            patience = idle_s if request is None else None
            if request is not None:
                yield request
        if patience is not None and _in_memory() > LARGE:
            return


def _in_memory() -> int:
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()
    except OSError:
        return 0
