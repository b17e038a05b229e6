"""The people who look at the same scene in live views: their names, cursors and cameras, for each other's pages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from typing import Any

__all__ = ["MAX_SHOWN", "Person", "SceneVisitors"]

MAX_SHOWN = 16  # people that a page lists


@dataclass(eq=False)
class Person:
    """One open live view. name: None: unknown. cursor: from the picture's centre, in its heights. view: the camera as JSON.

    is_away: whether the page is hidden, so that others do not see the person. wake: called when others or the scene's takes
    change. take_changes: number of changes of the scene's takes since the view was opened.
    """

    id: int
    scene: str
    wake: Callable[[], object]
    name: str | None = None
    cursor: tuple[float, float] | None = None
    view: dict[str, Any] | None = None
    is_away: bool = False
    take_changes: int = 0

    def to_json(self) -> dict[str, Any]:
        """Returns what others see of the person."""
        return {"id": self.id, "name": self.name, "cursor": self.cursor, "view": self.view}


@dataclass
class SceneVisitors:
    """All open live views by scene. Used on the event loop only."""

    _of_scene: dict[str, dict[int, Person]] = field(default_factory=dict)
    _ids: count[int] = field(default_factory=lambda: count(1))

    def enter(self, scene: str, name: str | None, wake: Callable[[], object]) -> Person:
        """Adds a live view of a scene; returns its person, whom others see from the first `update` on."""
        person = Person(next(self._ids), scene, wake, name, is_away=True)
        self._of_scene.setdefault(scene, {})[person.id] = person
        return person

    def leave(self, person: Person) -> None:
        """Removes a live view that was closed."""
        here = self._of_scene.get(person.scene, {})
        here.pop(person.id, None)
        if not here:
            self._of_scene.pop(person.scene, None)
        self._wake_others(person)

    def update(self, person: Person, **changes: Any) -> None:
        """Changes attributes of a person, and wakes the others."""
        for name, value in changes.items():
            setattr(person, name, value)
        self._wake_others(person)

    def others(self, person: Person) -> list[dict[str, Any]]:
        """Returns the others who look at the same scene, in the order of their arrival, MAX_SHOWN at most."""
        here = self._of_scene.get(person.scene, {}).values()
        return [each.to_json() for each in here if each is not person and not each.is_away][:MAX_SHOWN]

    def report_takes(self, scene: str) -> None:
        """Counts a change of a scene's takes for everyone who looks at it, and wakes them."""
        for each in self._of_scene.get(scene, {}).values():
            each.take_changes += 1
            each.wake()

    def _wake_others(self, person: Person) -> None:
        for each in self._of_scene.get(person.scene, {}).values():
            if each is not person:
                each.wake()
