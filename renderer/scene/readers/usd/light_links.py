"""Light and shadow linking of USD, by the collections lightLink and shadowLink of UsdLux.LightAPI."""

from __future__ import annotations

from typing import Any

from pxr import UsdGeom, UsdLux

from renderer.scene.description import LightLink, SceneDescription
from renderer.scene.light_links import MAX_LINK_SETS
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.prims import PlacedPrim
from renderer.sentences import Sentence

__all__ = ["LinkSets", "has_targets"]


def has_targets(collection: Any) -> bool:
    """Returns True if a collection of a light lists prims to include or to exclude. collection: may be invalid."""
    return bool(collection) and any(
        relation.HasAuthoredTargets() for relation in (collection.GetExcludesRel(), collection.GetIncludesRel())
    )


class LinkSets:
    """Makes the link sets of a stage's lights, in a scene description; collections of the same objects share one."""

    def __init__(self, found: list[PlacedPrim], description: SceneDescription, notes: Notes) -> None:
        """Takes the prims that may be illuminated from `found`, all prims of the stage."""
        self._objects = [each for each in found if each.shown and each.prim.IsA(UsdGeom.Gprim)]
        self._description, self._notes = description, notes
        self._names: dict[tuple[str, ...], str] = {}

    def names_for(self, prim: Any) -> tuple[str, str]:
        """Returns the names of a light's link sets, `light_link` and `shadow_link`; empty if all objects take part."""
        light = UsdLux.LightAPI(prim)
        return (
            self._name_for(prim, light.GetLightLinkCollectionAPI()),
            self._name_for(prim, light.GetShadowLinkCollectionAPI()),
        )

    def _name_for(self, prim: Any, collection: Any) -> str:
        """Returns the name of the link set of a collection of a light; empty if it includes all objects."""
        if not collection or not (has_targets(collection) or collection.GetIncludeRootAttr().Get() is False):
            return ""
        query = collection.ComputeMembershipQuery()
        dark = tuple(each.name for each in self._objects if not query.IsPathIncluded(each.prim.GetPath()))
        if not dark:
            return ""
        if dark not in self._names:
            if len(self._names) == MAX_LINK_SETS:
                self._notes.add(
                    Sentence("usd-light-links-too-many", "Light linking is ignored beyond {most} sets", most=MAX_LINK_SETS),
                    str(prim.GetPath()),
                )
                return ""
            self._names[dark] = f"set {len(self._names) + 1}"
            self._description.light_links[self._names[dark]] = LightLink(None, dark)
        return self._names[dark]
