"""Lookup of clips, variants and the like by name or number."""

from __future__ import annotations

from renderer.errors import SceneError
from renderer.sentences import Sentence

__all__ = ["number_of"]


def number_of(what: str, names: list[str], asked: str, file: str) -> int:
    """Returns the index in `names` of an item given by name or number. Raises SceneError with the list of names."""
    if asked in names:
        return names.index(asked)
    if asked.isascii() and asked.isdigit() and len(asked) < 10 and int(asked) < len(names):
        return int(asked)
    if not names:
        raise SceneError(Sentence("choice-none-in-file", "{file}: has no {kind}s; leave the {kind} out", file=file, kind=what))
    listed = ", ".join(f"{i}: {name[:60]}" for i, name in enumerate(names[:20]))
    raise SceneError(
        Sentence(
            "choice-not-in-file",
            "{file}: has no {kind} {name}; its {kind}s are {choices}",
            file=file,
            kind=what,
            name=repr(asked[:60]),
            choices=listed,
        )
    )
