"""Tests of sending sums in a thread: at most one behind, in order, and no error or result is lost."""

from __future__ import annotations

import threading

import pytest

from worker.exchange.sums_sender import SumsSender


def test_one_result_is_sent_in_the_background_and_all_before_the_end() -> None:
    sent: list[int] = []
    may_end, begun = threading.Event(), threading.Event()

    def slow() -> None:
        begun.set()
        assert may_end.wait(10)
        sent.append(1)

    with SumsSender() as sender:
        sender.submit(slow)
        assert not begun.wait(0.05), "it is held back until the next kernel runs"
        sender.begin()
        assert begun.wait(10), "it is sent while this thread goes on"
        assert sent == []
        may_end.set()
        sender.submit(lambda: sent.append(2))
        sender.send_now(lambda: sent.append(3))
        assert sent == [1, 2, 3]
        sender.submit(lambda: sent.append(4))
    assert sent == [1, 2, 3, 4]
    assert not [each for each in threading.enumerate() if each.name.startswith("sums")], "a slot may fork again"


def test_failing_side_task_does_not_stop_the_sums() -> None:
    sent: list[int] = []
    failed = threading.Event()

    def fail() -> None:
        failed.set()
        raise KeyError("odd answer")

    with SumsSender(every=fail) as sender:
        sender.begin()
        assert failed.wait(10)
        sender.submit(lambda: sent.append(1))
    assert sent == [1]


def test_error_of_sending_is_raised_at_the_next_result_or_at_the_end() -> None:
    def broken() -> None:
        raise OSError("no line")

    with pytest.raises(OSError, match="no line"), SumsSender() as sender:
        sender.submit(broken)
        sender.submit(lambda: pytest.fail("sent after an error"))
    with pytest.raises(OSError, match="no line"), SumsSender() as sender:
        sender.submit(broken)
