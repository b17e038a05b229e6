"""The terminal in raw mode, with an alternate screen; restored at the end in all cases.

Its capabilities are queried, followed by a query that every terminal answers (DA1): if that answer arrives first, a capability is
missing, without waiting for a timeout.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import select
import signal
import struct
import sys
import termios
import time
import tty
from collections.abc import Iterator
from dataclasses import dataclass
from types import FrameType
from typing import Any

__all__ = ["Abilities", "Terminal", "parse_answers"]

ANSWER_S = 2.0  # over slow lines; DA1's answer ends it
CELL = (10, 20)  # pixels, if the terminal does not report it
ENTER = b"\x1b[?1049h\x1b[?25l\x1b[?7l\x1b[2J"  # its own screen, no cursor, no wrapping at the edge
LEAVE = b"\x1b[m\x1b[?7h\x1b[?25h\x1b[?1049l"
BEGIN, END = b"\x1b[?2026h", b"\x1b[?2026l"  # synchronized output, in terminals that support it
KITTY_QUERY = b"\x1b_Gi=31,s=1,v=1,a=q,t=d,f=24;AAAA\x1b\\"
TRUE_COLOUR_QUERY = b"\x1b[48;2;1;2;3m\x1bP$qm\x1b\\\x1b[m"  # DECRQSS: whether it kept that colour
CELL_QUERY = b"\x1b[16t"
DA1 = b"\x1b[c"
SIXEL = "4"  # among DA1's attributes
KEYS = {b"\x1b[C": "right", b"\x1b[D": "left", b"\x1bOC": "right", b"\x1bOD": "left", b"\x1b": "escape"}
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGWINCH, signal.SIGTSTP, signal.SIGCONT)


@dataclass(frozen=True)
class Abilities:
    """Graphics capabilities of a terminal. cell: width and height of a character cell in pixels."""

    kitty: bool = False
    sixel: bool = False
    true_colour: bool = False
    cell: tuple[int, int] = CELL


def parse_answers(answers: bytes) -> Abilities:
    """Parses a terminal's answers to the queries of its capabilities."""
    attributes = re.search(rb"\x1b\[\?([\d;]+)c", answers)
    cell = re.search(rb"\x1b\[6;(\d+);(\d+)t", answers)
    height, width = (int(cell[1]), int(cell[2])) if cell else (0, 0)
    return Abilities(
        kitty=re.search(rb"\x1b_Gi=31;OK\x1b\\", answers) is not None,
        sixel=attributes is not None and SIXEL in attributes[1].decode().split(";"),
        true_colour=re.search(rb"\x1bP1\$r[^\x1b]*48[:;]2[:;][\d:;]*1[:;]2[:;]3", answers) is not None,
        cell=(width, height) if width and height else CELL,
    )


