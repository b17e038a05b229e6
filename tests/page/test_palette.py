"""Tests of the command palette's search: which entries match a text."""

from __future__ import annotations

import pytest

from tests.page.node import Node

ENTRIES = [{"label": label, "note": note} for label, note in (("Jobs", ""), ("Cancel the job", "X"), ("Job sheet", "640×400"))]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", ["Jobs", "Cancel the job", "Job sheet"]),
        ("job", ["Jobs", "Job sheet", "Cancel the job"]),
        ("SHEET job", ["Job sheet"]),
        ("640", ["Job sheet"]),
        ("job nothing", []),
    ],
)
def test_all_words_must_match_and_prefix_matches_rank_first(node: Node, text: str, found: list[str]) -> None:
    body = "return m.matching(a.entries, a.text).map(({ label }) => label);"
    assert node.call("shell/palette", body, {"entries": ENTRIES, "text": text}) == found
