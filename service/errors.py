"""Errors of the service, independent of HTTP: service/http/problems.py maps them to status codes.

FarmError            base class; its message is a sentence that tells users what to do
├── NotFound         the object does not exist, or no longer
├── Conflict         not possible in the present state
├── NotAllowed       the caller may see the object but not change it
├── Invalid          malformed or contradictory request
├── TooLarge         beyond a limit of this farm
├── UnknownFormat    a format that this farm does not read
├── OutOfSpace       the disk, or the caller's quota of bytes, is full
├── OverQuota        the caller's quota of jobs or samples is used up
├── Unavailable      a part of the farm is unreachable or busy; a retry may succeed
│   └── NotOwner     another service has taken over the farm
├── Failed           a worker failed to process a request
├── AnswerTimeout    a worker did not answer in time
├── StartupError     the service cannot start on this data folder or with these settings
├── FilmUnavailable  temporary fault of a film: full disk, lock, read-only disk
└── FilmLost         permanent fault of a film: missing permission, newer release
    └── FilmDamaged  samples are missing or corrupt, and can be rendered again
QueueError           Redis cannot be reached; not reported to users, since the engine retries
"""

from __future__ import annotations

from renderer.sentences import Sentence, joined_sentences

__all__ = [
    "AnswerTimeout",
    "Conflict",
    "Failed",
    "FarmError",
    "FilmDamaged",
    "FilmLost",
    "FilmUnavailable",
    "Invalid",
    "NotAllowed",
    "NotFound",
    "NotOwner",
    "OutOfSpace",
    "OverQuota",
    "QueueError",
    "StartupError",
    "TooLarge",
    "Unavailable",
    "UnknownFormat",
]


class FarmError(Exception):
    """Base class of the service's errors. `str(error)` says what is wrong, and then what to do about it.

    advice: what to do, as a sentence. `fact`: the text without the advice, for logs of background work.
    """

    def __init__(self, sentence: str = "", *, advice: str = "") -> None:
        super().__init__(joined_sentences(sentence, advice))
        self.fact = sentence


class NotFound(FarmError):  # noqa: N818 - these are named as what they say
    """The object does not exist, or was deleted."""


class Conflict(FarmError):  # noqa: N818
    """The action is not possible in the present state."""


class NotAllowed(FarmError):  # noqa: N818
    """The caller may see the object but lacks permission for this action."""


class Invalid(FarmError):  # noqa: N818
    """The request is malformed or contradictory. field: name of the field at fault, if there is one."""

    def __init__(self, sentence: str = "", *, field: str | None = None, advice: str = "") -> None:
        super().__init__(sentence, advice=advice)
        self.field = field


class TooLarge(FarmError):  # noqa: N818
    """A limit of this farm is exceeded."""


class UnknownFormat(FarmError):  # noqa: N818
    """The file format is not supported by this farm."""


class OutOfSpace(FarmError):  # noqa: N818
    """The disk, or the caller's quota of bytes, is full."""


class OverQuota(FarmError):  # noqa: N818
    """The caller's quota of jobs or samples is used up. retry_after_s: seconds until a retry may succeed."""

    def __init__(self, sentence: str, retry_after_s: float) -> None:
        super().__init__(sentence)
        self.retry_after_s = retry_after_s


class Unavailable(FarmError):  # noqa: N818
    """A part of the farm is unreachable or busy; a retry may succeed. retry_after_s: recommended delay in seconds, or None."""

    def __init__(self, sentence: str, retry_after_s: float | None = None, *, advice: str = "") -> None:
        super().__init__(sentence, advice=advice)
        self.retry_after_s = retry_after_s


class NotOwner(Unavailable):
    """Another service has taken over the farm, so this one may no longer act as its owner."""

    def __init__(self) -> None:
        super().__init__(Sentence("farm-taken-over", "Another service has taken over this farm. Try again."), 1.0)


class Failed(FarmError):  # noqa: N818
    """A worker failed to process a request. The message is its error."""


class AnswerTimeout(FarmError):  # noqa: N818
    """A worker did not answer in time."""


class StartupError(FarmError):
    """The service cannot start on this data folder or with these settings."""


class FilmUnavailable(FarmError):  # noqa: N818
    """A film cannot be read or written at present: full disk, lock, read-only disk."""


class FilmLost(FarmError):  # noqa: N818
    """A film cannot be read or written, and waiting does not help: missing permission, newer release."""


class FilmDamaged(FilmLost):
    """A film's samples are missing or corrupt, and can be rendered again."""


class QueueError(Exception):
    """Redis cannot be reached. No message was sent."""
