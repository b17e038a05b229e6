"""Tests of how the page shows the service's sentences: translated by their code, or in English if they have none."""

from __future__ import annotations

import json
from typing import Any

import pytest

from renderer.sentences import Sentence, with_count
from tests.helpers import ROOT
from tests.page.node import Node

NO_JOB = Sentence("job-not-found", "There is no job {id}. GET /api/jobs lists those that are there.", id="'x'")
SAID = "return a.map(([text, coded]) => m.said(text, coded));"


def translate(program: str, *pairs: tuple[str | None, Any], locale: str = "de-DE") -> list[str]:
    with Node(program, locale) as node:
        found: list[str] = node.call("base/said", SAID, pairs)
    return found


def test_code_is_translated_with_parameters(program: str) -> None:
    german = json.loads((ROOT / "web/words/service.de.json").read_text())["job-not-found"].replace("{id}", "'x'")
    assert translate(program, (NO_JOB, NO_JOB.coded)) == [german] and german != NO_JOB
    assert translate(program, (NO_JOB, NO_JOB.coded), locale="en-GB") == [NO_JOB]


@pytest.mark.parametrize(("locale", "bracket"), [("en-GB", " ("), ("de-DE", " ("), ("zh-CN", "（")])
def test_cause_in_brackets_is_taken_off(program: str, locale: str, bracket: str) -> None:
    fault = Sentence("file-cut-off", "{name} ends before its data does. Copy or export it again", name="a.glb")
    cause = Sentence("line-numbered", "line {line}", line=3)
    both = Sentence("fault-with-detail", "{fault} ({detail})", fault=fault, detail=cause)
    damaged = Sentence(
        "fbx-file-damaged", "{name} is damaged or not an FBX file. Export it again ({error})", name="a.fbx", error="bad (1)"
    )
    records = [{"error": text, "codes": {"error": text.coded}} for text in (both, damaged, NO_JOB)]
    with Node(program, locale) as node:
        found = node.call(
            "base/said", "return a.map((each) => [m.saidOf(each, 'error'), ...m.saidApart(each, 'error')]);", records
        )
    for whole, text, words in found[:2]:
        assert text[-1] in ".。" and whole.startswith(f"{text[:-1]}{bracket}{words}") and "3" not in text and "(1)" not in text
    whole, text, words = found[2]
    assert (text, words) == (whole, "")


def test_text_without_code_is_unchanged(program: str) -> None:
    """A text without a known code, from an older worker or a newer release, is shown unchanged."""
    unknown = {"code": "not-known-here", "params": {}}
    assert translate(program, (NO_JOB, None), ("New.", unknown), (None, None)) == [NO_JOB, "New.", ""]


def test_nested_sentence_is_translated(program: str) -> None:
    inner = Sentence("view-waits-for-worker", "Waits for a worker.")
    german = json.loads((ROOT / "web/words/service.de.json").read_text())
    outer = with_count(inner.removesuffix("."), 3)
    assert isinstance(outer, Sentence)
    within = german["view-waits-for-worker"].rstrip(".")
    assert within in translate(program, (outer, outer.coded))[0]


def test_code_inside_message_is_found(program: str) -> None:
    inner = Sentence("file-missing", "{name} is not among the files; add it", name="a.png")
    outer = Sentence("scene-not-renderable", "{error}", error=inner)
    messages = [inner.coded, outer.coded, {"code": "x", "params": {"all": [1, outer.coded]}}, NO_JOB.coded, None]
    with Node(program, "en-GB") as node:
        found = node.call("base/codes", "return a.map((each) => m.hasCode(each, m.MISSING_FILE));", messages)
    assert found == [True, True, True, False, False]


@pytest.mark.parametrize("field", ["error", "warnings"])
def test_record_fields_are_translated_by_their_codes(program: str, field: str) -> None:
    record = {"error": NO_JOB, "warnings": [NO_JOB, "Plain."], "codes": {"error": NO_JOB.coded, "warnings": [NO_JOB.coded, None]}}
    with Node(program, "de-DE") as node:
        body = "return Array.isArray(a[0][a[1]]) ? m.allSaidOf(...a) : m.saidOf(...a);"
        found = node.call("base/said", body, [record, field])
    first = found[0] if field == "warnings" else found
    assert first.startswith("Einen Job") or ("Job" in first and first != NO_JOB)
    assert field == "error" or found[1] == "Plain."
