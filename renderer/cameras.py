"""Selection of a camera by name or index."""

from __future__ import annotations

from collections.abc import Sequence

from renderer.errors import SettingsError
from renderer.sentences import Sentence, first_items

__all__ = ["MOST_CAMERAS", "camera_number"]

_MOST_DIGITS = 6
MOST_CAMERAS = 10**_MOST_DIGITS


def camera_number(names: Sequence[str], name_or_index: str | int | None) -> int:
    """Returns the index of the camera with the given name or index (from 0); of the first camera if none is given.

    Raises SettingsError if there is no such camera.
    """
    if not names:
        raise SettingsError(
            Sentence("camera-none", "camera cannot be chosen, as the scene has none; give a view"), field="camera"
        )
    if name_or_index is None:
        return 0
    if isinstance(name_or_index, str):
        if name_or_index in names:
            return names.index(name_or_index)
        if not (name_or_index.isascii() and name_or_index.isdigit() and len(name_or_index) <= _MOST_DIGITS):
            shown = repr(name_or_index) if len(name_or_index) <= 60 else f"{name_or_index[:40]!r}..."
            raise SettingsError(
                Sentence(
                    "camera-not-in-scene",
                    "camera is {camera}; the scene has none of that name. Its cameras are {cameras}",
                    camera=shown,
                    cameras=first_items((f"{i}: {name}" for i, name in enumerate(names)), 12),
                ),
                field="camera",
            )
        name_or_index = int(name_or_index)
    if not 0 <= name_or_index < len(names):
        raise SettingsError(
            Sentence(
                "camera-number-unknown",
                "camera is number {number}; the scene has {count}, counted from 0",
                number=name_or_index,
                count=len(names),
            ),
            field="camera",
        )
    return name_or_index
