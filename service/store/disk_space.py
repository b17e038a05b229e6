"""Checks of free disk space, and the error for a full disk."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from renderer.sentences import Sentence
from service.errors import OutOfSpace

__all__ = ["check_free_space", "disk_checker", "disk_full_error", "translated_disk_errors"]

CHECK_EVERY = 16 << 20


def disk_full_error() -> OutOfSpace:
    """Returns the error for a full disk."""
    return OutOfSpace(
        Sentence("disk-full", "The service's disk is full. Delete scenes or jobs that are no longer needed."),
        advice=Sentence("advice-send-again", "Then send it again."),
    )


@contextmanager
def translated_disk_errors() -> Iterator[None]:
    """Context manager that converts the operating system's disk-full errors to OutOfSpace."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise disk_full_error() from error
        raise


def check_free_space(folder: Path, keep_free: int) -> None:
    """Raises OutOfSpace if the disk has less than `keep_free` bytes, plus a margin for writes in progress."""
    if shutil.disk_usage(folder).free < keep_free + CHECK_EVERY:
        raise disk_full_error()


def disk_checker(folder: Path, keep_free: int) -> Callable[[int], None]:
    """Returns a function that is called with the number of bytes about to be written.

    The function raises OutOfSpace if the disk would have less than `keep_free` bytes left. It checks the disk once every
    CHECK_EVERY bytes.
    """
    since_check = CHECK_EVERY

    def check(size: int) -> None:
        nonlocal since_check
        since_check += size
        if since_check >= CHECK_EVERY:
            since_check = 0
            check_free_space(folder, keep_free)

    return check
