"""`--strict`: a reader's warnings (guessed, dropped or replaced content) make a command fail."""

from __future__ import annotations

from collections.abc import Sequence

from rayfarm.errors import CommandError

__all__ = ["refuse_warnings"]


def refuse_warnings(scene: str, warnings: Sequence[str], strict: bool) -> None:
    """Raises CommandError with all warnings if `strict` is set and there are any."""
    if not strict or not warnings:
        return
    count = "1 warning" if len(warnings) == 1 else f"{len(warnings)} warnings"
    listed = "".join(f"\n  {warning}" for warning in warnings)
    raise CommandError(f"{scene}: {count}, and --strict makes them errors:{listed}")
