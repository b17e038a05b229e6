"""Audit log: one line of JSON for each action, appended to audit.jsonl in the data folder.

  {"at": 1767225600.0, "who": "anna", "kind": "session", "from": "192.168.1.7",
  "what": "DELETE /api/jobs/{id}", "about": "/api/jobs/7f3a", "status": 204}

It never contains a secret. A file larger than LARGE bytes is renamed to audit.1.jsonl, and so on; the oldest is deleted.
"""

from __future__ import annotations

import json
import logging
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from renderer.printable import printable
from service.store.atomic_files import PRIVATE

__all__ = ["Audit"]

log = logging.getLogger(__name__)

MAX_FILE_BYTES = 8 << 20
FILES_KEPT = 4
MAX_VALUE_LENGTH = 200  # characters of a value chosen by the caller
READ_CHUNK = 1 << 16


class Audit:
    """Writes the audit log and reads its latest lines."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = threading.Lock()

    def add(
        self, actor: str, what: str, *, kind: str = "", address: str = "", about: str = "", status: int | None = None
    ) -> None:
        """Appends a line to the audit log. If the file cannot be written, writes the line to the service's log instead."""
        fields = {"at": round(time.time(), 3), "who": printable(actor[:MAX_VALUE_LENGTH]), "kind": kind, "from": address}
        fields |= {"what": what[:MAX_VALUE_LENGTH], "about": printable(about[:MAX_VALUE_LENGTH]), "status": status}
        line = json.dumps(fields) + "\n"
        try:
            with self._lock:
                path = self._path(0)
                if path.exists() and path.stat().st_size > MAX_FILE_BYTES:
                    self._rotate()
                with os.fdopen(os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, PRIVATE), "ab") as file:
                    file.write(line.encode())
        except OSError as error:
            log.warning("cannot write audit.jsonl (%s): %s", error, line.strip())

    def latest(self, count: int) -> list[dict[str, Any]]:
        """Returns the latest `count` entries of the audit log, newest first."""
        found: list[dict[str, Any]] = []
        for number in range(FILES_KEPT):
            for line in _lines_from_end(self._path(number)):
                try:
                    fields = json.loads(line)
                except ValueError:
                    continue  # truncated by a full disk or a power cut
                if isinstance(fields, dict):
                    found.append(fields)
                if len(found) >= count:
                    return found
        return found

    def _path(self, number: int) -> Path:
        return self._folder / (f"audit.{number}.jsonl" if number else "audit.jsonl")

    def _rotate(self) -> None:
        for number in reversed(range(FILES_KEPT - 1)):
            if self._path(number).exists():
                self._path(number).replace(self._path(number + 1))


def _lines_from_end(path: Path) -> Iterator[bytes]:
    """Yields the non-empty lines of a file, last line first; yields nothing if the file does not exist."""
    try:
        file = path.open("rb")
    except FileNotFoundError:
        return
    with file:
        end, rest = file.seek(0, os.SEEK_END), b""
        while end > 0:
            begin = max(0, end - READ_CHUNK)
            file.seek(begin)
            lines = (file.read(end - begin) + rest).split(b"\n")
            end, rest = begin, lines[0]
            yield from (line for line in reversed(lines[1:]) if line)
        if rest:
            yield rest
