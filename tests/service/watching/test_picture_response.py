"""Tests that any number of clients can read a picture file at the same time, and that none is left on the disk afterwards."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from service.watching.picture_response import MAX_IN_MEMORY, PIECE, PictureBody

OPEN_FILES = Path("/proc/self/fd")
LARGE = os.urandom(MAX_IN_MEMORY + 2 * PIECE + 7)


@pytest.mark.parametrize("data", [b"", b"few", LARGE])
def test_every_reader_gets_whole_body(data: bytes, tmp_path: Path) -> None:
    made = PictureBody.from_bytes(data, tmp_path)
    assert made.size == len(data)
    one, other = made.pieces(), made.pieces()
    first = next(one)
    assert len(first) <= max(PIECE, MAX_IN_MEMORY)
    assert b"".join(other) == data
    assert first + b"".join(one) == data


def test_unlinked_file_is_freed_with_last_reader(tmp_path: Path) -> None:
    open_before = set(OPEN_FILES.iterdir())
    made = PictureBody.from_bytes(LARGE, tmp_path)
    assert not list(tmp_path.iterdir())
    (file,) = set(OPEN_FILES.iterdir()) - open_before
    pieces = made.pieces()
    del made
    assert b"".join(pieces) == LARGE
    del pieces
    assert file not in set(OPEN_FILES.iterdir())


def test_full_disk_falls_back_to_memory(tmp_path: Path) -> None:
    made = PictureBody.from_bytes(LARGE, tmp_path / "not there")
    assert b"".join(made.pieces()) == LARGE


def test_write_error_is_raised_and_leaves_no_file(tmp_path: Path) -> None:
    def fail(path: Path) -> None:
        path.write_bytes(b"half")
        raise OSError("the disk is full")

    with pytest.raises(OSError, match="the disk is full"):
        PictureBody.from_writer(fail, tmp_path, ".exr")
    assert not list(tmp_path.iterdir())
