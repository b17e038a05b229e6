"""Files in a farm's data folder: its lock, its secrets, and the address of the running farm.

farm.lock     held by the running farm (flock: released by the kernel however the farm ends)
secrets.json  the workers' token, Redis's password and port; not changed, so that workers' commands stay valid
farm.json     the running farm's address, for `rayfarm submit` and a second `rayfarm up`; removed at the end
logs/         one file per part
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import secrets
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from rayfarm.errors import CommandError
from service.store.atomic_files import write_atomically

__all__ = ["ROOT", "FarmAddress", "Secrets", "locked_folder", "running_farm", "secrets_of"]

ROOT = Path(__file__).resolve().parents[2]


@dataclass
class Secrets:
    """Secrets shared by the farm and its workers: the token, and Redis's password and port."""

    token: str
    redis_password: str
    redis_port: int = 0


@dataclass(frozen=True)
class FarmAddress:
    """Address of a running farm.

    pids: process ids of its parts by name. public_url: for other machines. certificate: path of its HTTPS certificate, or None.
    """

    url: str
    token: str
    redis_url: str
    pid: int
    pids: dict[str, int]
    public_url: str = ""
    certificate: str = ""


def secrets_of(data: Path) -> Secrets:
    """Returns the folder's secrets. Creates them if needed, readable only by their owner."""
    path = data / "secrets.json"
    try:
        return Secrets(**json.loads(path.read_text()))
    except (OSError, ValueError, TypeError):
        made = Secrets(token=secrets.token_urlsafe(18), redis_password=secrets.token_hex(24))
        save_secrets(data, made)
        return made


def save_secrets(data: Path, secrets: Secrets) -> None:
    """Writes the secrets atomically."""
    write_atomically(data / "secrets.json", json.dumps(asdict(secrets), indent=1).encode())


def write_address(data: Path, farm: FarmAddress) -> None:
    """Writes the address of the running farm to farm.json."""
    write_atomically(data / "farm.json", json.dumps(asdict(farm), indent=1).encode())


def running_farm(data: Path) -> FarmAddress | None:
    """Returns the address of the farm that runs on a data folder; None if none runs."""
    try:
        farm = FarmAddress(**json.loads((data / "farm.json").read_text()))
        os.kill(farm.pid, 0)
    except (OSError, ValueError, TypeError, OverflowError):
        return None
    return farm


@contextlib.contextmanager
def locked_folder(data: Path) -> Iterator[None]:
    """Context manager that holds the data folder's lock.

    Raises CommandError if another farm holds it, or the folder cannot be created.
    """
    try:
        data.mkdir(parents=True, exist_ok=True)
        lock = (data / "farm.lock").open("a")
    except OSError as error:
        raise CommandError(f"The data folder {data} cannot be used ({error.strerror}). Choose another with --data.") from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            other = running_farm(data)
            where = f" at {other.url} (process {other.pid})" if other else ""
            use = f"Open {other.url}" if other else "Use that one"
            raise CommandError(
                f"A farm already runs on {data}{where}. {use}, stop it (Ctrl-C in its terminal), "
                "or start a second one with --data FOLDER --port N."
            ) from None
        try:
            yield
        finally:
            with contextlib.suppress(OSError):
                (data / "farm.json").unlink(missing_ok=True)
