"""Names of jobs whose request states none."""

from __future__ import annotations

import re

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.store.models import Job, Scene

__all__ = ["default_name"]

MOST_CHARACTERS = 240  # of a scene's name, so that a number fits the column


def default_name(scene: Scene, session: Session) -> str:
    """Returns the scene's name, followed by the next number if jobs of the scene have that name: "Duck", "Duck 2", "Duck 3"."""
    name = scene.name[:MOST_CHARACTERS]
    similar = session.scalars(select(Job.name).where(Job.scene == scene.id, Job.name.startswith(name, autoescape=True)))
    numbered = re.compile(rf"{re.escape(name)}(?: ([1-9]\d{{0,8}}))?", re.ASCII)
    found = [int(match[1] or 1) for match in map(numbered.fullmatch, similar) if match]
    return f"{name} {max(found) + 1}" if found else scene.name
