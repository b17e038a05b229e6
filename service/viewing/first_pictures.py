"""Precedence of pages without a picture over other views, for a part of the time."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterable

from service.viewing.session import ViewSession

__all__ = ["FirstPictures"]

MOST_S = 10.0  # seconds of precedence that can be used up; they are regained in as many seconds without it
MOST_STEP_S = 0.5  # seconds that a call uses up at most: the scheduler makes no calls while there are no sessions


class FirstPictures:
    """Decides for which worker kinds sessions that await their first picture precede the others.

    Pages that are opened or reloaded again and again precede in half of the time, so that other views go on.
    """

    def __init__(self) -> None:
        self._spent: defaultdict[str, float] = defaultdict(float)  # used seconds of precedence, by worker kind
        self._kinds: set[str] = set()
        self._at = time.monotonic()

    def preceding_kinds(self, sessions: Iterable[ViewSession]) -> set[str]:
        """Returns the worker kinds that now render only sessions that await their first picture."""
        now = time.monotonic()
        elapsed, self._at = now - self._at, now
        awaited = {each.kind for each in sessions if each.awaits_first_picture}
        for kind in self._kinds:
            self._spent[kind] += min(elapsed, MOST_STEP_S)
        for kind in self._spent.keys() - self._kinds:
            self._spent[kind] = max(self._spent[kind] - elapsed, 0.0)
        self._kinds = set(filter(self.can_precede, awaited))
        return self._kinds

    def can_precede(self, kind: str) -> bool:
        """Returns True if the precedence of a worker kind is not used up."""
        return self._spent[kind] < MOST_S
