"""The folders of this machine's cache: kernels, hashes of sources, fetched scenes, a worker's log.

Kernels are pickles and machine code: a user who can write them can run code as this user. Therefore only such files and folders
are used as are owned by this user or root and cannot be written by any other user. New folders get mode 0700.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import os
import stat
import tempfile
from pathlib import Path

import platformdirs

__all__ = ["cache_home", "make_private", "private_folder", "read_private", "reason_to_distrust", "trusted"]

_log = logging.getLogger(__name__)
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def cache_home() -> Path:
    """Returns the cache folder: $RAYFARM_CACHE, by default a folder in the user's own, on Linux ~/.cache/rayfarm."""
    named = os.environ.get("RAYFARM_CACHE")
    return Path(named).expanduser() if named else platformdirs.user_cache_path("rayfarm", appauthor=False)


def reason_to_distrust(status: os.stat_result) -> str:
    """Returns why a file or folder with this stat result is not trusted, as the end of a sentence; "" if it is trusted."""
    if status.st_uid not in (os.geteuid(), 0):
        return f"belongs to user {status.st_uid}, neither to this user ({os.geteuid()}) nor to root"
    if status.st_mode & _OTHERS_WRITE:
        return f"can be written by other users (mode {stat.S_IMODE(status.st_mode):04o})"
    return ""


def make_private(folder: Path) -> None:
    """Creates a folder and its missing parents with mode 0700. Raises OSError if that fails."""
    if not folder.is_dir():
        if not folder.parent.exists():
            make_private(folder.parent)
        folder.mkdir(mode=0o700, exist_ok=True)


def private_folder(name: str) -> Path:
    """Returns the folder `name`, a relative path, in the cache, or a private substitute if other users could write there.

    If that folder or one of its parents is not trusted, returns the folder of that name in a private folder of this user: in the
    cache, or else in the temporary folder. Does not create the folder in the cache. Warns once about each folder that is not
    used.
    """
    return trusted(cache_home(), name)


def trusted(home: Path, name: str = "") -> Path:
    """Returns the folder `name` as `private_folder` does, in the cache folder `home` instead of `cache_home`."""
    fault = _fault(home, name)
    if not fault:
        return home / name
    for base in (home / f"private-{os.geteuid()}", Path(tempfile.gettempdir()) / f"rayfarm-private-{os.geteuid()}"):
        with contextlib.suppress(OSError):
            base.mkdir(mode=0o700, exist_ok=True)
            if not _fault(base, name):
                _warn(f"{fault}; {base / name} is used instead")
                return base / name
    beside = _own_temporary()
    _warn(f"{fault}; its content is compiled or fetched again, into {beside}")
    return beside / name


def _fault(home: Path, name: str) -> str:
    """Returns a sentence about the first untrusted folder on the path from `home` to `name`; "" if all are trusted or missing."""
    for folder in (home, *(home.joinpath(*Path(name).parts[: k + 1]) for k in range(len(Path(name).parts)))):
        with contextlib.suppress(FileNotFoundError, NotADirectoryError, PermissionError):
            if reason := reason_to_distrust(folder.stat()):
                return f"the folder {folder} {reason}"
    return ""


@functools.cache
def _own_temporary() -> Path:
    return Path(tempfile.mkdtemp(prefix="rayfarm-"))


@functools.cache
def _warn(fault: str) -> None:
    _log.warning("%s. Make it this user's alone (chown, chmod go-w), or set RAYFARM_CACHE to another folder.", fault)


def read_private(path: Path) -> bytes | None:
    """Returns the bytes of a trusted file in a trusted folder; None, with a warning, if either is untrusted.

    Raises OSError if the file cannot be read.
    """
    if reason := reason_to_distrust(path.parent.stat()):
        _warn(f"the folder {path.parent} {reason}; its content is compiled again")
        return None
    with path.open("rb") as file:
        if reason := reason_to_distrust(os.fstat(file.fileno())):
            _warn(f"the file {path} {reason}; it is compiled again")
            return None
        return file.read()