class Terminal:
    """Context manager for the terminal at standard input and output, which restores the screen.

    ended: the signal that requests the end, or None. resized: set when the window has changed or the screen is lost.
    """

    def __init__(self) -> None:
        self.ended: int | None = None
        self.resized = True
        self._in, self._out = sys.stdin.fileno(), sys.stdout.fileno()
        self._before: list[Any] | None = None
        self._handlers: dict[signal.Signals, Any] = {}
        self._wake_read, self._wake_write = os.pipe()
        self._is_to_stop = self._goes_on = False
        for end in (self._wake_read, self._wake_write):
            os.set_blocking(end, False)

    @staticmethod
    def is_terminal() -> bool:
        """Returns True if both standard input and output are a terminal."""
        return sys.stdin.isatty() and sys.stdout.isatty() and os.environ.get("TERM", "dumb") != "dumb"

    def __enter__(self) -> Terminal:
        self._before = termios.tcgetattr(self._in)
        for each in SIGNALS:
            self._handlers[each] = signal.signal(each, self._signalled)
        self._enter_raw_mode()
        return self

    def __exit__(self, *_: object) -> None:
        self._restore()
        for each, handler in self._handlers.items():
            signal.signal(each, handler)
        os.close(self._wake_read)
        os.close(self._wake_write)

    def abilities(self) -> Abilities:
        """Queries the terminal's graphics capabilities."""
        self.write(KITTY_QUERY + TRUE_COLOUR_QUERY + CELL_QUERY + DA1)
        answers, deadline = b"", time.monotonic() + ANSWER_S
        while not re.search(rb"\x1b\[\?[\d;]+c", answers) and (left := deadline - time.monotonic()) > 0 and self.ended is None:
            if select.select([self._in], [], [], left)[0]:
                data = os.read(self._in, 4096)
                if not data:
                    break
                answers += data
        found = parse_answers(answers)
        if os.environ.get("COLORTERM", "") in ("truecolor", "24bit"):
            found = Abilities(found.kitty, found.sixel, True, found.cell)
        return found if found.cell != CELL else Abilities(found.kitty, found.sixel, found.true_colour, self._cell())

    def size(self) -> tuple[int, int]:
        """Returns the columns and rows of the terminal."""
        columns, rows = os.get_terminal_size(self._out)
        return max(columns, 1), max(rows, 1)

    def wake(self) -> None:
        """Makes `keys`, if it is waiting, return at once. Thread-safe, and safe in a signal handler."""
        with contextlib.suppress(OSError):  # full: it wakes up anyway; or closed
            os.write(self._wake_write, b".")

    def keys(self, seconds: float) -> Iterator[str]:
        """Yields the keys pressed within the next `seconds` seconds. Ends early after any other event."""
        ready, _, _ = select.select([self._in, self._wake_read], [], [], seconds)
        if self._wake_read in ready:
            with contextlib.suppress(OSError):
                os.read(self._wake_read, 4096)
        if self._is_to_stop:
            self._stop()
        if self._in in ready:
            try:
                data = os.read(self._in, 1024)
            except OSError:
                data = b""
            if not data:  # the window was closed
                self.ended = self.ended or signal.SIGHUP
                return
            yield from _keys(data)

    def draw(self, data: bytes) -> None:
        """Writes the bytes as one synchronized update of the screen, which does not flicker."""
        self.write(BEGIN + data + END)

    def write(self, data: bytes) -> None:
        """Writes all bytes. If the terminal is gone, sets `ended`, so that the program ends."""
        while data:
            try:
                data = data[os.write(self._out, data) :]
            except BlockingIOError:
                select.select([], [self._out], [], 1.0)
            except OSError:
                self.ended = self.ended or signal.SIGHUP
                return

    def _cell(self) -> tuple[int, int]:
        with contextlib.suppress(OSError):
            rows, columns, width, height = struct.unpack("HHHH", fcntl.ioctl(self._out, termios.TIOCGWINSZ, bytes(8)))
            if rows and columns and width >= columns and height >= rows:
                return width // columns, height // rows
        return CELL

    def _enter_raw_mode(self) -> None:
        tty.setcbreak(self._in, termios.TCSANOW)
        self.write(ENTER)
        self.resized = True

    def _restore(self) -> None:
        self.write(LEAVE)
        if self._before is not None:
            with contextlib.suppress(termios.error):  # the window is closed
                termios.tcsetattr(self._in, termios.TCSADRAIN, self._before)

    def _signalled(self, number: int, frame: FrameType | None) -> None:
        if number == signal.SIGTSTP:
            self._is_to_stop = True
        elif number == signal.SIGCONT:
            self._goes_on = True
        elif number == signal.SIGWINCH:
            self.resized = True
        else:
            self.ended = number
        self.wake()

    def _stop(self) -> None:
        """Handles Ctrl-Z: restores the terminal until the shell resumes the process."""
        self._is_to_stop = self._goes_on = False
        self._restore()
        os.kill(os.getpid(), signal.SIGSTOP)
        while not self._goes_on and self.ended is None:  # another thread may be the one that is stopped first
            time.sleep(0.02)
        self._enter_raw_mode()


def _keys(data: bytes) -> Iterator[str]:
    for found in re.finditer(rb"\x1b(?:[\[O][\d;?]*[A-Za-z~])?|[^\x1b]", data):
        key = found[0]
        if key in KEYS:
            yield KEYS[key]
        elif len(key) == 1:
            yield key.decode(errors="replace")
