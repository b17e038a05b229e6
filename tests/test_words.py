"""Tests that the page's texts are in every catalogue of web/words/, and that no catalogue has unused texts."""

from __future__ import annotations

import json
import re

import pytest

from renderer import aovs
from renderer.presets import PRESETS
from renderer.setting_docs import described
from service.intake.examples import examples
from tests.helpers import ROOT

WEB = ROOT / "web"
LITERAL = r'"((?:[^"\\]|\\.)*)"'
# t("…"), tn(n, "one", "many"): the first argument of tn may contain nested parentheses once.
ONE = re.compile(rf"\bt\(\s*{LITERAL}")
COUNTED = re.compile(rf"\btn\(\s*(?:[^()\"]|\((?:[^()\"]|\([^()\"]*\))*\))+?,\s*{LITERAL},\s*{LITERAL}")
PLACE = re.compile(r"\{\w*\}")


def test_texts_are_found_in_all_call_forms() -> None:
    """`texts_of`, on which the other tests depend, finds the texts in all forms of calls to the page's translation functions."""
    source = 't("One {n}", { n }) + tn(f(a.b(c), 1), "{n} day", "{n} days") + t(\n  "Two") + at("none") + t(label)'
    assert texts_of(source) == {"One {n}", "{n} day", "{n} days", "Two"}


@pytest.mark.parametrize("language", ["de", "zh"])
def test_catalogues_contain_exactly_the_used_texts(language: str) -> None:
    catalogue = json.loads((WEB / "words" / f"{language}.json").read_text(encoding="utf-8"))
    used = texts_of_the_page() | texts_of_the_service()
    assert not used - catalogue.keys(), f"not in {language}.json"
    assert not catalogue.keys() - used, f"in {language}.json, and nowhere else"
    places = {key: text for key, text in catalogue.items() if set(PLACE.findall(key)) != set(PLACE.findall(text))}
    assert not places, "the places of values differ"
    edges = {key: text for key, text in catalogue.items() if not text.strip() or (text[0] == " ") != (key[0] == " ")}
    if language == "de":
        assert not edges, "empty, or glued to what stands before it"


def texts_of_the_page() -> set[str]:
    """Returns all literal texts in web/js that are passed to the translation functions."""
    return {text for path in (WEB / "js").rglob("*.js") for text in texts_of(path.read_text(encoding="utf-8"))}


def texts_of(source: str) -> set[str]:
    """Returns the literal texts that a JavaScript source passes to the translation functions."""
    return {json.loads(f'"{text}"') for found in (ONE.findall(source), *COUNTED.findall(source)) for text in found}


def texts_of_the_service() -> set[str]:
    """Returns the service's texts that the page translates: settings, light presets, examples."""
    found = set()
    for part in ("settings", "view", "work", "shot"):
        for setting in described()[part]:
            found |= {setting[name] for name in ("label", "help", "section", "phrase")}
            found |= {choice[name] for choice in setting["choices"] or () for name in ("label", "help")}
            found |= {setting["off"]["label"]} if setting["off"] else set()
    for channel in aovs.described():
        found |= {channel["label"], channel["help"], *(name for name in channel["values"] if len(name) > 1)}
    found |= {text for preset in PRESETS.values() for text in (preset.label, preset.help)}
    found |= {example.description for example, _ in examples(ROOT / "scenes")}
    comparisons = json.loads((WEB / "examples" / "comparisons.json").read_text(encoding="utf-8"))
    found |= {each[name] for all_of_one in comparisons.values() for each in all_of_one for name in ("title", "about")}
    return found - {""}
