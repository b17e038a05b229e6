"""What callers are told about a worker's slots if they may not see what these work on: that they are busy, and nothing else."""

from __future__ import annotations

from typing import Any

from service.access.projects import Kind, Projects, Sight

__all__ = ["HIDDEN", "seen_slots"]

HIDDEN = {"hidden": True}
NAMES: dict[str, Kind] = {"job": "job", "scene": "scene", "denoise": "job", "vectors": "job", "environment": "environment"}


def seen_slots(slots: list[dict[str, Any]], sight: Sight, projects: Projects) -> list[dict[str, Any]]:
    """What each slot has in hand, as far as it is seen. May ask the database."""
    if sight.everything:
        return slots

    def is_seen(slot: dict[str, Any]) -> bool:
        named = ((kind, slot[name]) for name, kind in NAMES.items() if name in slot)
        return all(isinstance(id, str) and sight.sees(projects.of(kind, id)) for kind, id in named)

    return [slot if is_seen(slot) else HIDDEN for slot in slots]
