"""Tracks which files a farm already has, so that only changes are uploaded."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

from .client import Cancelled, Client, FarmError
from .multipart import Part

__all__ = ["Uploads"]

POLL_S = 0.1
UNUSED_SHARE = 0.5  # fraction of unused bytes from which on a scene is uploaded in full


class Uploads:
    """The record of what one farm has received: scenes and environment images.

    Each scene is uploaded as changes to the previous scene; unchanged files are not sent again.
    """

    def __init__(self, client: Client, digest: Callable[[bytes | Path], str], project: str = "") -> None:
        self.client = client
        self.rendered: set[str] = set()  # scenes that have jobs
        self.sent_bytes = 0  # bytes of files sent by the last upload
        self.scene: str | None = None
        self._digest = digest
        self._into = f"?project={quote(project, safe='')}" if project else ""
        self._lock = threading.RLock()  # a rendering and a viewport may upload at the same time
        self._there: dict[str, tuple[str, int]] = {}  # hash and size by name
        self._images: dict[str, str] = {}  # ids of environments by the hash of their file

    def send(self, files: Mapping[str, bytes | Path], main: str, title: str, progress: Callable[[int, int], None]) -> str:
        """Uploads a scene and returns its ID. Raises FarmError, or Cancelled if `progress` does."""
        with self._lock:
            return self._send(files, main, title, progress)

    def _send(self, files: Mapping[str, bytes | Path], main: str, title: str, progress: Callable[[int, int], None]) -> str:
        wanted = {name: (self._digest(content), _size(content)) for name, content in files.items()}
        lacking = [name for name, told in wanted.items() if self._there.get(name) != told]
        self.sent_bytes = 0
        if self.scene is not None and not lacking:
            return self.scene
        stale = sum(size for name, (_, size) in self._there.items() if name not in wanted)
        fields = {"main": main, "name": title}
        if self.scene is not None and stale <= UNUSED_SHARE * sum(size for _, size in wanted.values()):
            try:
                return self._post(files, lacking, {"base": self.scene}, {**self._there, **wanted}, progress)
            except FarmError as error:
                if error.status != 404:  # 404: the farm no longer has the previous scene, so the new one is sent in full
                    raise
        return self._post(files, list(wanted), fields, wanted, progress)

    def _post(
        self,
        files: Mapping[str, bytes | Path],
        names: list[str],
        fields: dict[str, str],
        known_blobs: dict[str, tuple[str, int]],
        progress: Callable[[int, int], None],
    ) -> str:
        parts = [Part("files", name, files[name]) for name in names]
        scene = self.client.send_files("/api/scenes" + self._into, parts, fields, progress)
        self.scene, self._there = str(scene["id"]), known_blobs
        self.sent_bytes = sum(part.size for part in parts)
        return self.scene

    def environment(self, name: str, content: bytes | Path, progress: Callable[[int, int], None]) -> str:
        """Returns the ID of an environment image, which is uploaded if it is new.

        Raises FarmError, or Cancelled if `progress` does.
        """
        digest = self._digest(content)
        with self._lock:
            if digest not in self._images:
                part = Part("file", name, content)
                found = self.client.send_files("/api/environments" + self._into, [part], {}, progress)
                self._images[digest] = str(found["environment"]["image"])
            return self._images[digest]

    def delete_viewed(self, scene: str) -> None:
        """Deletes a scene that was uploaded only for viewing; does nothing if a job has used the scene.

        Raises FarmError if the request fails.
        """
        if scene in self.rendered:
            return
        if scene == self.scene:
            self.clear()
        self.client.json("DELETE", f"/api/scenes/{scene}")

    def clear(self) -> None:
        """Clears the record of uploads, because the farm has deleted them: the next scene is uploaded in full."""
        self.scene, self._there, self._images = None, {}, {}

    def upload_and_prepare(
        self,
        files: Mapping[str, bytes | Path],
        main: str,
        title: str,
        progress: Callable[[int, int], None],
        is_over: Callable[[], bool],
        say: Callable[[str], None],
    ) -> dict[str, Any]:
        """Uploads a scene and waits until the farm has prepared it; uploads it again if it was deleted in the meantime.

        Returns the scene as in GET /api/scenes/{id}. is_over: returns True once the user has cancelled. say: shows a status line.
        Raises FarmError if a request or the preparation fails, Cancelled if the user cancels.
        """
        try:
            return self.wait_until_prepared(self.send(files, main, title, progress), is_over, say)
        except FarmError as error:
            if error.status != 404:
                raise
        self.clear()
        return self.wait_until_prepared(self.send(files, main, title, progress), is_over, say)

    def wait_until_prepared(self, scene: str, is_over: Callable[[], bool], say: Callable[[str], None]) -> dict[str, Any]:
        """Waits until the farm has prepared the scene; returns it as in GET /api/scenes/{id}.

        is_over: returns True once the user has cancelled. say: shows a status line. Raises FarmError if the farm cannot read the
        scene, Cancelled if the user cancels.
        """
        while True:
            found: dict[str, Any] = self.client.json("GET", f"/api/scenes/{scene}")
            if found["status"] == "ready":
                return found
            if found["status"] == "failed":
                raise FarmError(f"The farm cannot read the scene: {found['error']}")
            say(found.get("step") or "Preparing the scene")
            if is_over():
                raise Cancelled
            time.sleep(POLL_S)


def _size(content: bytes | Path) -> int:
    return content.stat().st_size if isinstance(content, Path) else len(content)
