"""The errors that a user can correct.

RayfarmError
├── SceneError      a scene file is invalid: what is wrong, where, and what to do
├── SettingsError   a render request is invalid: which field, and which values it accepts
└── MachineError    this machine lacks a limit, memory, temporary folder or library that the work needs
"""

from __future__ import annotations

import re

from renderer.sentences import Sentence

__all__ = ["MachineError", "RayfarmError", "SceneError", "SettingsError"]


_ADDRESS = re.compile(r"<[^<>]{0,200}? at 0x[0-9A-Fa-f]+>")


def _without_addresses(text: str) -> str:
    bare = _ADDRESS.sub("the data", text)
    if bare == text:
        return text
    return text.mapped(_without_addresses) if isinstance(text, Sentence) else bare


class RayfarmError(Exception):
    """An error with one clear sentence for the user who can correct it. Memory addresses are removed from libraries' messages."""

    def __init__(self, *args: object) -> None:
        super().__init__(*(_without_addresses(each) if isinstance(each, str) else each for each in args))


class SceneError(RayfarmError):
    """Raised if a scene file is invalid. The message names the file, and the line or field if known."""


class SettingsError(RayfarmError):
    """Raised if a render setting is invalid. The message names the setting and the accepted values.

    field: the setting's name in a request; None if the setting is not part of requests.
    """

    def __init__(self, *args: object, field: str | None = None) -> None:
        super().__init__(*args)
        self.field = field


class MachineError(RayfarmError):
    """Raised if this machine cannot do the work, independently of the scene.

    The message names what is missing; another machine may succeed.
    """
