"""Looks up clips and variants by name or number."""

from __future__ import annotations

from typing import Literal

from renderer.errors import SceneError
from renderer.sentences import Sentence

__all__ = ["number_of"]


def number_of(kind: Literal["clip", "variant"], names: list[str], name_or_number: str, file: str) -> int:
    """Returns the index in `names` of an item requested by name or by number from 0.

    Raises SceneError, with the list of names, if there is none.
    """
    if name_or_number in names:
        return names.index(name_or_number)
    if name_or_number.isascii() and name_or_number.isdigit() and len(name_or_number) < 10 and int(name_or_number) < len(names):
        return int(name_or_number)
    if not names:
        raise SceneError(
            Sentence("clips-none-in-file", "{file} has no clips; leave the clip out", file=file)
            if kind == "clip"
            else Sentence("variants-none-in-file", "{file} has no variants; leave the variant out", file=file)
        )
    found, wanted = [f"{i}: {name[:60]}" for i, name in enumerate(names[:20])], repr(name_or_number[:60])
    raise SceneError(
        Sentence("clip-not-in-file", "{file} has no clip {name}; its clips are {choices}", file=file, name=wanted, choices=found)
        if kind == "clip"
        else Sentence(
            "variant-not-in-file",
            "{file} has no variant {name}; its variants are {choices}",
            file=file,
            name=wanted,
            choices=found,
        )
    )
