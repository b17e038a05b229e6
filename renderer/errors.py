"""The faults a person can act on.

RayfarmError
├── SceneError      a file that cannot become a scene: what is wrong, where, and what to do
├── SettingsError   a request that cannot be rendered: which field and which values it takes
└── MachineError    this machine cannot do it, whatever the scene: its limits, memory, temporary folder, libraries
"""

from __future__ import annotations

import re

__all__ = ["MachineError", "RayfarmError", "SceneError", "SettingsError"]


_ADDRESS = re.compile(r"<[^<>]{0,200}? at 0x[0-9A-Fa-f]+>")


class RayfarmError(Exception):
    """A fault with one clear sentence for the person who can mend it. Object addresses from libraries' messages are left out."""

    def __init__(self, *args: object) -> None:
        super().__init__(*(_ADDRESS.sub("the data", each) if isinstance(each, str) else each for each in args))


class SceneError(RayfarmError):
    """A scene file is wrong. The message names the file, and the line or field where there is one."""


class SettingsError(RayfarmError):
    """A render setting is out of range. The message names the setting and what it takes."""


class MachineError(RayfarmError):
    """This machine cannot do it, whatever the scene. The message says what it lacks; another machine may do it."""
