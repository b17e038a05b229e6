"""Errors and exit codes of the command line.

RayfarmError (renderer.errors)
└── CommandError   one sentence, with a hint if possible; ends the program with EXIT_FAILED
"""

from __future__ import annotations

from renderer.errors import RayfarmError

__all__ = ["EXIT_FAILED", "EXIT_INTERRUPTED", "CommandError"]

EXIT_FAILED = 1
EXIT_INTERRUPTED = 130  # Ctrl-C, as in shells


class CommandError(RayfarmError):
    """Raised if a command fails. The message says why, and what to do."""
