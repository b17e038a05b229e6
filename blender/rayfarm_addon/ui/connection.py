"""The connection to the farm: one client and one upload cache, shared by all renderings and viewports of this Blender."""

from __future__ import annotations

import contextlib
import threading

from ..farm.client import Client, FarmError
from ..farm.uploads import Uploads
from ..scene.files import digest_of

__all__ = ["Connection", "close", "connect", "notes", "store_warnings"]

_lock = threading.Lock()
_known: dict[tuple[str, str, str], Connection] = {}
_notes: list[str] = []


class Connection:
    """The client and the upload cache for one farm, with one user's token and one project.

    Raises FarmError if the address is invalid.
    """

    def __init__(self, url: str, token: str, project: str) -> None:
        self.client = Client(url, token)
        self.uploads = Uploads(self.client, digest_of, project)


def connect(url: str, token: str, project: str = "") -> Connection:
    """Returns the connection for this address, token and project, created at first use.

    Raises FarmError if the address is invalid.
    """
    key = url, token, project
    with _lock:
        if key not in _known:
            _known[key] = Connection(*key)
        return _known[key]


def close() -> None:
    """Deletes scenes without jobs from the farms, with a short timeout. Called when Blender exits or the add-on is disabled."""
    with _lock:
        known = list(_known.values())
        _known.clear()
    for each in known:
        scene = each.uploads.scene
        if scene is not None and scene not in each.uploads.rendered:
            with contextlib.suppress(FarmError):
                each.client.request("DELETE", f"/api/scenes/{scene}", patience_s=2.0)


def store_warnings(sentences: list[str]) -> None:
    """Stores the export's warnings about the scene, for display in the panel."""
    _notes[:] = sentences


def notes() -> list[str]:
    """Returns the warnings stored by the last `store_warnings`."""
    return list(_notes)
