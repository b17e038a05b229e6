"""Frames that workers were asked to prepare for views, so that an answer can be matched even after the view has moved on."""

from __future__ import annotations

import time
from collections.abc import Container, Iterable

__all__ = ["PATIENCE_S", "AskedFrames"]

PATIENCE_S = 10.0  # with an answer to a message that neither waits nor is in a slot's hands


class AskedFrames:
    """By message. Lives in the desk's thread."""

    def __init__(self) -> None:
        self._asked: dict[str, tuple[str, str, float]] = {}

    def __len__(self) -> int:
        return len(self._asked)

    def add(self, message: str, name: str, scene: str) -> None:
        """A frame of a scene is asked for. name: says all that it depends on."""
        self._asked[message] = name, scene, time.monotonic()

    def about(self, message: str) -> tuple[str, str]:
        """The frame's name and its scene; empty where nobody waits for it any more."""
        return self._asked.get(message, ("", "", 0.0))[:2]

    def forget(self, messages: Iterable[str]) -> None:
        """They are answered, or nobody will."""
        for message in messages:
            self._asked.pop(message, None)

    def review(self, *alive: Container[str]) -> None:
        """Forget what was asked long ago, and is in none of these."""
        too_old = time.monotonic() - PATIENCE_S
        gone = [id for id, (*_, at) in self._asked.items() if at < too_old and not any(id in each for each in alive)]
        self.forget(gone)
