"""Applies the run-time settings of a worker (protocol/terms.py) in the parent's event loop, at each heartbeat."""

from __future__ import annotations

import contextlib
import logging
import mmap
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from protocol import vitals
from protocol.hours import Hours, local_now
from protocol.terms import Offer, Terms
from renderer.sentences import Sentence
from worker.machine.presence import Presence
from worker.machine.process_tree import process_times

__all__ = ["TermsKeeper", "memory_limit"]

MEMORY_EVERY = 5  # heartbeats; summing up the memory of all processes takes milliseconds
RESUME_BELOW = 0.9  # of the limit: from then on it takes tasks again

log = logging.getLogger(__name__)

_limit = mmap.mmap(-1, 8)  # shared with the slots, which are forked later


def memory_limit() -> int:
    """Returns the memory limit of this worker in bytes; 0 means unlimited. Works in the parent and in every slot."""
    return int(struct.unpack("q", _limit[:8])[0])


@dataclass
class TermsKeeper:
    """Applies the run-time settings ("terms") of one worker, and tells whether they permit the worker to take tasks at present.

    own: the settings with which the worker was started. asked: the settings that the service requires. why: a sentence on why
    it takes no tasks; None if it takes them. trouble: a sentence on which setting cannot be applied; None if all are.
    """

    slots: int  # processes that it has
    tags: tuple[str, ...] = ()
    own: Terms = field(default_factory=Terms)
    presence: Presence = field(default_factory=Presence)
    clock: Callable[[], datetime] = local_now
    asked: Terms = field(default_factory=Terms)
    why: str | None = None  # it rests
    trouble: str | None = None
    _first_nice: int = field(default_factory=lambda: os.getpriority(os.PRIO_PROCESS, 0))
    _beats: int = 0
    _is_over: bool = False
    _total: int = 0

    @property
    def terms(self) -> Terms:
        """The settings in effect: the required ones, and start values where none is required."""
        return self.asked.with_defaults(self.own)

    @property
    def slots_now(self) -> int:
        """Number of slots that the worker may use now."""
        return min(self.terms.slots or self.slots, self.slots)

    def may_precompile(self) -> bool:
        """Returns True if the worker may compile kernels in advance: if it was started without limits on machine use."""
        own = self.own
        return not (own.hours or own.idle_minutes or own.memory or own.nice)

    def request(self, data: bytes | None) -> None:
        """Stores the settings that the service requires. Ignores invalid ones.

        data: as `Terms.to_bytes` returns them; None: the service requires none.
        """
        try:
            asked = Terms.from_bytes(data) if data is not None else Terms()
        except ValueError as error:
            if self.trouble != str(error):
                log.warning("invalid settings for this worker are ignored: %s", error)
            self.trouble = str(error)
            return
        if asked != self.asked:
            log.warning("from now on: %s", asked.to_bytes().decode())
            self.trouble = None
        self.asked = asked

    def refresh(self) -> None:
        """Updates `why` from the time of day, user activity and memory use; applies the nice level and the memory limit."""
        terms = self.terms
        struct.pack_into("q", _limit, 0, terms.memory or 0)
        self._set_nice_level(terms.nice)
        in_use = self._machine_in_use_reason(
            terms
        )  # tracked outside the hours too, so that the idle time is known when they begin
        self.why = self._outside_hours_reason(terms) or in_use or self._memory_reason(terms)
        self._beats += 1

    def offer(self) -> Offer:
        """Returns the worker's capabilities and the settings in effect, for the service."""
        terms = self.terms
        self._total = self._total or (found.memory_total if (found := vitals.read_vitals()) else 0)
        return Offer(
            tags=self.tags,
            memory=min(terms.memory or self._total, self._total or (1 << 60)),
            slots_most=self.slots,
            keeps=self.asked.digest,
            hours=terms.hours or "",
            idle_minutes=terms.idle_minutes or 0.0,
            idle_by=self.presence.by,
            nice=os.getpriority(os.PRIO_PROCESS, 0),
            memory_limit=terms.memory or 0,
            queues=() if self.why else terms.queues,
            why=self.why,
            trouble=self.trouble,
        )

    def _outside_hours_reason(self, terms: Terms) -> str | None:
        if not terms.hours or Hours.parse(terms.hours).includes(self.clock()):
            return None
        return Sentence("worker-outside-hours", "Outside its hours: {hours}.", hours=terms.hours)

    def _machine_in_use_reason(self, terms: Terms) -> str | None:
        if not terms.idle_minutes:
            return None
        left = 60 * terms.idle_minutes - self.presence.idle_s()
        return (
            Sentence(
                "worker-machine-in-use",
                "Somebody is using this machine; it begins after {minutes} minutes without use.",
                minutes=f"{terms.idle_minutes:g}",
            )
            if left > 0
            else None
        )

    def _memory_reason(self, terms: Terms) -> str | None:
        """Returns a sentence if the worker takes no tasks because of its memory use; None otherwise.

        It takes none from the time when its processes exceed the memory limit until they use 10 % less than the limit.
        """
        if not terms.memory:
            self._is_over = False
        elif self._beats % MEMORY_EVERY == 0 or self._is_over:
            self._is_over = _memory_of_processes() > terms.memory * (RESUME_BELOW if self._is_over else 1.0)
        if not self._is_over or not terms.memory:
            return None
        return Sentence(
            "worker-over-memory-limit",
            "It uses more memory than its limit of {limit} GB.",
            limit=f"{terms.memory / 1000000000.0:.3g}",
        )

    def _set_nice_level(self, nice: int | None) -> None:
        """Sets the nice level of all processes of the worker; later forks inherit it. None: the level at the start."""
        wanted = self._first_nice if nice is None else nice
        if os.getpriority(os.PRIO_PROCESS, 0) == wanted:
            return
        for pid in process_times():
            try:
                if os.getpriority(os.PRIO_PROCESS, pid) != wanted:
                    os.setpriority(os.PRIO_PROCESS, pid, wanted)
            except PermissionError:
                self.trouble = Sentence(
                    "worker-nice-not-lowerable",
                    "The nice level stays at {current}: only root may lower it. Restart the worker.",
                    current=os.getpriority(os.PRIO_PROCESS, 0),
                )
                return
            except ProcessLookupError:
                continue
        if self.trouble and getattr(self.trouble, "code", "") == "worker-nice-not-lowerable":
            self.trouble = None


def _memory_of_processes() -> int:
    """Returns the memory of all processes of this worker in bytes. Shared pages are counted once."""
    total = 0
    for pid in process_times():
        with contextlib.suppress(OSError, ValueError, IndexError):
            lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
            total += next(int(line.split()[1]) * 1024 for line in lines if line.startswith("Pss:"))
    return total
