"""Pictures uploaded for comparison: read once, in a child process with limits, and kept as films."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict
from pathlib import Path

from sqlalchemy.exc import IntegrityError

from service.access.projects import hold_project
from service.errors import Failed, Invalid
from service.intake import read_reference
from service.intake.projects import NOBODY, Owner, id_in
from service.store.blobs import BlobStore
from service.store.database import Sessions
from service.store.garbage import Garbage
from service.store.models import Reference
from service.store.room import full_disk
from service.store.staging import BlobWriter

__all__ = ["SUFFIXES", "keep_reference"]

SUFFIXES = (".exr", ".hdr", ".pfm", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp")
SECONDS = 120.0
PIECE = 1 << 20


def keep_reference(
    name: str, file: BlobWriter, sessions: Sessions, blobs: BlobStore, garbage: Garbage, temporary: Path, owner: Owner = NOBODY
) -> Reference:
    """The row of an image, made where its content is new. Raises Invalid where it is none, and what the stores raise."""
    id = id_in(owner.project, file.sha256[:20])
    if (known := _known(id, sessions)) is not None:
        return known
    with tempfile.TemporaryDirectory(prefix="reference-", dir=temporary) as folder:
        packed = Path(folder) / "picture.film"
        file.rewind()
        found = _read(file.path, name, packed)
        film = blobs.writer()
        try:
            with full_disk(), packed.open("rb") as source:
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
                with full_disk():
                    file.commit()
                    film.commit()
                return _recorded(row, sessions)
        finally:
            film.discard()


def _recorded(row: Reference, sessions: Sessions) -> Reference:
    try:
        with sessions.begin() as session:
            hold_project(row.project, session)
            session.add(row)
        return row
    except IntegrityError:  # another sent the same in the same moment
        known = _known(row.id, sessions)
        if known is None:
            raise
        return known


def _known(id: str, sessions: Sessions) -> Reference | None:
    with sessions() as session:
        return session.get(Reference, id)


def _read(image: Path, name: str, film: Path) -> dict[str, object]:
    command = [sys.executable, "-m", read_reference.__name__, str(image), name, str(film)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    environment.pop("RAYFARM_TOKEN", None)
    environment["TMPDIR"] = str(film.parent)  # removed also where the child is ended and cannot
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=SECONDS, env=environment)
    except subprocess.TimeoutExpired:
        raise Invalid(f"{name}: took longer than {SECONDS:.0f} seconds to read. Make it smaller.") from None
    except OSError as error:
        raise Failed(f"{name} could not be read: this machine cannot start another process ({error}).") from error
    try:
        answer: dict[str, object] = json.loads(done.stdout.splitlines()[-1])
    except (ValueError, IndexError):
        raise Invalid(f"{name}: made its reader crash. It is damaged, or too large; export it again.") from None
    if "error" in answer:
        raise Invalid(f"{str(answer['error']).rstrip('.')}.")
    return answer
