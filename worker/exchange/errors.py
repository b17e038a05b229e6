"""Errors of a worker, by their cause.

WorkerError            base class; the message is one sentence
├── TemporaryError     failure of the worker, not of a scene; the worker retries, then gives the work back to the service
│   ├── LinkError      the service cannot be reached, or answers with a server error
│   │   └── DamagedError the content differs from the request: corrupted in transit or on the service's disk
│   ├── TokenError     the service does not accept this worker's token
│   ├── NotAFarmError  the service's address is that of another server
│   └── MachineError   this machine: a full disk, an unwritable cache, too many processes
├── UnfitError         this machine cannot do this work, another may; the scene is not at fault; not retried here
├── RefusedError       the service rejected the request; a retry gives the same answer
└── WorkError          failure of the work itself: for instance a file that is not a scene
"""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager

from renderer.library_messages import library_message
from renderer.sentences import Sentence

__all__ = [
    "DamagedError",
    "LinkError",
    "MachineError",
    "NotAFarmError",
    "RefusedError",
    "TemporaryError",
    "TokenError",
    "UnfitError",
    "WorkError",
    "WorkerError",
    "answered_status",
    "is_of_machine",
    "not_reachable",
    "storage_errors",
    "token_unknown",
]

# Errors of the file system or the kernel, whatever the file: full, read-only, I/O error, or out of processes, files, memory.
_OF_MACHINE = {
    *(errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EACCES, errno.EPERM),
    *(errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM, errno.ESTALE),
}


class WorkerError(Exception):
    """Base class of a worker's errors. `str(error)` is one sentence for users."""


class TemporaryError(WorkerError):
    """Failure of the worker rather than of a scene. It may be temporary."""


class LinkError(TemporaryError):
    """Raised if the service cannot be reached, or answers with a server error."""


class DamagedError(LinkError):
    """Raised if the content that the service sent does not match the request."""


class TokenError(TemporaryError):
    """Raised if the service does not accept this worker's token."""


class NotAFarmError(TemporaryError):
    """Raised if another server answers at the service's address."""


class MachineError(TemporaryError):
    """Failure of this machine: a full disk, an unwritable cache, too many processes."""


class UnfitError(WorkerError):
    """Raised if this machine's limits, memory or temporary folder do not permit this work. The scene is not the cause."""


class RefusedError(WorkerError):
    """Raised if the service rejects a request. A retry gives the same answer."""


class WorkError(WorkerError):
    """Raised if the work fails because of its input."""


def is_of_machine(error: OSError) -> bool:
    """Returns True if an error is caused by this machine rather than by the file being read."""
    return error.errno in _OF_MACHINE


@contextmanager
def storage_errors() -> Iterator[None]:
    """Raises MachineError for an OSError of this machine in the `with` block, which stores a scene's files."""
    try:
        yield
    except OSError as error:
        if not is_of_machine(error):
            raise
        raise MachineError(
            Sentence(
                "machine-file-storage-failed",
                "this machine cannot store a scene's files ({error}: {path})",
                error=library_message(error),
                path=error.filename,
            )
        ) from error


def not_reachable(service: str, error: Exception) -> Sentence:
    """Returns the sentence for a service that does not answer."""
    return Sentence("service-not-reachable", "no answer from {service} ({error})", service=service, error=library_message(error))


def token_unknown(service: str) -> Sentence:
    """Returns the sentence for a token that the service rejects."""
    return Sentence(
        "worker-token-unknown",
        "{service} does not know this token. Take the token that `rayfarm up` shows, or ask the administrator of this farm.",
        service=service,
    )


def answered_status(service: str, status: int, request: str) -> Sentence:
    """Returns the sentence for an HTTP status that is an error. request: method and path."""
    return Sentence(
        "service-answered-status",
        "{service} answers {status} to {request}",
        service=service,
        status=status,
        request=request,
    )
