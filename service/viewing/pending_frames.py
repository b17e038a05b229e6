"""Requests for animation frames that are unanswered. An answer is used even if the session shows another view by then."""

from __future__ import annotations

import time
from collections.abc import Container, Iterable

__all__ = ["ANSWER_TIMEOUT_S", "PendingFrames"]

ANSWER_TIMEOUT_S = 10.0  # for a message that is neither queued nor held by a slot


class PendingFrames:
    """Unanswered frame requests, by message id. Used in the scheduler's thread only."""

    def __init__(self) -> None:
        self._asked: dict[str, tuple[str, str, float]] = {}

    def __len__(self) -> int:
        return len(self._asked)

    def add(self, message: str, name: str, scene: str) -> None:
        """Adds a request. name: FrameRequest.cache_key of the frame."""
        self._asked[message] = name, scene, time.monotonic()

    def key_and_scene(self, message: str) -> tuple[str, str]:
        """Returns the cache key and the scene of the requested frame; two empty strings for an unknown message."""
        return self._asked.get(message, ("", "", 0.0))[:2]

    def remove(self, messages: Iterable[str]) -> None:
        """Removes requests that were answered or withdrawn."""
        for message in messages:
            self._asked.pop(message, None)

    def remove_expired(self, *alive: Container[str]) -> None:
        """Removes requests older than ANSWER_TIMEOUT_S seconds, except those whose message id is in a container in `alive`."""
        too_old = time.monotonic() - ANSWER_TIMEOUT_S
        gone = [id for id, (*_, at) in self._asked.items() if at < too_old and not any(id in each for each in alive)]
        self.remove(gone)
