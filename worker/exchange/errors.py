"""What can go wrong for a worker, by whose trouble it is.

WorkerError            one sentence for a person
├── Trouble            the worker's own: it may pass, and no scene is to blame; the work is tried again, then handed back
│   ├── LinkError      the service cannot be reached, or is ill
│   │   └── DamagedError   what it sent is not what was asked for: broken on the way, or on its disk
│   ├── TokenError     the service does not know this worker's token
│   ├── NotAFarmError  something else answers at the service's address
│   └── MachineError   this machine: a full disk, a cache that cannot be written, too many processes
├── UnfitError         this machine cannot do this work: another may, and no scene is to blame; not tried again here
├── RefusedError       the service answered and said no; another try gives the same answer
└── WorkError          the work's own: a file that is no scene
"""

from __future__ import annotations

import errno

__all__ = [
    "DamagedError",
    "LinkError",
    "MachineError",
    "NotAFarmError",
    "RefusedError",
    "TokenError",
    "Trouble",
    "UnfitError",
    "WorkError",
    "WorkerError",
    "is_of_machine",
]

# What a file system or a kernel says of itself, whatever the file: full, read-only, ill, or out of processes, files, memory.
_OF_MACHINE = {
    *(errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EACCES, errno.EPERM),
    *(errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM, errno.ESTALE),
}


class WorkerError(Exception):
    """`str(error)` is one sentence for a person."""


class Trouble(WorkerError):  # noqa: N818 - the name of a family
    """The worker's own: it may pass, and no scene is to blame."""


class LinkError(Trouble):
    """The service cannot be reached, or is ill."""


class DamagedError(LinkError):
    """What the service sent is not what was asked for."""


class TokenError(Trouble):
    """The service does not know this worker's token."""


class NotAFarmError(Trouble):
    """Something else answers at the service's address."""


class MachineError(Trouble):
    """This machine: a full disk, a cache that cannot be written, too many processes."""


class UnfitError(WorkerError):
    """This machine cannot do this work, whatever the scene: its limits, its memory, its temporary folder."""


class RefusedError(WorkerError):
    """The service answered and said no; another try gives the same answer."""


class WorkError(WorkerError):
    """The work did not end well, and its input is to blame."""


def is_of_machine(error: OSError) -> bool:
    """Whether an error is this machine's own and not that of the file in hand."""
    return error.errno in _OF_MACHINE
