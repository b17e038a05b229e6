"""Selection of one of a scene's cameras."""

from __future__ import annotations

from collections.abc import Sequence

from renderer.errors import SettingsError
from renderer.sentences import Sentence, first_items

__all__ = ["MOST_CAMERAS", "camera_number"]

_MOST_DIGITS = 6
MOST_CAMERAS = 10**_MOST_DIGITS


def camera_number(names: Sequence[str], wanted: str | int | None) -> int:
    """Returns the index of a camera given by name or by index from 0; by default the first.

    Raises SettingsError if there is none.
    """
    if not names:
        raise SettingsError(
            Sentence("camera-none", "camera cannot be chosen, as the scene has none; give a view"), field="camera"
        )
    if wanted is None:
        return 0
    if isinstance(wanted, str):
        if wanted in names:
            return names.index(wanted)
        if not (wanted.isascii() and wanted.isdigit() and len(wanted) <= _MOST_DIGITS):
            shown = repr(wanted) if len(wanted) <= 60 else f"{wanted[:40]!r}..."
            raise SettingsError(
                Sentence(
                    "camera-not-in-scene",
                    "camera is {camera}; the scene has none of that name. Its cameras are {cameras}",
                    camera=shown,
                    cameras=first_items((f"{i}: {name}" for i, name in enumerate(names)), 12),
                ),
                field="camera",
            )
        wanted = int(wanted)
    if not 0 <= wanted < len(names):
        raise SettingsError(
            Sentence(
                "camera-number-unknown",
                "camera is number {number}; the scene has {count}, counted from 0",
                number=wanted,
                count=len(names),
            ),
            field="camera",
        )
    return wanted
