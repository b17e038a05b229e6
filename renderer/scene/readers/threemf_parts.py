"""Finds the parts of a 3MF's objects that are not printed: negative volumes, setting modifiers and supports.

Sources: 3MF Core 1.3 (types of objects); PrusaSlicer's Slic3r_PE_model.config (volumes: ranges of an object's triangles); Bambu
Studio's and Orca's model_settings.config (parts of an object, by the ids of its components); Cura's metadata of objects.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.readers.threemf_slicers import MODELS
from renderer.scene.readers.xml import refuse_entities
from renderer.sentences import Sentence

__all__ = ["NotSolid"]

_SUPPORTS = Sentence("3mf-supports", "supports")
_MODIFIERS = Sentence("3mf-modifiers", "modifiers")
_BLOCKERS = Sentence("3mf-support-blockers", "support blockers")
_TYPES: dict[str, str] = {
    "support": _SUPPORTS,
    "solidsupport": _SUPPORTS,
    "other": Sentence("3mf-other-objects", "objects of the type other"),
}
_KINDS: dict[str, str] = {
    "negative": Sentence("3mf-negative-parts", "negative parts"),
    "modifier": _MODIFIERS,
    "enforcer": Sentence("3mf-support-enforcers", "support enforcers"),
    "blocker": _BLOCKERS,
    # of Cura
    "cutting_mesh": _MODIFIERS,
    "infill_mesh": _MODIFIERS,
    "anti_overhang_mesh": _BLOCKERS,
    "support_mesh": _SUPPORTS,
}


class NotSolid:
    """The objects and triangles of a package that are not solid, and so not printed; counts those left out, by kind."""

    def __init__(self, names: Collection[str], read: Callable[[str], bytes], file: str) -> None:
        """names: files of the package, in lower case; read: returns a file's bytes; file: name of the package, for errors."""
        self.left_out: Counter[str] = Counter()
        self.is_damaged = False
        self._parts: dict[tuple[str, str], str] = {}  # by object and component
        self._ranges: dict[str, list[tuple[int, int, str]]] = {}  # triangles of an object: first, last, kind
        for name in MODELS:
            if name in names:
                try:
                    data = read(name)
                    refuse_entities(data, file)
                    self._read_parts(ElementTree.fromstring(data))
                except (ElementTree.ParseError, SceneError, ValueError):
                    self.is_damaged = True

    def _read_parts(self, root: ElementTree.Element) -> None:
        for thing in root.iter("object"):
            number = thing.get("id", "")
            for part in thing.iter("part"):
                if kind := _kind(part.get("subtype", "")):
                    self._parts[number, part.get("id", "")] = kind
            for volume in thing.iter("volume"):
                said = {each.get("key"): each.get("value", "") for each in volume.findall("metadata")}
                kind = _kind(said.get("volume_type", "")) or ("modifiers" if said.get("modifier") == "1" else "")
                if kind:
                    first, last = int(volume.get("firstid", -1)), int(volume.get("lastid", -1))
                    self._ranges.setdefault(number, []).append((first, last, kind))

    def is_left_out(self, number: str, parent: str | None, type: str, metadata_names: Collection[str]) -> bool:
        """Returns True if an object is not printed, and counts it.

        parent: id of the containing object; type: the object's type attribute; metadata_names: names of its metadata entries
        that are true.
        """
        kind = _TYPES.get(type) or self._parts.get((parent or "", number)) or next(filter(None, map(_kind, metadata_names)), None)
        if kind:
            self.left_out[kind] += 1
        return bool(kind)

    def is_solid(self, number: str, count: int) -> npt.NDArray[np.bool_] | None:
        """Returns (count,) a mask of an object's triangles, True for those of solid volumes; None if all triangles are solid."""
        if number not in self._ranges:
            return None
        found = np.ones(count, bool)
        for first, last, kind in self._ranges[number]:
            if 0 <= first <= last < count:
                found[first : last + 1] = False
                self.left_out[kind] += 1
        return found


def _kind(words: str) -> str:
    return next((kind for key, kind in _KINDS.items() if key in words.lower()), "")
