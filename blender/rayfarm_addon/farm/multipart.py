"""Encodes multipart/form-data. File contents are read while the form is being sent."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

__all__ = ["Part", "body_of"]

PIECE = 1 << 18


class Part(NamedTuple):
    """A file in a form. content: its bytes, or its path."""

    field: str
    name: str
    content: bytes | Path

    @property
    def size(self) -> int:
        """The content's size in bytes."""
        return self.content.stat().st_size if isinstance(self.content, Path) else len(self.content)


def body_of(parts: list[Part], fields: dict[str, str]) -> tuple[str, int, Iterator[bytes]]:
    """Returns (Content-Type, body length in bytes, iterator over the body's chunks)."""
    boundary = secrets.token_hex(16)
    heads = [_head(boundary, each.field, each.name) for each in parts]
    texts = b"".join(_head(boundary, name) + value.encode() + b"\r\n" for name, value in fields.items())
    end = f"--{boundary}--\r\n".encode()
    sizes = [each.size for each in parts]
    size = len(texts) + sum(map(len, heads)) + sum(sizes) + 2 * len(parts) + len(end)

    def pieces() -> Iterator[bytes]:
        yield texts
        for head, part in zip(heads, parts, strict=True):
            yield head
            yield from _read(part.content)
            yield b"\r\n"
        yield end

    return f"multipart/form-data; boundary={boundary}", size, pieces()


def _read(content: bytes | Path) -> Iterator[bytes]:
    if isinstance(content, Path):
        with content.open("rb") as file:
            while piece := file.read(PIECE):
                yield piece
    else:
        view = memoryview(content)
        for at in range(0, len(view), PIECE):
            yield bytes(view[at : at + PIECE])


def _head(boundary: str, field: str, file: str | None = None) -> bytes:
    named = "" if file is None else f'; filename="{_escaped(file)}"\r\nContent-Type: application/octet-stream'
    return f'--{boundary}\r\nContent-Disposition: form-data; name="{_escaped(field)}"{named}\r\n\r\n'.encode()


def _escaped(name: str) -> str:
    return name.replace('"', "%22").replace("\r", "%0D").replace("\n", "%0A")
