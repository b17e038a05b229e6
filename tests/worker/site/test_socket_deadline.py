"""Tests of reading from a socket with a time limit, even if data arrives slowly."""

from __future__ import annotations

import io
import socket
import threading
import time

import pytest

from worker.site.socket_deadline import DeadlineReader


def test_slow_data_raises_timeout_after_deadline() -> None:
    here, there = socket.socketpair()
    stop = threading.Event()

    def trickle() -> None:
        while not stop.wait(0.02):
            there.send(b"x")

    with here, there:
        there.sendall(b"a line\nand more")
        timed = DeadlineReader(here, 20.0)
        reader = io.BufferedReader(timed)
        assert reader.readline() == b"a line\n"
        assert reader.read(8) == b"and more"
        thread = threading.Thread(target=trickle)
        thread.start()
        timed.set_deadline(0.3)
        begun = time.monotonic()
        with pytest.raises(TimeoutError):
            reader.read(1 << 20)
        assert 0.2 < time.monotonic() - begun < 15.0
        stop.set()
        thread.join()
        timed.set_deadline(20.0)
        there.shutdown(socket.SHUT_WR)
        assert reader.read() is not None
