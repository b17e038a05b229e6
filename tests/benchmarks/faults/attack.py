"""One fault: what it is, and what it is done to."""

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
    """A fault that is being done. `since`: from when on the farm could recover; the fault's end where it lasts."""

    ground: Ground
    stream: Stream
    job: str
    draw: random.Random
    since: float = 0.0

    def pause(self, least_s: float, most_s: float) -> None:
        """Let the fault last."""
        time.sleep(self.draw.uniform(least_s, most_s))

    def over(self) -> None:
        """From now on nothing is in the farm's way."""
        self.since = time.monotonic()


@dataclass(frozen=True)
class Kind:
    """A kind of fault. grounds: the names of those where it can be done. weight: how often it is drawn."""

    name: str
    act: Callable[[Attack], None]
    grounds: tuple[str, ...]
    weight: int
    harms_films: bool  # the job may end with a sentence that asks to set it to running


KINDS: dict[str, Kind] = {}
EVERYWHERE = ("one machine", "another clock", "three hosts")


def kind(
    name: str, grounds: tuple[str, ...] = EVERYWHERE, weight: int = 2, harms_films: bool = False
) -> Callable[[Callable[[Attack], None]], Callable[[Attack], None]]:
    """Add a kind of fault to KINDS. It returns when all that it did is undone, but what it killed."""

    def add(act: Callable[[Attack], None]) -> Callable[[Attack], None]:
        KINDS[name] = Kind(name, act, grounds, weight, harms_films)
        return act

    return add
