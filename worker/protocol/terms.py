"""What a worker is asked for at run time, and what it offers, in keys beside its report that older workers do without.

service --- key terms_key(name) --> worker     Terms: what an administrator asks for, and the queues of needs that it serves
worker ---- key offer_key(name) --> service    Offer: what it can, which terms it keeps, and why it rests; expires
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from dataclasses import asdict, dataclass, fields, replace
from functools import lru_cache
from typing import Any

from worker.protocol.contract import render_queue
from worker.protocol.hours import Hours

__all__ = ["NEEDS", "OFFER_TTL_S", "TAG", "Offer", "Terms", "needs_queue", "offer_key", "terms_key"]

OFFER_TTL_S = 30
MOST_NICE = 19
MOST_MEMORY = 10**15  # bytes
MOST_OF_AN_OFFER = 1 << 60  # any number in it
LONGEST_TEXT, MOST_TEXTS = 4000, 1000
NEEDS = ".needs."  # in a queue's name: after its kind
TAG = re.compile(r"[a-z0-9][a-z0-9._:-]{0,62}")


@dataclass(frozen=True)
class Terms:
    """None: as the worker was started."""

    hours: str | None = None  # worker.hours; empty: always
    idle_minutes: float | None = None  # it works only when nobody has worked at its machine for so long; 0: in any case
    nice: int | None = None  # 0 to 19: how far it stands back for other programs of its machine
    slots: int | None = None  # at most
    memory: int | None = None  # bytes; 0: no limit
    queues: tuple[str, ...] = ()  # beside its own

    @classmethod
    def from_bytes(cls, data: bytes) -> Terms:
        """What `to_bytes` wrote, here or in another release. Raises ValueError where it is something else."""
        try:
            found = json.loads(data)
            known = {f.name: found[f.name] for f in fields(cls) if found.get(f.name) is not None}
            terms = cls(**known | {"queues": tuple(map(str, known.get("queues", ())))})
        except (TypeError, AttributeError, RecursionError) as error:
            raise ValueError(f"no terms: {error}") from None
        return terms.checked()

    def to_bytes(self) -> bytes:
        """JSON for the worker's key; the same terms are the same bytes."""
        return json.dumps({name: value for name, value in asdict(self).items() if value is not None}, sort_keys=True).encode()

    @property
    def digest(self) -> str:
        """By which a worker says that it keeps these."""
        return hashlib.sha256(self.to_bytes()).hexdigest()[:16]

    def checked(self) -> Terms:
        """Themselves. Raises ValueError with a sentence where a value is none."""
        if self.hours:
            Hours.parse(self.hours)
        for name, value, most in (
            ("idle_minutes", self.idle_minutes, 1e6),
            ("nice", self.nice, MOST_NICE),
            ("slots", self.slots, 4096),
            ("memory", self.memory, MOST_MEMORY),
        ):
            least = name == "slots"
            if value is not None and not (
                isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) and least <= value <= most
            ):
                among = f"0 and {most / 1e9:,.0f} GB" if name == "memory" else f"{int(least)} and {most:,.0f}"
                raise ValueError(f"{name} lies between {among}")
        return self

    def over(self, own: Terms) -> Terms:
        """These where they say something, else a worker's own."""
        said = {f.name: value for f in fields(self) if (value := getattr(self, f.name)) is not None}
        return replace(own, **said)


@dataclass(frozen=True)
class Offer:
    """A worker, beside its report."""

    tags: tuple[str, ...]
    memory: int  # bytes that it may use: its limit, else all that its machine has
    slots_most: int  # it has so many processes
    keeps: str  # the digest of the terms that it keeps
    hours: str = ""
    idle_minutes: float = 0.0
    idle_by: tuple[str, ...] = ()  # by what it knows that somebody works at the machine: load, terminals, desktop, screen
    nice: int = 0
    memory_limit: int = 0
    queues: tuple[str, ...] = ()  # of needs, that it takes from now
    why: str | None = None  # it rests, as a sentence
    trouble: str | None = None  # what of its terms it cannot keep, as a sentence

    def to_bytes(self) -> bytes:
        """JSON for the worker's key."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> Offer:
        """What `to_bytes` wrote, here or in another release. Raises ValueError where it is something else."""
        try:
            found = json.loads(data)
            known = {f.name: found[f.name] for f in fields(cls) if f.name in found}
            for name in ("tags", "idle_by", "queues"):
                known[name] = tuple(map(str, known.get(name, ())))
            offer = cls(**known)
        except (TypeError, KeyError, AttributeError, RecursionError) as error:
            raise ValueError(f"no offer: {error}") from None
        whole: list[Any] = [offer.memory, offer.slots_most, offer.nice, offer.memory_limit]
        lists: list[Any] = [*offer.tags, *offer.idle_by, *offer.queues]
        texts: list[Any] = [offer.keeps, offer.hours, offer.why or "", offer.trouble or "", *lists]
        if not (
            all(isinstance(number, int) for number in whole)
            and isinstance(offer.idle_minutes, int | float)
            and all(
                0 <= number <= MOST_OF_AN_OFFER
                for number in (offer.memory, offer.slots_most, offer.memory_limit, offer.idle_minutes)
            )
            and abs(offer.nice) <= MOST_NICE + 1  # below 0 where root has started it so
            and all(isinstance(text, str) and len(text) <= LONGEST_TEXT for text in texts)
            and len(lists) <= MOST_TEXTS
        ):
            raise ValueError("no offer: its fields are of other types")
        return offer


@lru_cache(4096)
def needs_queue(kind: str, needs: str) -> str:
    """The Celery queue for batches of jobs of this kind that need something. needs: as text, the same for the same."""
    return f"{render_queue(kind)}{NEEDS}{hashlib.sha256(needs.encode()).hexdigest()[:16]}"


def terms_key(name: str) -> str:
    """The Redis key under which the service says what is asked of a worker."""
    return f"rayfarm:terms:{name}"


def offer_key(name: str) -> str:
    """The Redis key under which a worker says what it offers."""
    return f"rayfarm:offer:{name}"
