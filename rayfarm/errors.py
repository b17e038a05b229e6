"""What the command line says when it cannot do what was asked.

RayfarmError (renderer.errors)
└── CommandError   one sentence and, where it helps, what to do; ends the program with EXIT_FAILED
"""

from __future__ import annotations

from renderer.errors import RayfarmError

__all__ = ["EXIT_FAILED", "EXIT_INTERRUPTED", "CommandError"]

EXIT_FAILED = 1
EXIT_INTERRUPTED = 130  # Ctrl-C, as shells count it


class CommandError(RayfarmError):
    """A command cannot do what was asked; the message says why and what to do."""
