"""Requirements that a job has on its workers: tags and a minimum of memory.

Batches of such a job have a separate queue. The service instructs each worker that meets all requirements to serve that queue
(protocol/terms.py), and sends batches only after a worker has confirmed it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from protocol.terms import TAG, Offer, needs_queue
from renderer.sentences import Sentence

__all__ = ["Needs"]

MAX_TAGS = 20
MEMORY_PATTERN = re.compile(r"memory_gb=(\d{1,6}(?:\.\d{1,3})?)")


@dataclass(frozen=True)
class Needs:
    """Requirements of a job on its workers. tags: all are required; sorted. memory_gb: minimum memory in GB; 0 for no minimum."""

    tags: tuple[str, ...]
    memory_gb: float = 0.0

    @classmethod
    def parse(cls, texts: Sequence[str]) -> Needs | None:
        """Parses requirements: tags, and entries such as "memory_gb=32". Returns None for an empty list.

        Raises ValueError with a sentence if a text is invalid, or if there are too many tags.
        """
        tags, memory = set(), 0.0
        for text in texts:
            if found := MEMORY_PATTERN.fullmatch(text):
                memory = max(memory, float(found[1]))
            elif TAG.fullmatch(text):
                tags.add(text)
            else:
                raise ValueError(
                    Sentence(
                        "need-malformed",
                        "{text} is not a requirement; give a tag in small letters, or memory_gb=32",
                        text=repr(text[:60]),
                    )
                )
        if len(tags) > MAX_TAGS:
            raise ValueError(Sentence("needs-too-many", "a job may require at most {most} tags; give fewer", most=MAX_TAGS))
        return cls(tuple(sorted(tags)), memory) if tags or memory else None

    @classmethod
    def from_json(cls, row: Mapping[str, Any] | None) -> Needs | None:
        """Parses the JSON object that `to_json` returns; None for an empty value."""
        return cls(tuple(map(str, row.get("tags", ()))), float(row.get("memory_gb", 0.0))) if row else None

    def to_json(self) -> dict[str, Any]:
        """Returns the JSON object that is stored in the job's row."""
        return {"tags": list(self.tags), "memory_gb": self.memory_gb}

    @property
    def texts(self) -> list[str]:
        """Returns the requirements in the format that `parse` reads."""
        return [*self.tags, *([f"memory_gb={self.memory_gb:g}"] if self.memory_gb else [])]

    @cached_property
    def text(self) -> str:
        """Canonical text of the requirements: equal for equal requirements."""
        return ",".join(self.texts)

    def queue(self, kind: str) -> str:
        """Returns the name of the queue for batches that have these requirements and are rendered by workers of this kind."""
        return needs_queue(kind, self.text)

    def are_met(self, offer: Offer) -> bool:
        """Returns True if a worker meets all requirements. offer: the worker's report of its tags, memory and queues."""
        return set(self.tags) <= set(offer.tags) and offer.memory >= self.memory_gb * 1e9

    def unmet_reason(self, offers: Iterable[Offer | None]) -> str | None:
        """Returns a sentence that explains why no worker meets the requirements; None if one does.

        offers: one per worker; None for a worker that sent none.
        """
        known = [offer for offer in offers if offer is not None]
        if any(self.are_met(offer) for offer in known):
            return None
        missing = [tag for tag in self.tags if not any(tag in offer.tags for offer in known)]
        most = max((offer.memory for offer in known), default=0)
        if missing:
            if len(missing) == 1:
                return Sentence("job-waits-for-tag", "Waits for a worker with the tag {tag}: none is connected.", tag=missing[0])
            return Sentence("job-waits-for-tags", "Waits for a worker with the tags {tags}: none is connected.", tags=missing)
        if most < self.memory_gb * 1e9:
            return Sentence(
                "job-waits-for-memory",
                "Waits for a worker with {needed} GB of memory: the largest has {most} GB.",
                needed=f"{self.memory_gb:g}",
                most=f"{most / 1000000000.0:.1f}",
            )
        return Sentence(
            "job-waits-for-properties",
            "Waits for a worker with all of {properties}: none is connected.",
            properties=[*self.texts],
        )
