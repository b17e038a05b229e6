"""Replaces values in nested dicts and lists without changing the original."""

from __future__ import annotations

from typing import Any

__all__ = ["Changed", "Path"]

Path = tuple[str | int, ...]


class Changed:
    """A copy of nested dicts and lists, in which values can be replaced without changing the original.

    Only the containers on the paths to replaced values are copied.
    """

    def __init__(self, root: dict[str, Any]) -> None:
        self.root = dict(root)
        self._own = {id(self.root)}

    def set(self, path: Path, value: Any) -> None:
        """Sets the value at a path, creating missing dicts."""
        at: Any = self.root
        for key in path[:-1]:
            at = self._own_copy(at, key)
        at[path[-1]] = value

    def _own_copy(self, parent: Any, key: str | int) -> Any:
        child = parent.get(key) if isinstance(parent, dict) else parent[key]
        if child is None or id(child) not in self._own:
            child = {} if child is None else child.copy()
            parent[key] = child
            self._own.add(id(child))
        return child
