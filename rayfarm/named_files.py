"""The files that a program uploads, by their path inside the scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

__all__ = ["Files", "by_name"]

Files = Mapping[str, str | Path] | Sequence[str | Path] | str | Path


def by_name(files: Files) -> dict[str, Path]:
    """The files by their path inside the scene: from one file, several files of one folder, or a dict by path."""
    if isinstance(files, Mapping):
        return {inside: Path(path) for inside, path in files.items()}
    return {Path(path).name: Path(path) for path in ([files] if isinstance(files, str | Path) else files)}
