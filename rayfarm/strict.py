"""`--strict`: makes warnings of a reader (guessed, dropped or replaced content) errors of a command."""

from __future__ import annotations

from collections.abc import Sequence

from rayfarm.errors import CommandError

__all__ = ["refuse"]


def refuse(scene: str, warnings: Sequence[str], strict: bool) -> None:
    """Raises CommandError with all of a scene's warnings if they are errors; does nothing without warnings."""
    if not strict or not warnings:
        return
    count = "1 warning" if len(warnings) == 1 else f"{len(warnings)} warnings"
    listed = "".join(f"\n  {warning}" for warning in warnings)
    raise CommandError(f"{scene}: {count}, and --strict makes them errors:{listed}")
