"""Tests of sentences with message codes: codes survive exceptions, pickles and JSON, malformed codes leave plain text."""

from __future__ import annotations

import json
import math
import pickle
from typing import Any

import pytest

from renderer.errors import SceneError
from renderer.sentences import Sentence, codes_of, decoded, encoded, joined_sentences, with_count, with_full_stop

INNER = Sentence("image-cut-off", "{name}: the image is cut off; export it again.", name="a.png")
OUTER = Sentence("texture-left-out", "{error}; rendered without {n} of them.", error=INNER, n=3)


def test_sentence_equals_its_english_text() -> None:
    assert INNER == "a.png: the image is cut off; export it again."
    assert OUTER == "a.png: the image is cut off; export it again; rendered without 3 of them.", "one full stop"
    assert f"{INNER}" == str(INNER) and json.loads(json.dumps(INNER)) == INNER and {INNER: 1}[str(INNER)] == 1


def test_the_code_survives_exceptions_pickles_and_a_missing_full_stop() -> None:
    for error in (SceneError(INNER), pickle.loads(pickle.dumps(SceneError(INNER)))):
        text = str(error)
        assert isinstance(text, Sentence) and text.coded == {"code": "image-cut-off", "params": {"name": "a.png"}}
    shorter = INNER.removesuffix(".")
    assert isinstance(shorter, Sentence) and shorter == "a.png: the image is cut off; export it again"
    assert isinstance(INNER[:500], Sentence) and not isinstance(INNER[:5], Sentence)


def test_memory_addresses_are_removed_from_parameters() -> None:
    text = str(SceneError(Sentence("x", "broken: {error}", error="<A object at 0x7f00>")))
    assert isinstance(text, Sentence) and text == "broken: the data" and text.params == {"error": "the data"}


def test_json_contains_texts_and_codes() -> None:
    record = {"error": OUTER, "warnings": ["plain", INNER], "info": {"warnings": [INNER]}, "n": 1}
    wire = json.loads(json.dumps(encoded(record)))
    assert wire["error"] == OUTER and wire["warnings"] == ["plain", str(INNER)], "as releases before read it"
    nested = wire["codes"]["error"]["params"]["error"]
    assert nested == {"code": "image-cut-off", "params": {"name": "a.png"}, "text": str(INNER)}
    assert wire["codes"]["warnings"][0] is None and wire["info"]["codes"]["warnings"][0]["code"] == "image-cut-off"
    back = decoded(wire)
    assert back == record and codes_of(back) == codes_of(record) and isinstance(back["info"]["warnings"][0], Sentence)


@pytest.mark.parametrize(
    "codes",
    [
        7,
        {"error": 7},
        {"error": {"code": "Not A Code", "params": {}}},
        {"error": {"code": "x", "params": {"n": math.nan}}},
        {"error": {"code": "x", "params": {"text": "y" * 100_000}}},
        {"error": {"code": "x", "params": {"deep": [[[[[[[[[["z"]]]]]]]]]]}}},
        {"error": {"code": "x", "params": {"inner": {"code": "y"}}}},
    ],
)
def test_malformed_code_yields_plain_text(codes: Any) -> None:
    """A sentence with a malformed code becomes plain text, since workers of other releases or hostile ones may send anything."""
    found = decoded({"error": "A text.", "codes": codes})
    assert found["error"] == "A text." and not isinstance(found["error"], Sentence)


def test_composed_sentences() -> None:
    assert joined_sentences(INNER, "Ask again.") == f"{INNER} Ask again." and joined_sentences("", "Ask again.") == "Ask again."
    assert with_full_stop(INNER) == INNER and with_count("x", 1) == "x" and with_count("x", 3) == "x (3 times)"
