"""Tests of the queue of database writers: first come, first served, except that urgent writers come before all others."""

from __future__ import annotations

import threading
import time

import pytest

from service.errors import Unavailable
from service.store.writer_queue import WriterQueue


def test_writers_are_served_in_order_and_urgent_first() -> None:
    turns, order = WriterQueue(), list[str]()

    def write(name: str, is_urgent: bool) -> None:
        with turns.wait_for_turn(10.0, is_urgent):
            order.append(name)

    threads = []
    with turns.wait_for_turn(1.0):
        for name in ("a", "b", "c", "engine"):
            threads.append(threading.Thread(target=write, args=(name, name == "engine")))
            threads[-1].start()
            while len(turns._line) < len(threads):
                time.sleep(0.001)
        with pytest.raises(Unavailable, match="it was locked for"), turns.wait_for_turn(0.05):
            pass
    for thread in threads:
        thread.join()
    assert order == ["engine", "a", "b", "c"]


def test_exception_ends_turn() -> None:
    turns = WriterQueue()
    with pytest.raises(KeyError), turns.wait_for_turn(1.0):
        raise KeyError
    with turns.wait_for_turn(1.0):
        pass
