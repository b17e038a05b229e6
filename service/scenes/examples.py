"""Finds the scenes that were opened from the examples."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from sqlalchemy import select

from protocol.contract import BlobRef
from service.access.visit import Visit
from service.farm import Farm
from service.intake.examples import files_of
from service.intake.projects import id_in_project
from service.intake.uploads import scene_id
from service.store.models import Scene

__all__ = ["scenes_of_examples"]


def scenes_of_examples(paths: list[Path], visit: Visit, farm: Farm) -> list[list[str]]:
    """Returns for each example the ids of the existing scenes with exactly its files.

    paths: scene files of the examples. Only scenes that the caller may see are returned, and none with another light or variant.
    """
    projects = ["", *farm.access.projects.visible_names(visit.sight)]
    possible = [[id_in_project(project, id) for project in projects for id in _ids_of(path)] for path in paths]
    with farm.sessions() as session:
        existing = set(session.scalars(select(Scene.id).where(Scene.id.in_([id for ids in possible for id in ids]))))
    return [[id for id in ids if id in existing] for ids in possible]


@cache
def _ids_of(path: Path) -> tuple[str, str]:
    """Returns the ids of an example's scene outside of projects: as it is opened, and as it is uploaded. Reads its files once."""
    files = [(name, file.read_bytes()) for name, file in files_of(path)]
    refs = [BlobRef(name, hashlib.sha256(data).hexdigest(), len(data)) for name, data in sorted(files)]
    return scene_id(refs, path.name, None), scene_id(refs, path.name, None, floor="auto")
