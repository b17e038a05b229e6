"""Faults of disks: full for a while; films and the database locked, damaged, emptied, lost, or read-only."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import psutil

from tests.benchmarks.faults.attack import Attack, kind
from tests.benchmarks.faults.ground import UnrecoveredError, stopped

FULL_AT = 4096  # bytes that are left free


@kind("the disk is full, then not", weight=3)
def full(attack: Attack) -> None:
    if not attack.ground.has_disk:
        raise UnrecoveredError("this user may not mount a small disk: nothing was done")
    path = attack.ground.data / "filled"
    try:
        with path.open("wb", buffering=0) as file:
            until = time.monotonic() + attack.draw.uniform(1.0, 5.0)
            while time.monotonic() < until:
                left = shutil.disk_usage(attack.ground.data).free
                with contextlib.suppress(OSError):
                    file.write(b"\x55" * min(left, 1 << 20) if left > FULL_AT else b"")
                time.sleep(0 if left > 1 << 20 else 0.01)
    finally:
        path.unlink(missing_ok=True)
    attack.over()


@contextlib.contextmanager
def held(path: Path, how: str) -> Iterator[None]:
    other = sqlite3.connect(path, timeout=20, isolation_level=None)
    try:
        other.execute(how)
        yield
    finally:
        other.close()


@kind("another program holds the film", weight=3)
def film_held(attack: Attack) -> None:
    with held(attack.ground.film(attack.job), attack.draw.choice(("BEGIN IMMEDIATE", "BEGIN EXCLUSIVE"))):
        attack.pause(1.0, 6.0)
    attack.over()


@kind("another program holds the database")
def database_held(attack: Attack) -> None:
    with held(attack.ground.data / "rayfarm.sqlite", "BEGIN IMMEDIATE"):
        attack.pause(1.0, 8.0)
    attack.over()


def damage(attack: Attack, path: Path) -> None:
    """Overwrites random bytes of a file."""
    size = path.stat().st_size
    with path.open("r+b") as file:
        for _ in range(attack.draw.randint(1, 6)):
            file.seek(attack.draw.randrange(max(size - 64, 1)))
            file.write(attack.draw.randbytes(attack.draw.choice((1, 16, 64))))


@kind("the film is damaged while it is written", weight=1, harms_films=True)
def film_damaged(attack: Attack) -> None:
    film = attack.ground.film(attack.job)
    wal = film.with_name(film.name + "-wal")
    damage(attack, wal if attack.draw.random() < 0.5 and wal.exists() and wal.stat().st_size else film)
    attack.over()


@contextlib.contextmanager
def at_rest(attack: Attack) -> Iterator[None]:
    """Kills the service, and keeps its supervisor suspended during the `with` block, so that the service is not restarted."""
    ground = attack.ground
    with stopped([psutil.Process(ground.farm.process.pid)]):
        processes = [*ground.spares(), ground.part("service")]
        for process in processes:
            process.kill()
        deadline = time.monotonic() + 10
        while any(is_alive(process) for process in processes):
            if time.monotonic() > deadline:
                raise UnrecoveredError("the service does not end")
            time.sleep(0.005)
        yield


def is_alive(process: psutil.Process) -> bool:
    with contextlib.suppress(psutil.NoSuchProcess):
        return process.status() != psutil.STATUS_ZOMBIE
    return False


@kind("the film is damaged while the service is dead", weight=1, harms_films=True)
def film_damaged_at_rest(attack: Attack) -> None:
    with at_rest(attack):
        damage(attack, attack.ground.film(attack.job))
    attack.over()


@kind("the film is emptied while the service is dead", weight=1, harms_films=True)
def film_emptied(attack: Attack) -> None:
    with at_rest(attack):
        film = attack.ground.film(attack.job)
        for path in (film.with_name(film.name + "-wal"), film.with_name(film.name + "-shm")):
            path.unlink(missing_ok=True)
        os.truncate(film, 0)
    attack.over()


@kind("the film is gone while the service is dead", weight=1, harms_films=True)
def film_gone(attack: Attack) -> None:
    with at_rest(attack):
        film = attack.ground.film(attack.job)
        for suffix in ("", "-wal", "-shm"):
            film.with_name(film.name + suffix).unlink(missing_ok=True)
    attack.over()


@kind("the films cannot be written for a while", weight=1, harms_films=True)
def films_read_only(attack: Attack) -> None:
    """Mounts the folder of films read-only, and kills the service, since it had the film open."""
    if not attack.ground.has_disk:
        raise UnrecoveredError("this user may not mount: nothing was done")
    folder = str(attack.ground.data / "films")
    with at_rest(attack):
        subprocess.run(["mount", "--bind", folder, folder], check=True)
        subprocess.run(["mount", "-o", "remount,ro,bind", folder], check=True)
    try:
        attack.pause(2.0, 6.0)
    finally:
        subprocess.run(["mount", "-o", "remount,rw,bind", folder], check=True)
        subprocess.run(["umount", "-l", folder], check=True)
    attack.over()
