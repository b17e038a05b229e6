"""What is not taken over, said once with how often: scenes have thousands of the same."""

from __future__ import annotations

from collections.abc import Callable

from pxr import Tf

__all__ = ["UNREADABLE", "Notes"]

# What reading a prim raises that has values of other types than its schema's, or arrays that do not fit.
UNREADABLE = (Tf.ErrorException, TypeError, ValueError, AttributeError, IndexError, OverflowError)

_NAMED = 3


class Notes:
    """Gathers what is to be said of a file."""

    def __init__(self) -> None:
        self._sentences: dict[str, None] = {}
        self._names: dict[str, dict[str, None]] = {}

    def say(self, sentence: str) -> None:
        """A whole sentence, once."""
        self._sentences[sentence] = None

    def add(self, what: str, name: str) -> None:
        """One of perhaps many of which the same is to be said, without a full stop."""
        self._names.setdefault(what, {})[name] = None

    def tell(self, warn: Callable[[str], None]) -> None:
        """Says it all: of the many, how many they are and what the first are called."""
        for sentence in self._sentences:
            warn(sentence)
        for what, names in self._names.items():
            listed = ", ".join(name[-80:] for name in list(names)[:_NAMED])
            more = " and others" if len(names) > _NAMED else ""
            warn(f"{what} ({len(names)}): {listed}{more}.")
