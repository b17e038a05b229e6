"""Hides what a worker's slots render from callers who may not see those jobs: such a slot is shown only as busy."""

from __future__ import annotations

from typing import Any

from service.access.projects import Kind, Projects, ProjectVisibility

__all__ = ["REDACTED_SLOT", "redacted_slots"]

REDACTED_SLOT = {"hidden": True}
RESOURCE_FIELDS: dict[str, Kind] = {
    "job": "job",
    "scene": "scene",
    "denoise": "job",
    "vectors": "job",
    "path_guide": "job",
    "environment": "environment",
}


def redacted_slots(slots: list[dict[str, Any]], sight: ProjectVisibility, projects: Projects) -> list[dict[str, Any]]:
    """Returns the current work of each slot, with hidden jobs removed. sight: the caller's visibility. May query the database."""
    if sight.everything:
        return slots

    def is_seen(slot: dict[str, Any]) -> bool:
        named = ((kind, slot[name]) for name, kind in RESOURCE_FIELDS.items() if name in slot)
        return all(isinstance(id, str) and sight.is_visible(projects.project_of(kind, id)) for kind, id in named)

    return [slot if is_seen(slot) else REDACTED_SLOT for slot in slots]
