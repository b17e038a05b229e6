"""Tests that errors of the service that advise a request name a command instead on the command line."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest

from rayfarm.cli import GROUPS
from rayfarm.client import ClientError
from rayfarm.command_advice import SENTENCES, sentence
from tests.helpers import ROOT

REQUEST = re.compile(r"\b(GET|POST|PUT|PATCH|DELETE) /api/")
PLACE = re.compile(r"\{(\w+)\}")


def advising_requests() -> Iterator[tuple[str, set[str]]]:
    """Yields the code and the parameters of each sentence of the service whose text advises a request."""
    for path in (ROOT / "service").rglob("*.py"):
        source = path.read_text(encoding="utf-8")
        for call in ast.walk(ast.parse(source)) if REQUEST.search(source) else ():
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "Sentence":
                texts = [each.value for each in call.args if isinstance(each, ast.Constant)]
                if len(texts) == 2 and REQUEST.search(texts[1]):
                    yield texts[0], {str(each.arg) for each in call.keywords}


def test_each_error_that_advises_a_request_has_a_sentence_for_the_command_line() -> None:
    found = dict(advising_requests())
    assert len(found) > 10
    assert found.keys() == SENTENCES.keys()
    for code, text in SENTENCES.items():
        assert set(PLACE.findall(text)) <= found[code], code
        assert not REQUEST.search(text), code
        commands = {name.replace("_", "-") for names in GROUPS.values() for name in names}
        assert set(re.findall(r"`rayfarm ([\w-]+)", text)) <= commands, code


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ClientError("x", 404, "job-not-found", {"id": "'7f'"}), "There is no job '7f'. `rayfarm jobs` lists the jobs."),
        (ClientError("Another release's.", 404, "job-not-found", {}), "Another release's."),
        (ClientError("No farm answers."), "No farm answers."),
    ],
)
def test_sentence_fills_in_the_values_of_the_error(error: ClientError, said: str) -> None:
    assert sentence(error) == said
