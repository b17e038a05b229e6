"""A terminal window: runs `rayfarm` on a real pseudo terminal with configurable replies, and records the output."""

from __future__ import annotations

import fcntl
import os
import pty
import signal
import struct
import subprocess
import sys
import termios
import threading
from typing import Any

from tests.helpers import ROOT
from tests.rayfarm.watch.seen import Seen
from tests.service.conftest import until

__all__ = ["Window"]

TRUE_COLOUR = b"\x1bP1$r0;48:2::1:2:3m\x1b\\"
KITTY = b"\x1b_Gi=31;OK\x1b\\"
CELL = b"\x1b[6;20;10t"
DA1, DA1_WITH_SIXEL = b"\x1b[?62;22c", b"\x1b[?62;4;22c"


class Window:
    """A terminal window, as a context manager.

    answers: replies to the program's queries for capabilities, sent when it queries DA1 (primary device attributes).
    """

    def __init__(
        self, *arguments: str, columns: int = 80, rows: int = 30, answers: bytes = TRUE_COLOUR + DA1, **environment: str
    ) -> None:
        self._master, slave = pty.openpty()
        self.screen = Seen(columns, rows)
        self.answers = answers
        self.raw = b""
        self._set_size(columns, rows)
        self.before = termios.tcgetattr(slave)
        env = {**os.environ, "TERM": "xterm-256color", "COLORTERM": "", **environment}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "rayfarm", *arguments],
            cwd=ROOT,
            env=env,
            stdin=slave,
            stdout=slave,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        self._slave = slave  # stays open, so that output can be read after the program's end
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._read, daemon=True)

    def __enter__(self) -> Window:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()
        os.close(self._slave)
        self._thread.join(10)
        os.close(self._master)

    def press(self, keys: str) -> None:
        os.write(self._master, keys.encode())

    def send(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def resize(self, columns: int, rows: int) -> None:
        with self._lock:
            self.screen = Seen(columns, rows)
            self._set_size(columns, rows)
        self.send(signal.SIGWINCH)  # the kernel would send it for a controlling terminal

    def wait_for(self, true: Any, what: str) -> None:
        until(lambda: self._locked(true), what, 40.0, lambda: (self.process.poll(), self.screen.lines(), self.raw[-300:]))

    def says(self, words: str) -> None:
        self.wait_for(lambda: any(words in line for line in self.screen.lines()), f"it says {words!r}")

    def ends(self) -> tuple[int, str]:
        """Waits for the program's end; returns exit code and standard error, and checks that the screen was restored."""
        _, err = self.process.communicate(timeout=40)
        self.wait_for(lambda: {"25", "7"} <= self.screen.modes and not {"1049", "2026"} & self.screen.modes, "the screen is left")
        assert termios.tcgetattr(self._slave) == self.before
        return self.process.returncode, err.decode()

    def _locked(self, true: Any) -> bool:
        with self._lock:
            return bool(true())

    def _set_size(self, columns: int, rows: int) -> None:
        fcntl.ioctl(self._master, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def _read(self) -> None:
        while True:
            try:
                data = os.read(self._master, 65536)
            except OSError:
                return
            if not data:
                return
            with self._lock:
                self.raw += data
                self.screen.take(data)
            if b"\x1b[c" in data:
                os.write(self._master, self.answers)
