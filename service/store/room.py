"""Whether there is room on the disk, and the sentence to say if there is not."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from service.errors import NoRoom

__all__ = ["disk_checker", "full_disk", "need_room", "no_room"]

CHECK_EVERY = 16 << 20


def no_room() -> NoRoom:
    """What is said where the disk is full."""
    return NoRoom("The service's disk is full. Delete scenes or jobs that are no longer needed.", advice="Then send it again.")


@contextmanager
def full_disk() -> Iterator[None]:
    """Raise NoRoom where the system says that the disk is full."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise no_room() from error
        raise


def need_room(folder: Path, keep_free: int) -> None:
    """Raise NoRoom where something new is not to be begun: with what is under way, the disk would soon be full."""
    if shutil.disk_usage(folder).free < keep_free + CHECK_EVERY:
        raise no_room()


def disk_checker(folder: Path, keep_free: int) -> Callable[[int], None]:
    """A function of the bytes about to be written; raises NoRoom where the disk would fall below `keep_free`."""
    since_check = CHECK_EVERY

    def check(size: int) -> None:
        nonlocal since_check
        since_check += size
        if since_check >= CHECK_EVERY:
            since_check = 0
            need_room(folder, keep_free)

    return check
