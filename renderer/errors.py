"""The faults a person can act on.

RayfarmError
├── SceneError      a file that cannot become a scene: what is wrong, where, and what to do
├── SettingsError   a request that cannot be rendered: which field and which values it takes
└── MachineError    this machine cannot do it, whatever the scene: its limits, memory, temporary folder, libraries
"""

__all__ = ["MachineError", "RayfarmError", "SceneError", "SettingsError"]


class RayfarmError(Exception):
    """A fault with one clear sentence for the person who can mend it."""


class SceneError(RayfarmError):
    """A scene file is wrong. The message names the file, and the line or field where there is one."""


class SettingsError(RayfarmError):
    """A render setting is out of range. The message names the setting and what it takes."""


class MachineError(RayfarmError):
    """This machine cannot do it, whatever the scene. The message says what it lacks; another machine may do it."""
