"""A data set's copy in an S3 bucket: views as they end, and from there again if another machine continues. Needs obstore."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import re
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from rayfarm.datasets.folder import DESCRIPTION, JOBS, MANIFEST, Folder
from rayfarm.output_files import write
from renderer.errors import SettingsError
from renderer.library_messages import library_message

__all__ = ["Bucket", "check_sink"]

MANIFEST_EVERY_S = 10.0  # an object cannot be appended to, so the manifest is written anew
_AT_ONCE = 8  # transfers
_NAME = re.compile(r"[a-z_]+/\d+\.[a-z]+")  # of a view's file


def check_sink(url: str) -> str:
    """Returns the address s3://bucket/prefix of a data set. Raises SettingsError if it is none, or if obstore is missing."""
    address = urlsplit(str(url))
    if address.scheme != "s3" or not address.netloc or not address.path.strip("/") or address.query or address.fragment:
        raise SettingsError(f"sink is {str(url)[:100]!r}; it is an address such as s3://bucket/prefix")
    if importlib.util.find_spec("obstore") is None:
        raise SettingsError('sink: an S3 bucket needs the package obstore: pip install "rayfarm[s3]"')
    return str(url).rstrip("/")


class Bucket:
    """A data set's objects below a prefix, with the names of the folder's files. Equal data sets have equal files.

    Address and credentials of the server come from AWS_*, as for the farm's own blobs. Methods raise SettingsError with one
    sentence if the server fails; the folder is complete without it.
    """

    def __init__(self, url: str) -> None:
        """Opens the bucket. url: as `check_sink` returns it."""
        from service.store.s3 import open_bucket

        self.url = url
        self._store = open_bucket(url)
        self._sizes: dict[str, int] = {}  # of the objects that are there
        self._written = -MANIFEST_EVERY_S

    def open(self, folder: Folder) -> None:
        """Brings the views that only the bucket has into the folder. Raises SettingsError if it holds another data set."""
        import obstore

        with self._faults():
            self._sizes = {item["path"]: item["size"] for page in obstore.list(self._store) for item in page}
        if DESCRIPTION not in self._sizes:
            return
        data = self._get(DESCRIPTION)
        description = _json(data)
        if description is None or description.get("identity") != folder.identity:
            raise SettingsError(f"{self.url} holds another data set; name a new prefix, or delete this one")
        if not (folder.path / DESCRIPTION).exists():
            write(folder.path / DESCRIPTION, data)
        lines = self._get(MANIFEST).decode().splitlines() if MANIFEST in self._sizes else []
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            for line in map(_json, lines):
                if (
                    line is None
                    or line["view"] in folder.views
                    or not all(_is_name(each["path"]) for each in line["files"].values())
                ):
                    continue
                if all(pool.map(lambda each: self._fetch(folder, each), line["files"].values())):
                    folder.add_view(line)

    def begin(self, folder: Folder) -> None:
        """Uploads what describes the data set, and the views that only the folder has."""
        self._put(folder, [DESCRIPTION])
        self._put(
            folder,
            (each["path"] for view in folder.views.values() for each in view["files"].values() if self._lacks(folder, each)),
        )
        self._put(folder, [MANIFEST] if folder.views else [])

    def add_view(self, folder: Folder, number: int) -> None:
        """Uploads a view that the folder has completed; the manifest every 10 s."""
        self._put(folder, [each["path"] for each in folder.views[number]["files"].values()])
        if time.monotonic() - self._written >= MANIFEST_EVERY_S:
            self._put(folder, [MANIFEST])
            self._written = time.monotonic()

    def end(self, folder: Folder) -> None:
        """Uploads the manifest, and the other forms of the data set that sinks have written."""
        of_views = {each["path"] for view in folder.views.values() for each in view["files"].values()}
        names = (path.relative_to(folder.path).as_posix() for path in sorted(folder.path.rglob("*")) if path.is_file())
        self._put(folder, [name for name in names if name not in of_views and name not in (JOBS, MANIFEST)])
        self._put(folder, [MANIFEST])

    def _lacks(self, folder: Folder, file: dict[str, str]) -> bool:
        return self._sizes.get(file["path"]) != (folder.path / file["path"]).stat().st_size

    def _fetch(self, folder: Folder, file: dict[str, str]) -> bool:
        """Downloads a file; returns False if it is not there, or is not the one that the manifest has."""
        data = self._get(file["path"]) if file["path"] in self._sizes else b""
        if hashlib.sha256(data).hexdigest() != file["sha256"]:
            return False
        path = folder.path / file["path"]
        path.parent.mkdir(exist_ok=True)
        write(path, data)
        return True

    def _get(self, name: str) -> bytes:
        import obstore

        with self._faults():
            return bytes(obstore.get(self._store, name).bytes())

    def _put(self, folder: Folder, names: Iterable[str]) -> None:
        import obstore

        with self._faults(), ThreadPoolExecutor(_AT_ONCE) as pool:
            for _ in pool.map(lambda name: obstore.put(self._store, name, folder.path / name), names):
                pass

    @contextmanager
    def _faults(self) -> Iterator[None]:
        from obstore.exceptions import BaseError

        try:
            yield
        except (FileNotFoundError, BaseError) as error:
            if isinstance(error, FileNotFoundError) or "NoSuchBucket" in str(error):
                bucket = urlsplit(self.url).netloc
                raise SettingsError(f"sink: there is no bucket {bucket}; create it, or name another") from None
            raise SettingsError(
                f"sink: {self.url} failed ({library_message(error)}); check AWS_*, then repeat the call, which continues"
            ) from error


def _is_name(path: str) -> bool:
    return _NAME.fullmatch(path) is not None


def _json(data: bytes | str) -> dict[str, Any] | None:
    try:
        found: dict[str, Any] = json.loads(data)
    except ValueError:
        return None
    return found
