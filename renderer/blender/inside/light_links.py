"""Light and shadow linking of Blender's objects: the link sets of a scene file, by the collections of lights and meshes."""

from __future__ import annotations

from typing import Any

from .light_groups import valid_name
from .sentences import Sentence

__all__ = ["LinkSets"]

MOST = 31  # renderer/scene/light_links.py


class LinkSets:
    """The link sets that a scene's lights use, by name, as a scene file has them.

    names: Blender's name of each object that is rendered -> its name in the scene file. Others are not named in link sets.
    """

    def __init__(self, names: dict[str, str], notes: list[str]) -> None:
        self._names, self._notes = names, notes
        self._known: dict[str, str] = {}  # Blender's name of a collection -> name of the link set
        self.sets: dict[str, dict[str, list[str]]] = {}

    def fields_for(self, thing: Any) -> dict[str, str]:
        """Returns the fields `light_link` and `shadow_link` of an object that emits light, as far as it has such sets."""
        found = {"light_link": self._name_for(thing, "receiver"), "shadow_link": self._name_for(thing, "blocker")}
        return {field: name for field, name in found.items() if name}

    def _name_for(self, thing: Any, role: str) -> str:
        """Returns the name of a link set of an object that emits light; empty if it has none: all objects take part.

        role: receiver, for the objects that it illuminates, or blocker, for those that block its light.
        """
        collection = getattr(getattr(thing, "light_linking", None), f"{role}_collection", None)
        if collection is None:
            return ""
        if collection.name not in self._known:
            if len(self._known) == MOST:
                self._notes.append(
                    Sentence("blend-light-linking", "{object}: lights all objects; light linking is ignored", object=thing.name)
                    if role == "receiver"
                    else Sentence(
                        "blend-shadow-linking",
                        "{object}: shadow linking is ignored; all objects block its light",
                        object=thing.name,
                    )
                )
                return ""
            self._known[collection.name] = name = self._free_name(collection.name)
            self.sets[name] = self._members(collection)
        return self._known[collection.name]

    def _free_name(self, name: str) -> str:
        """Returns a name for a link set that no other one has. name: of Blender's collection."""
        usable = valid_name(name) or "links"
        found, count = usable, 1
        while found in self.sets:
            count += 1
            found = valid_name(f"{count} {usable}")
        return found

    def _members(self, collection: Any) -> dict[str, list[str]]:
        """Returns the objects that a receiver or blocker collection includes and excludes.

        If it only excludes objects, all others take part, as in Blender.
        """
        by_state: dict[str, list[str]] = {"INCLUDE": [], "EXCLUDE": []}
        for things, links in (
            ([[each] for each in collection.objects], collection.collection_objects),
            ([[*each.all_objects] for each in collection.children], collection.collection_children),
        ):
            for members, link in zip(things, links, strict=True):
                state = str(getattr(getattr(link, "light_linking", None), "link_state", "INCLUDE"))
                by_state[state] += [self._names[each.name] for each in members if each.name in self._names]
        include, exclude = ([*dict.fromkeys(by_state[state])] for state in ("INCLUDE", "EXCLUDE"))
        found = {"exclude": exclude} if exclude else {}
        if include or not exclude:
            found["include"] = include
        return found
