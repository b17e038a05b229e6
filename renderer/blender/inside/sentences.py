"""Notes with codes: loads renderer/sentences.py by its path, since Blender's Python imports none of Rayfarm's packages."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from renderer.sentences import Sentence, first_items, to_text

__all__ = ["NAME", "SOURCE", "Sentence", "first_items", "to_text"]

SOURCE = Path(__file__).resolve().parents[2] / "sentences.py"
NAME = "rayfarm_addon.farm.protocol.sentences"  # the add-on's copy of the module, so that Blender has one class of sentences

if not TYPE_CHECKING:
    _spec = importlib.util.spec_from_file_location(NAME, SOURCE)
    _module = sys.modules[NAME] = importlib.util.module_from_spec(_spec)
    _spec.loader.exec_module(_module)
    Sentence, first_items, to_text = _module.Sentence, _module.first_items, _module.to_text
