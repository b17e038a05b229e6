"""Uploaded reference pictures for comparisons, converted once in a confined process and stored as film packets."""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import asdict
from functools import partial
from pathlib import Path

from sqlalchemy.exc import IntegrityError

from renderer.confine.running import Bounds, TooLargeError, run
from renderer.errors import MachineError, SceneError
from renderer.sentences import Sentence, with_full_stop
from service.access.projects import lock_project
from service.errors import Failed, Invalid
from service.intake.projects import NO_OWNER, UploadOwner, id_in_project
from service.intake.read_reference import as_film
from service.store.blobs import BlobStore
from service.store.database import Sessions
from service.store.disk_space import translated_disk_errors
from service.store.garbage import Garbage
from service.store.models import Reference
from service.store.staging import BlobWriter

__all__ = ["SUFFIXES", "keep_reference"]

SUFFIXES = (".exr", ".hdr", ".pfm", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp")
SECONDS = 120.0
MEMORY = 4 << 30  # bytes, in addition to the memory that the process has at its start
PIECE = 1 << 20


def keep_reference(
    name: str,
    file: BlobWriter,
    sessions: Sessions,
    blobs: BlobStore,
    garbage: Garbage,
    temporary: Path,
    owner: UploadOwner = NO_OWNER,
) -> Reference:
    """Stores an uploaded reference picture and returns its row; an existing row if the same content is stored already.

    Raises Invalid if the file is not a readable image, Failed if the process that reads it failed, and the errors of the stores.
    """
    id = id_in_project(owner.project, file.sha256[:20])
    if (known := _find_reference(id, sessions)) is not None:
        return known
    with tempfile.TemporaryDirectory(prefix="reference-", dir=temporary) as folder:
        packed = Path(folder) / "picture.film"
        file.rewind()
        found = _read(file.path, name, packed)
        film = blobs.writer()
        try:
            with translated_disk_errors(), packed.open("rb") as source:
                while piece := source.read(PIECE):
                    film.write(piece)
            row = Reference(
                id=id,
                name=name,
                created=time.time(),
                file={"path": name, "sha256": file.sha256, "size": file.size, "parts": []},
                film={"path": "", "sha256": film.sha256, "size": film.size, "parts": []},
                **asdict(owner),
                **found,
            )
            with garbage.pinned([file.sha256, film.sha256]):
                with translated_disk_errors():
                    file.commit()
                    film.commit()
                return _record_reference(row, sessions)
        finally:
            film.discard()


def _record_reference(row: Reference, sessions: Sessions) -> Reference:
    try:
        with sessions.begin() as session:
            lock_project(row.project, session)
            session.add(row)
        return row
    except IntegrityError:  # another request stored the same content at the same time
        known = _find_reference(row.id, sessions)
        if known is None:
            raise
        return known


def _find_reference(id: str, sessions: Sessions) -> Reference | None:
    with sessions() as session:
        return session.get(Reference, id)


def _read(image: Path, name: str, film: Path) -> dict[str, object]:
    job = partial(as_film, os.fsencode(image.resolve()), name, os.fsencode(film.resolve()))
    bounds = Bounds(
        MEMORY,
        SECONDS,
        name,
        Sentence("memory-granted-to-image", "that reading an image may take"),
        Sentence("advice-shrink", "Make it smaller."),
        Sentence("advice-shrink", "Make it smaller."),
    )
    try:
        found = run(job, [image.resolve()], [film.parent.resolve()], bounds, preload=[as_film.__module__, "renderer.image.read"])
        sides = int(found["width"]), int(found["height"]), int(found["clipped"])
        if not film.is_file() or film.is_symlink():
            raise SceneError(
                Sentence("image-importer-failed", "{name} cannot be read: its importer ended without a result", name=name)
            )
    except (SceneError, TooLargeError) as error:
        raise Invalid(with_full_stop(str(error).rstrip("."))) from None
    except MachineError as error:
        raise Failed(
            Sentence("reference-unreadable", "{name} could not be read: {error}.", name=name, error=str(error).rstrip("."))
        ) from error
    except (KeyError, TypeError, ValueError) as error:
        raise Invalid(
            Sentence("image-importer-failed", "{name} cannot be read: its importer ended without a result.", name=name)
        ) from error
    return {"width": sides[0], "height": sides[1], "is_display": bool(found.get("is_display")), "clipped": sides[2]}
