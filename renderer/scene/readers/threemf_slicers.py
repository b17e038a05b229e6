"""Reads the filament colours of a 3MF's objects from the configuration files of Bambu Studio, Orca and PrusaSlicer.

Metadata/model_settings.config has the extruder number, from 1, of each object and part; project_settings.config has the colour
of each filament. PrusaSlicer's corresponding files are Slic3r_PE_model.config and Slic3r_PE.config.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection
from typing import Any, NamedTuple
from xml.etree import ElementTree

from renderer.errors import SceneError
from renderer.scene.readers.xml import refuse_entities

__all__ = ["MODELS", "PAINTED", "Filaments", "filaments_of"]

PAINTED = ("paint_color", "mmu_segmentation")  # attributes of triangles painted in a slicer
MODELS = ("metadata/model_settings.config", "metadata/slic3r_pe_model.config")
_BAMBU, _PRUSA = "metadata/project_settings.config", "metadata/slic3r_pe.config"
_COLOR = re.compile(r"#[0-9A-Fa-f]{6}(?:[0-9A-Fa-f]{2})?")
_EXTRUDERS = re.compile(r"(?m)^; (?:extruder|filament)_colour = (.+)$")


class Filaments(NamedTuple):
    """Filament colours, as #RRGGBB: `objects` by the ids of objects, `parts` by the ids of parts of objects."""

    objects: dict[str, str] = {}  # noqa: RUF012 - never written to
    parts: dict[str, str] = {}  # noqa: RUF012
    is_damaged: bool = False


def filaments_of(names: Collection[str], read: Callable[[str], bytes], file: str) -> Filaments:
    """Returns the filament colours of a package; none if a configuration file is damaged.

    names: the package's files, in lower case; read: returns a file's bytes; file: name of the package, for errors.
    """
    model = next((name for name in MODELS if name in names), None)
    if model is None:
        return Filaments()
    try:
        colors = _colors(names, read)
        data = read(model)
        refuse_entities(data, file)
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, SceneError, ValueError):
        return Filaments(is_damaged=True)
    found = Filaments({}, {})
    for each in root.iter("object"):
        _add_color(found.objects, each, colors)
        for part in each.iter("part"):
            _add_color(found.parts, part, colors)
    return found


def _colors(names: Collection[str], read: Callable[[str], bytes]) -> list[str]:
    if _BAMBU in names:
        said: Any = json.loads(read(_BAMBU))
        given: Any = said.get("filament_colour", []) if isinstance(said, dict) else []
        return [str(each) for each in given] if isinstance(given, list) else []
    lines = _EXTRUDERS.findall(read(_PRUSA).decode("utf-8", "replace")) if _PRUSA in names else []
    return max((line.strip().split(";") for line in lines), key=lambda line: sum(map(bool, line)), default=[])


def _add_color(found: dict[str, str], thing: ElementTree.Element, colors: list[str]) -> None:
    for said in thing.findall("metadata"):
        number = said.get("value", "")
        if said.get("key") == "extruder" and number.isdigit() and 0 < int(number) <= len(colors):
            color = colors[int(number) - 1].strip()
            if _COLOR.fullmatch(color):
                found[thing.get("id", "")] = color
