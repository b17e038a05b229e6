"""Rejects XML documents that declare entities, which could expand to gigabytes."""

from __future__ import annotations

import re

from renderer.errors import SceneError
from renderer.sentences import Sentence

__all__ = ["refuse_entities"]

_ENTITY, _DOCTYPE = re.compile(rb"<!ENTITY", re.IGNORECASE), re.compile(rb"<!(DOCTYPE|ENTITY)", re.IGNORECASE)


def refuse_entities(data: bytes, file: str, doctype_too: bool = True) -> None:
    """Raises SceneError if an XML file, in any Unicode encoding, declares entities.

    doctype_too: whether to reject every document type declaration, even without entities.
    """
    plain = data.replace(b"\0", b"") if b"\0" in data[:8] else data
    if (_DOCTYPE if doctype_too else _ENTITY).search(plain):
        raise SceneError(
            Sentence(
                "xml-entities-forbidden",
                "{file} declares XML entities, which are not allowed; remove its DOCTYPE",
                file=file,
            )
        )
