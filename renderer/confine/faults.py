"""Distinguishes errors caused by the machine from errors caused by the file."""

from __future__ import annotations

import errno

__all__ = ["is_of_machine"]

# A full, read-only or failing file system; no more files, processes or file size. Not a file without permission: a scene may
# refer to one outside of its folder.
_MACHINE_ERRORS = {
    *(errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO),
    *(errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ESTALE, errno.EFBIG),
}


def is_of_machine(error: BaseException) -> bool:
    """Returns True if an exception of the system or of a library is caused by this machine, not by the file that is read."""
    if isinstance(error, OSError):
        return error.errno in _MACHINE_ERRORS
    return isinstance(error, RuntimeError) and "start new thread" in str(error)
