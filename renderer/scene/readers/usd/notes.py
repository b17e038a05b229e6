"""Groups warnings by kind, since a scene may have thousands of the same kind."""

from __future__ import annotations

from collections.abc import Callable

from pxr import Tf

from renderer.sentences import Sentence

__all__ = ["UNREADABLE", "Notes"]

# Errors raised for prims with values of wrong types or arrays of wrong sizes.
UNREADABLE = (Tf.ErrorException, TypeError, ValueError, AttributeError, IndexError, OverflowError)

_MAX_LISTED = 3


class Notes:
    """Collects the warnings about a file, and groups those of the same kind."""

    def __init__(self) -> None:
        self._sentences: dict[str, None] = {}
        self._names: dict[str, dict[str, None]] = {}

    def add_sentence(self, sentence: str) -> None:
        """Adds a separate warning; a repeated sentence is added once."""
        self._sentences[sentence] = None

    def add(self, what: str, name: str) -> None:
        """Adds the name of an affected object to the group of warnings with the same sentence.

        what: the sentence, without a full stop.
        """
        self._names.setdefault(what, {})[name] = None

    def pass_on(self, warn: Callable[[str], None]) -> None:
        """Passes all warnings to a callback; each group with the number of its items and their first names."""
        for sentence in self._sentences:
            warn(sentence)
        for what, names in self._names.items():
            first = [name if isinstance(name, Sentence) else name[-80:] for name in list(names)[:_MAX_LISTED]]
            if len(names) > _MAX_LISTED:
                warn(Sentence("usd-note-some", "{note} ({count}): {names} and others.", note=what, count=len(names), names=first))
            else:
                warn(Sentence("usd-note-all", "{note} ({count}): {names}.", note=what, count=len(names), names=first))
