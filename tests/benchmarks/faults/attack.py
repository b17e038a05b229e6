"""A kind of fault, and a single injection of it."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from dataclasses import dataclass

from tests.benchmarks.faults.ground import Ground
from tests.benchmarks.faults.stream import Stream

__all__ = ["KINDS", "Attack", "Kind", "kind"]


@dataclass
class Attack:
    """A fault being injected.

    since: the time from which the farm can recover, which is the fault's start, or its end if the fault lasts.
    """

    ground: Ground
    stream: Stream
    job: str
    draw: random.Random
    since: float = 0.0

    def pause(self, least_s: float, most_s: float) -> None:
        """Waits for a random time between `least_s` and `most_s` seconds, while the fault lasts."""
        time.sleep(self.draw.uniform(least_s, most_s))

    def over(self) -> None:
        """Marks the end of the fault, after which the farm can recover."""
        self.since = time.monotonic()


@dataclass(frozen=True)
class Kind:
    """A kind of fault, with the function that injects it.

    grounds: names of the test farms on which it can be injected. weight: frequency relative to the other kinds. harms_films:
    whether the job may fail with an error that asks the user to resume it.
    """

    name: str
    act: Callable[[Attack], None]
    grounds: tuple[str, ...]
    weight: int
    harms_films: bool  # the job may fail with an error that asks the user to resume it


KINDS: dict[str, Kind] = {}
EVERYWHERE = ("one machine", "another clock", "three hosts")


def kind(
    name: str, grounds: tuple[str, ...] = EVERYWHERE, weight: int = 2, harms_films: bool = False
) -> Callable[[Callable[[Attack], None]], Callable[[Attack], None]]:
    """Returns a decorator that registers a kind of fault.

    The decorated function injects the fault, and must undo everything except kills before it returns.
    """

    def add(act: Callable[[Attack], None]) -> Callable[[Attack], None]:
        KINDS[name] = Kind(name, act, grounds, weight, harms_films)
        return act

    return add
