"""Resolves the files that a program uploads to paths inside the scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

__all__ = ["Files", "by_name"]

Files = Mapping[str, str | Path] | Sequence[str | Path] | str | Path


def by_name(files: Files) -> dict[str, Path]:
    """Returns the files by their path inside the scene. files: one file, several from one folder, or a dict by path."""
    if isinstance(files, Mapping):
        return {inside: Path(path) for inside, path in files.items()}
    return {Path(path).name: Path(path) for path in ([files] if isinstance(files, str | Path) else files)}
