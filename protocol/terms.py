"""Run-time settings and capabilities of a worker, in Redis keys in addition to its report. Older workers ignore them.

service --- key terms_key(name) --> worker     Terms: an administrator's settings, and the requirement queues to serve
worker ---- key offer_key(name) --> service    Offer: capabilities, the settings in effect, and why it takes no tasks; expires
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from dataclasses import asdict, dataclass, fields, replace
from functools import lru_cache
from typing import Any

from protocol.contract import render_queue
from protocol.hours import Hours
from renderer.sentences import Sentence, decoded, encoded

__all__ = ["NEEDS", "OFFER_TTL_S", "TAG", "Offer", "Terms", "needs_queue", "offer_key", "terms_key"]

OFFER_TTL_S = 30
MAX_NICE = 19
MAX_MEMORY = 10**15  # bytes
MAX_OFFER_NUMBER = 1 << 60  # upper limit on every number of an offer
LONGEST_TEXT, MOST_TEXTS = 4000, 1000
NEEDS = ".needs."  # separates the kind from the digest in a queue's name
TAG = re.compile(r"[a-z0-9][a-z0-9._:-]{0,62}")


@dataclass(frozen=True)
class Terms:
    """Run-time settings of a worker. A value of None means that the worker keeps the value with which it was started.

    hours: when it takes tasks (hours.py); empty: always. idle_minutes: minutes without user activity after which it takes
    tasks. slots: maximum number of slots in use. memory: limit in bytes; 0: unlimited. queues: requirement queues to serve in
    addition to its own.
    """

    hours: str | None = None  # hours.py; empty: always
    idle_minutes: float | None = None  # works only after this much user inactivity; 0: always
    nice: int | None = None  # nice level, 0 to 19
    slots: int | None = None  # maximum number of slots in use
    memory: int | None = None  # bytes; 0: no limit
    queues: tuple[str, ...] = ()  # served in addition to its own

    @classmethod
    def from_bytes(cls, data: bytes) -> Terms:
        """Parses settings from `to_bytes` of this or another release. Raises ValueError if they are malformed."""
        try:
            found = json.loads(data)
            known: dict[str, Any] = {f.name: found[f.name] for f in fields(cls) if found.get(f.name) is not None}
            known["queues"] = tuple(map(str, known.get("queues", ())))
            terms = cls(**known)
        except (TypeError, AttributeError, RecursionError) as error:
            raise ValueError(f"invalid terms: {error}") from None
        return terms.checked()

    def to_bytes(self) -> bytes:
        """Serializes the settings as JSON for the worker's key. Equal settings give equal bytes."""
        return json.dumps({name: value for name, value in asdict(self).items() if value is not None}, sort_keys=True).encode()

    @property
    def digest(self) -> str:
        """Returns a digest of 16 hexadecimal digits, with which a worker confirms that these settings are in effect."""
        return hashlib.sha256(self.to_bytes()).hexdigest()[:16]

    def checked(self) -> Terms:
        """Returns these settings unchanged. Raises ValueError with a sentence if a value is out of range."""
        if self.hours:
            Hours.parse(self.hours)
        for name, value, most in (
            ("idle_minutes", self.idle_minutes, 1e6),
            ("nice", self.nice, MAX_NICE),
            ("slots", self.slots, 4096),
            ("memory", self.memory, MAX_MEMORY),
        ):
            least = name == "slots"
            if value is not None and not (
                isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) and least <= value <= most
            ):
                unit = " GB" if name == "memory" else ""
                greatest = f"{most / 1e9 if name == 'memory' else most:,.0f}{unit}"
                raise ValueError(
                    Sentence(
                        "terms-out-of-range",
                        "{name} must be between {least} and {most}",
                        name=name,
                        least=int(least),
                        most=greatest,
                    )
                )
        return self

    def with_defaults(self, own: Terms) -> Terms:
        """Returns a copy of these settings in which the worker's start values, `own`, replace values that are None."""
        said = {f.name: value for f in fields(self) if (value := getattr(self, f.name)) is not None}
        return replace(own, **said)


@dataclass(frozen=True)
class Offer:
    """Capabilities and state of a worker, in addition to its report.

    keeps: digest of the settings in effect. idle_by: sources by which user activity is detected. why: a sentence on why it
    takes no tasks, or None. trouble: a sentence on which settings it cannot apply, or None.
    """

    tags: tuple[str, ...]
    memory: int  # usable bytes: its limit, else the machine's memory
    slots_most: int  # its number of processes
    keeps: str  # digest of the terms in effect
    hours: str = ""
    idle_minutes: float = 0.0
    idle_by: tuple[str, ...] = ()  # sources of user activity: load, terminals, desktop, screen
    nice: int = 0
    memory_limit: int = 0
    queues: tuple[str, ...] = ()  # requirement queues that it serves now
    why: str | None = None  # why it is idle, as a sentence
    trouble: str | None = None  # which terms it cannot apply, as a sentence

    def to_bytes(self) -> bytes:
        """Serializes the offer as JSON for the worker's key."""
        return json.dumps(encoded(asdict(self))).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> Offer:
        """Parses an offer from `to_bytes` of this or another release. Raises ValueError if it is malformed."""
        try:
            found = decoded(json.loads(data))
            known = {f.name: found[f.name] for f in fields(cls) if f.name in found}
            for name in ("tags", "idle_by", "queues"):
                known[name] = tuple(map(str, known.get(name, ())))
            offer = cls(**known)
        except (TypeError, KeyError, AttributeError, RecursionError) as error:
            raise ValueError(f"invalid offer: {error}") from None
        whole: list[Any] = [offer.memory, offer.slots_most, offer.nice, offer.memory_limit]
        lists: list[Any] = [*offer.tags, *offer.idle_by, *offer.queues]
        texts: list[Any] = [offer.keeps, offer.hours, offer.why or "", offer.trouble or "", *lists]
        if not (
            all(isinstance(number, int) for number in whole)
            and isinstance(offer.idle_minutes, int | float)
            and all(
                0 <= number <= MAX_OFFER_NUMBER
                for number in (offer.memory, offer.slots_most, offer.memory_limit, offer.idle_minutes)
            )
            and abs(offer.nice) <= MAX_NICE + 1  # negative if started so by root
            and all(isinstance(text, str) and len(text) <= LONGEST_TEXT for text in texts)
            and len(lists) <= MOST_TEXTS
        ):
            raise ValueError("invalid offer: its fields are of other types")
        return offer


@lru_cache(4096)
def needs_queue(kind: str, needs: str) -> str:
    """Returns the Celery queue for batches with requirements, such as a tag, that only some workers of this kind meet.

    needs: canonical text of the requirements.
    """
    return f"{render_queue(kind)}{NEEDS}{hashlib.sha256(needs.encode()).hexdigest()[:16]}"


def terms_key(name: str) -> str:
    """Returns the Redis key of a worker's terms, which the service writes."""
    return f"rayfarm:terms:{name}"


def offer_key(name: str) -> str:
    """Returns the Redis key of a worker's offer: its capabilities and the settings in effect. The worker writes it."""
    return f"rayfarm:offer:{name}"
