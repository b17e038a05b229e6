"""Tests of the precedence of pages without a picture."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from service.viewing import first_pictures
from service.viewing.first_pictures import MOST_S, FirstPictures


def test_pages_that_are_opened_again_and_again_leave_half_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(first_pictures, "time", SimpleNamespace(monotonic=lambda: now[0]))
    first = FirstPictures()
    waiting: Any = SimpleNamespace(kind="a", awaits_first_picture=True)
    shown: Any = SimpleNamespace(kind="a", awaits_first_picture=False)
    other: Any = SimpleNamespace(kind="b", awaits_first_picture=False)

    def share(seconds: int) -> float:
        """Returns the share of the time in which the new page precedes other views."""
        found = []
        for _ in range(10 * seconds):
            now[0] += 0.1
            found.append(first.preceding_kinds([waiting, shown, other]))
        assert all(kinds <= {"a"} for kinds in found)
        return sum(map(bool, found)) / len(found)

    assert share(int(MOST_S) - 1) == 1.0
    share(2)
    assert share(60) == pytest.approx(0.5, abs=0.05)
    now[0] += MOST_S
    assert first.preceding_kinds([shown]) == set()
    now[0] += MOST_S
    assert share(5) == 1.0, "a rest restores the precedence"
