"""Reads the relationships of a part of a 3MF package to other parts (ECMA-376 part 2)."""

from __future__ import annotations

from xml.parsers import expat

__all__ = ["relations_of"]


def relations_of(data: bytes) -> list[tuple[str, str]]:
    """Returns (target, type) pairs of a part's relationships; empty if the XML is damaged."""
    found: list[tuple[str, str]] = []
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        if tag.rpartition(":")[2] == "Relationship":
            found.append((attributes.get("Target", ""), attributes.get("Type", "").lower()))

    parser.StartElementHandler = start
    try:
        parser.Parse(data, True)
    except expat.ExpatError:
        return []
    return found
