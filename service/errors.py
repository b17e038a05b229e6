"""What can go wrong in the service, without a word of HTTP: service/http/problems.py says which status each is answered with.

FarmError           a sentence that a person can act on
├── NotFound        it is not there, or not any more
├── Conflict        it cannot be done in the state that things are in
├── NotAllowed      who asks may see it, and not do that to it
├── Invalid         what is asked for makes no sense
├── TooLarge        it is beyond a limit of this farm
├── UnknownFormat   it comes in a format that this farm does not read
├── NoRoom          the disk is full, or what somebody may have of it
├── OverQuota       somebody has or does as much as they may at a time
├── Unavailable     a part of the farm is away or busy; the same may work later
│   └── NotOwner        another service has taken the farm over
├── Failed          a worker could not do it
├── TooLate         a worker did not answer in time
├── CannotStart     the service, on this data folder or with these settings
├── FilmWaits       a film cannot be written or read now, and will be later: a full disk, a lock, a read-only disk
└── FilmLost        a film cannot be written or read any more: without the right to, of a newer release
    └── FilmDamaged     what it had is not there or not what was written: what is missing can be rendered again

QueueError          Redis cannot be reached: told to nobody, since the engine tries again
"""

from __future__ import annotations

__all__ = [
    "CannotStart",
    "Conflict",
    "Failed",
    "FarmError",
    "FilmDamaged",
    "FilmLost",
    "FilmWaits",
    "Invalid",
    "NoRoom",
    "NotAllowed",
    "NotFound",
    "NotOwner",
    "OverQuota",
    "QueueError",
    "TooLarge",
    "TooLate",
    "Unavailable",
    "UnknownFormat",
]


class FarmError(Exception):
    """`str(error)` is one sentence that a person can act on. `fact` is what of it also holds for work that waits by itself: all
    but the advice to whoever asked."""

    def __init__(self, sentence: str = "", *, advice: str = "") -> None:
        super().__init__(f"{sentence} {advice}" if advice else sentence)
        self.fact = sentence


class NotFound(FarmError):  # noqa: N818 - these are named as what they say
    """It is not there, or not any more."""


class Conflict(FarmError):  # noqa: N818
    """It cannot be done in the state that things are in."""


class NotAllowed(FarmError):  # noqa: N818
    """Who asks may see it, and not do that to it."""


class Invalid(FarmError):  # noqa: N818
    """What is asked for makes no sense. field: of the request, where one is to blame."""

    def __init__(self, sentence: str = "", *, field: str | None = None, advice: str = "") -> None:
        super().__init__(sentence, advice=advice)
        self.field = field


class TooLarge(FarmError):  # noqa: N818
    """It is beyond a limit of this farm."""


class UnknownFormat(FarmError):  # noqa: N818
    """It comes in a format that this farm does not read."""


class NoRoom(FarmError):  # noqa: N818
    """The disk is full."""


class OverQuota(FarmError):  # noqa: N818
    """Somebody has or does as much as they may at a time. retry_after_s: when it may be otherwise by itself."""

    def __init__(self, sentence: str, retry_after_s: float) -> None:
        super().__init__(sentence)
        self.retry_after_s = retry_after_s


class Unavailable(FarmError):  # noqa: N818
    """A part of the farm is away or busy; the same may work later. retry_after_s: when, where that is known."""

    def __init__(self, sentence: str, retry_after_s: float | None = None, *, advice: str = "") -> None:
        super().__init__(sentence, advice=advice)
        self.retry_after_s = retry_after_s


class NotOwner(Unavailable):
    """Another service has taken the farm over: this one may do nothing in its name."""

    def __init__(self) -> None:
        super().__init__("Another service has taken this farm over. Ask again.", 1.0)


class Failed(FarmError):  # noqa: N818
    """A worker could not do it."""


class TooLate(FarmError):  # noqa: N818
    """A worker did not answer in time."""


class CannotStart(FarmError):  # noqa: N818
    """The service cannot start on this data folder, or with these settings."""


class FilmWaits(FarmError):  # noqa: N818
    """A film cannot be written or read now, and will be later: a full disk, a lock, a read-only disk."""


class FilmLost(FarmError):  # noqa: N818
    """A film cannot be written or read any more: without the right to, of a newer release."""


class FilmDamaged(FilmLost):
    """What a film had is not there or not what was written: what is missing can be rendered again."""


class QueueError(Exception):
    """Redis cannot be reached; nothing was sent."""
