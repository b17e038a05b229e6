"""Current work of each slot, in a few hundred bytes of shared memory that slots write and the parent reads.

Each slot has one record and is its only writer, so no lock is needed: a record that is read half-written cannot be parsed, and is
treated as empty for one heartbeat.
"""

from __future__ import annotations

import json
import mmap
from typing import Any

__all__ = ["SlotBoard"]

RECORD = 512


class SlotBoard:
    """Shared memory with the record of each slot, created by the parent before it forks."""

    def __init__(self, slots: int) -> None:
        self.slots = slots
        self._memory = mmap.mmap(-1, RECORD * slots)

    def write(self, slot: int, current: dict[str, Any], samples_per_s: float = 0.0) -> None:
        """Writes a slot's current work; {} means that the slot is free. samples_per_s: 0 keeps the slot's last value."""
        if not 0 <= slot < self.slots:
            return
        speed = samples_per_s or self._read(slot).get("speed", 0.0)
        data = json.dumps({"current": current, "speed": speed}).encode()
        if len(data) > RECORD:
            data = json.dumps({"current": {}, "speed": speed}).encode()
        self._memory[slot * RECORD : (slot + 1) * RECORD] = data.ljust(RECORD)

    def read(self) -> tuple[list[dict[str, Any]], float]:
        """Returns the current work of every slot, and the mean samples per second of the slots that have rendered."""
        records = [self._read(slot) for slot in range(self.slots)]
        speeds = [record["speed"] for record in records if record.get("speed")]
        return [record.get("current", {}) for record in records], sum(speeds) / len(speeds) if speeds else 0.0

    def speed(self, slot: int) -> float:
        """Returns the samples per second of a slot's latest rendering; 0 if it has not rendered."""
        return float(self._read(slot).get("speed", 0.0))

    def _read(self, slot: int) -> dict[str, Any]:
        try:
            return json.loads(self._memory[slot * RECORD : (slot + 1) * RECORD])
        except ValueError:
            return {}
