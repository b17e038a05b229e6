"""Checks a data folder: its permissions and free space, and the integrity of its database, uploads and films."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

from sqlalchemy import create_engine, select
from sqlalchemy.exc import SQLAlchemyError

from rayfarm.console import PROGRAM
from rayfarm.doctor.finding import Finding, fault, fine, note_finding
from renderer.errors import SettingsError
from renderer.settings import RenderSettings
from service.errors import FarmError
from service.maintenance.scrub import check_film
from service.scheduling.fleet.dead_letters import FILE
from service.scheduling.records import Records
from service.settings import Settings
from service.store.database import Sessions
from service.store.film_store import FilmFolder
from service.store.models import Frame, Job
from service.store.upgrade import SchemaState, schema_state

__all__ = ["check_folder"]

LOW_DISK_SPACE = 5 << 30
NETWORK_FILE_SYSTEMS = ("nfs", "nfs4", "cifs", "smb3", "smbfs", "fuse.sshfs", "9p")
SECRETS = (
    "token",
    "owner-token",
    "secrets.json",
    "webhook-secret",
    "login-key",
    "farm.json",
    "redis.conf",
    "rayfarm.sqlite",
)
MAX_EXAMPLES = 3  # examples listed of many faults

Progress = Callable[[int, int], None]


def check_folder(settings: Settings, deep: bool, progress: Progress) -> Iterator[Finding]:
    """Checks the folder's permissions and space, the database, and the files that it refers to. Yields the findings.

    deep: also reads every blob and film. progress: called with the number of checked items and their total.
    """
    data = settings.data
    if not data.exists():
        yield note_finding("Data folder", f"{data} is not there yet.", f"{PROGRAM} up makes it.")
        return
    if not data.is_dir() or not os.access(data, os.R_OK | os.W_OK | os.X_OK):
        yield fault(
            "Data folder",
            f"{data} cannot be written by this user ({_user(data)} owns it).",
            "Run as its owner, or name another with --data.",
        )
        return
    yield from _check_permissions(data)
    yield _check_free_space(data, settings.min_free_bytes)
    if (kind := _file_system(data)) in NETWORK_FILE_SYSTEMS:
        yield note_finding(
            "Data folder",
            f"It lies on a network drive ({kind}), on which SQLite's locks may fail and a cut connection damages databases.",
            "Keep it on a disk of this machine, and `backup` to the network.",
        )
    yield from _check_dead_letters(data)
    yield from _database(settings, deep, progress)


def _check_dead_letters(data: Path) -> Iterator[Finding]:
    """Checks whether there are messages of workers that the service could not handle (dead letters). Yields the findings."""
    try:
        letters = [json.loads(line) for line in (data / FILE).read_text(encoding="utf-8").splitlines()]
    except (OSError, ValueError):
        return
    if letters and isinstance(letters[-1], dict):
        when = time.strftime("%Y-%m-%d %H:%M", time.localtime(float(letters[-1].get("time", 0))))
        yield note_finding(
            "Messages",
            f"{len(letters)} of workers could not be handled, the latest at {when}: {str(letters[-1].get('why'))[:200]}",
            f"Look at {data / FILE}: a worker of another release or a token in the wrong hands sends such. Delete the file then.",
        )


def _check_permissions(data: Path) -> Iterator[Finding]:
    if data.stat().st_uid != os.getuid():
        yield note_finding("Data folder", f"{data} belongs to {_user(data)}, not to this user.", "Run the farm as its owner.")
    if data.stat().st_mode & 0o077:
        yield note_finding("Data folder", f"Others on this machine can look into {data}.", f"chmod 700 {data}")
    else:
        yield fine("Data folder", f"{data}, for its owner alone.")
    open_ones = [name for name in SECRETS if (data / name).is_file() and (data / name).stat().st_mode & 0o077]
    if open_ones:
        where = " ".join(str(data / name) for name in open_ones)
        yield fault(
            "Secrets", f"Others can read {', '.join(open_ones)}: anyone with the token can send results.", f"chmod 600 {where}"
        )


def _check_free_space(data: Path, required: int) -> Finding:
    free = shutil.disk_usage(data).free
    if free < required:
        return fault(
            "Room",
            f"{free / 1e6:.0f} MB are free: uploads are refused and jobs wait.",
            "Delete jobs or scenes, or enlarge the disk.",
        )
    if free < LOW_DISK_SPACE:
        return note_finding(
            "Room", f"{free / 1e9:.1f} GB are free.", f"Make room before the night: `{PROGRAM} gc --dry-run` says what may go."
        )
    return fine("Room", f"{free / 1e9:.0f} GB are free.")


def _database(settings: Settings, deep: bool, progress: Progress) -> Iterator[Finding]:
    path = settings.data / "rayfarm.sqlite"
    if not settings.database_url:
        if not path.is_file():
            yield note_finding("Database", "There is none yet.", f"{PROGRAM} up makes it.")
            return
        if (broken := _film_error(path, deep)) is not None:
            yield fault(
                "Database", f"{path} is damaged ({broken}).", f"Stop the farm and `{PROGRAM} restore` your latest backup."
            )
            return
    engine = create_engine(settings.database)
    try:
        stands = schema_state(engine)
        yield _revision(stands)
        if stands.current == stands.head:
            yield from _contents(settings, Sessions(engine), deep, progress)
    except (SQLAlchemyError, FarmError) as error:
        yield fault("Database", f"It does not answer ({getattr(error, 'orig', error)}).", "Look at RAYFARM_DATABASE_URL.")
    finally:
        engine.dispose()


def _film_error(path: Path, deep: bool) -> str | None:
    try:
        with closing(sqlite3.connect(f"{path.as_uri()}?mode=rw", uri=True, timeout=10)) as database:
            (said,) = database.execute("PRAGMA integrity_check(1)" if deep else "PRAGMA quick_check(1)").fetchone()
    except sqlite3.DatabaseError as error:
        return str(error)
    return None if said == "ok" else str(said).splitlines()[0]


def _revision(stands: SchemaState) -> Finding:
    if stands.is_newer:
        return fault(
            "Database",
            f"It is of a newer release (revision {stands.current}; this one knows up to {stands.head}).",
            "Start that release, or restore a backup of this one.",
        )
    if stands.current != stands.head:
        return note_finding(
            "Database",
            f"It is of an older release (revision {stands.current or 'of 0.1.0'}, now {stands.head}).",
            f"{PROGRAM} up brings it up to date; `backup` first.",
        )
    return fine("Database", f"Whole, and at revision {stands.head}.")


def _contents(settings: Settings, sessions: Sessions, deep: bool, progress: Progress) -> Iterator[Finding]:
    blobs = [] if settings.blobs else sorted(Records(sessions, 0).blobs())
    with sessions() as session:
        jobs = list(session.scalars(select(Job).where(Job.state == "finished")))
        recorded: dict[str, dict[int, int]] = {}
        for id, number, samples in session.execute(select(Frame.job, Frame.number, Frame.samples)):
            recorded.setdefault(id, {})[number] = samples
    total = len(blobs) + len(jobs)
    absent, damaged = [], []
    for at, sha256 in enumerate(blobs):
        path = settings.data / "blobs" / sha256[:2] / sha256
        if not path.is_file():
            absent.append(sha256[:12])
        elif deep and _hash(path) != sha256:
            damaged.append(sha256[:12])
        progress(at + 1, total)
    if absent or damaged:
        what = [
            f"{len(some)} {how} ({_names_text(some)})"
            for some, how in ((absent, "are not there"), (damaged, "are damaged"))
            if some
        ]
        yield fault(
            "Uploads",
            f"Of {len(blobs)} uploads and compiled scenes {' and '.join(what)}.",
            "Upload these scenes again, or restore a backup.",
        )
    else:
        yield fine("Uploads", f"{len(blobs)} uploads and compiled scenes are there{' and what was stored' if deep else ''}.")
    lost = []
    films = FilmFolder(settings.data / "films", 0)
    for at, job in enumerate(jobs):
        if not _is_film_there(films, job, recorded.get(job.id, {}), deep):
            lost.append(job.id)
        progress(len(blobs) + at + 1, total)
    if lost:
        yield fault(
            "Films",
            f"Of {len(jobs)} finished jobs {len(lost)} have a damaged film or none ({_names_text(lost)}).",
            "A running farm renders what is missing by itself, where their scenes are there; or restore a backup.",
        )
    else:
        yield fine("Films", f"{len(jobs)} finished jobs have their films{', whose checksums are right' if deep else ''}.")
    if not deep and total:
        yield fine("Contents", f"Only looked for, not read: `{PROGRAM} doctor --deep` reads every byte.")


def _is_film_there(films: FilmFolder, job: Job, recorded: dict[int, int], deep: bool) -> bool:
    if not any(recorded.values()) or job.settings is None or job.tile_size is None:
        return True
    if not deep:
        return films.size(job.id) > 0
    try:
        check_film(films, job.id, RenderSettings.from_json(job.settings), job.tile_size, recorded)
    except SettingsError:
        return True  # written by another release
    except FarmError:
        return False
    return True


def _hash(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _names_text(names: list[str]) -> str:
    return ", ".join(names[:MAX_EXAMPLES]) + (" ..." if len(names) > MAX_EXAMPLES else "")


def _user(path: Path) -> str:
    try:
        return path.owner()
    except (KeyError, OSError):
        return f"user {path.stat().st_uid}"


def _file_system(folder: Path) -> str:
    """Returns the type of a folder's file system; "" if the operating system does not report it."""
    try:
        lines = [line.split() for line in Path("/proc/mounts").read_text().splitlines()]
    except OSError:
        return ""
    mounts = [(each[1].replace("\\040", " "), each[2]) for each in lines if len(each) > 2]
    within = [(where, kind) for where, kind in mounts if folder.resolve().is_relative_to(where)]
    return max(within, key=lambda each: len(each[0]))[1] if within else ""
