"""Plain data with other values in it."""

from __future__ import annotations

from typing import Any

__all__ = ["Changed", "Path"]

Path = tuple[str | int, ...]


class Changed:
    """A copy of dicts and lists in which values are replaced: what lies on the way to them is copied once, the rest shared."""

    def __init__(self, root: dict[str, Any]) -> None:
        self.root = dict(root)
        self._own = {id(self.root)}

    def set(self, path: Path, value: Any) -> None:
        """Puts a value in its place; a dict that is missing on the way to it is made."""
        at: Any = self.root
        for key in path[:-1]:
            at = self._owned(at, key)
        at[path[-1]] = value

    def _owned(self, parent: Any, key: str | int) -> Any:
        child = parent.get(key) if isinstance(parent, dict) else parent[key]
        if child is None or id(child) not in self._own:
            child = {} if child is None else child.copy()
            parent[key] = child
            self._own.add(id(child))
        return child
