"""The farm that this Blender speaks to: one client and one memory of what was sent, shared by pictures and viewports."""

from __future__ import annotations

import contextlib
import threading

from ..farm.client import Client, FarmError
from ..farm.uploads import Uploads
from ..scene.files import digest_of

__all__ = ["Connection", "close", "connect", "note", "notes"]

_lock = threading.Lock()
_known: dict[tuple[str, str, str], Connection] = {}
_notes: list[str] = []


class Connection:
    """A farm, as one person and into one project. Raises FarmError where the address is none."""

    def __init__(self, url: str, token: str, project: str) -> None:
        self.client = Client(url, token)
        self.uploads = Uploads(self.client, digest_of, project)


def connect(url: str, token: str, project: str = "") -> Connection:
    """The connection of this address; made once. Raises FarmError."""
    key = url, token, project
    with _lock:
        if key not in _known:
            _known[key] = Connection(*key)
        return _known[key]


def close() -> None:
    """Blender ends, or the add-on goes: what was only looked at is deleted, by whoever answers at once."""
    with _lock:
        known = list(_known.values())
        _known.clear()
    for each in known:
        scene = each.uploads.scene
        if scene is not None and scene not in each.uploads.rendered:
            with contextlib.suppress(FarmError):
                each.client.call("DELETE", f"/api/scenes/{scene}", patience_s=2.0)


def note(sentences: list[str]) -> None:
    """What of the scene is not taken over, for the panel."""
    _notes[:] = sentences


def notes() -> list[str]:
    """As told last."""
    return list(_notes)
