"""The service's sentences that users see are exactly those translated in web/words/service.*.json."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.helpers import ROOT

# Whose sentences are shown on the page: none of them is left in English.
SHOWN = (
    "service/access/passwords.py",
    "service/access/projects.py",
    "service/access/quotas.py",
    "service/access/users.py",
    "service/jobs",
    "service/routes/explain.py",
    "service/routes/login.py",
    "service/http/single_upload.py",
    "service/scenes",
    "service/errors.py",
    "service/intake",
    "service/scheduling",
    "service/store/film_faults.py",
    "service/store/disk_space.py",
    "service/viewing",
    "worker/process/apply_terms.py",
)
# Who may say what is translated.
SPEAKERS = (
    "protocol",
    "service",
    "worker",
    "renderer/scene",
    "renderer/image",
    "renderer/formats.py",
    "renderer/blender",
    "renderer/confine",
    "renderer/frames.py",
    "renderer/zip_names.py",
)
PLACE = "\0"
SENTENCE = re.compile(r"[A-Z\0](?=.* ).*[.…]", re.DOTALL)
BETWEEN = re.compile(r"(?<=[.!?]) (?=[A-Z`\0])")
LEAST = 5  # letters beside its places: with fewer a text could be anything


def test_every_sentence_that_is_shown_is_translated() -> None:
    known = [_template(key) for key in _catalogue("de")]
    left = {
        each: str(path.relative_to(ROOT))
        for path in _files(SHOWN)
        for text in _texts(path)
        if SENTENCE.fullmatch(text)
        for each in BETWEEN.split(text)
        if _says_enough(each) and not _is_known(each, known) and not _is_known(each.removeprefix(f"{PLACE} "), known)
    }
    assert not left, "not in service.de.json and service.zh.json"


def _is_known(text: str, known: list[str]) -> bool:
    return any(_fits(key, text) or _fits(text, key) for key in known)


def test_nothing_is_translated_that_nobody_says() -> None:
    said = _said()
    forms = {key: _forms(key) for key in _catalogue("de")}
    left = {key: found for key, found in forms.items() if said.isdisjoint(found)}  # few: most are said as they stand
    dead = {key for key, found in left.items() if not any(_fits(a, b) or _fits(b, a) for a in found for b in said)}
    assert not dead, "in service.de.json, and said nowhere"


@pytest.mark.parametrize("language", ["de", "zh"])
def test_a_translation_has_the_places_of_its_sentence(language: str) -> None:
    names = re.compile(r"\{\w*\}")
    wrong = {key: text for key, text in _catalogue(language).items() if set(names.findall(text)) != set(names.findall(key))}
    assert not wrong


def test_both_catalogues_have_the_same_sentences() -> None:
    assert _catalogue("de").keys() == _catalogue("zh").keys()


def _catalogue(language: str) -> dict[str, str]:
    catalogue: dict[str, str] = json.loads((ROOT / "web" / "words" / f"service.{language}.json").read_text(encoding="utf-8"))
    return catalogue


def _template(key: str) -> str:
    return re.sub(r"\{\w+\}", PLACE, key)


def _forms(key: str) -> set[str]:
    """Returns the forms of a sentence in the sources: without its subject, a reason in brackets, or its full stop."""
    text = _template(key)
    bare = re.sub(rf"^{PLACE} ?", "", text)
    found = {form for each in (text, bare) for form in (each, each.removesuffix("."), each.partition(f" ({PLACE})")[0])}
    return {form for form in found if _says_enough(form)}


def _fits(template: str, text: str) -> bool:
    """Whether a text matches a template."""
    at, parts = 0, template.split(PLACE)
    if len(parts) == 1:
        return template == text
    if not text.startswith(parts[0]) or not text.endswith(parts[-1]) or len(text) < len(parts[0]) + len(parts[-1]):
        return False
    at = len(parts[0])
    for part in parts[1:-1]:
        found = text.find(part, at)
        if found < 0:
            return False
        at = found + len(part)
    return at <= len(text) - len(parts[-1])


def _says_enough(text: str) -> bool:
    return len(re.sub(r"[^A-Za-z]", "", text)) >= LEAST


@cache
def _said() -> frozenset[str]:
    """Returns all messages in the sources, as a whole, by sentence, and by part."""
    found: set[str] = set()
    for path in _files(SPEAKERS):
        for text in _texts(path):
            for sentence in {text, *BETWEEN.split(text)}:
                for half in {sentence, *sentence.split("; ")}:
                    for piece in {half, half.partition(": ")[2]}:
                        found |= {piece, piece.removesuffix(".")}
    return frozenset(each for each in found if _says_enough(each))


def _files(names: tuple[str, ...]) -> Iterator[Path]:
    for name in names:
        path = ROOT / name
        yield from [path] if path.is_file() else sorted(path.rglob("*.py"))


@cache
def _texts(path: Path) -> tuple[str, ...]:
    """Returns a module's strings except docstrings, with PLACE for values."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    inner = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    inner |= {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    found = (_text(node) for node in nodes if id(node) not in inner)
    return tuple(text for text in found if text is not None)


def _text(node: ast.AST) -> str | None:
    if isinstance(node, ast.Constant):
        return re.sub(r"\{\w*\}", PLACE, node.value) if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else PLACE for part in node.values)
    return None
