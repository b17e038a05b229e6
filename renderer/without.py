"""Imports that a library tries, and can do without."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import ModuleType

__all__ = ["without"]


class _Nowhere:
    """Finds none of these modules, for one thread: another one may be importing them for itself."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._thread = threading.get_ident()

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> None:
        """Nothing, so that the next finder looks. Raises ModuleNotFoundError for what counts as not installed."""
        if name in self._names and threading.get_ident() == self._thread:
            raise ModuleNotFoundError(f"{name} is left out here", name=name)


@contextmanager
def without(*names: str) -> Iterator[None]:
    """Meanwhile these modules count as not installed, unless they are loaded: for a library that imports more than we use of it,
    and goes on where that is missing."""
    nowhere = _Nowhere(names)
    sys.meta_path.insert(0, nowhere)
    try:
        yield
    finally:
        sys.meta_path.remove(nowhere)
