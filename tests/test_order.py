"""Tests of the division of the tests among the processes of pytest-xdist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.conftest import has_only_long
from tests.parts import PARTS, SHARE_A_FARM, is_in_part, place

FOLDER = Path(__file__).parent
FILES = sorted(path.relative_to(FOLDER).as_posix() for path in FOLDER.rglob("test_*.py"))


@pytest.mark.parametrize("count", [1, 3, len(PARTS), 20])
def test_every_file_is_run_by_one_process(count: int) -> None:
    for file in FILES:
        assert sum(is_in_part(file, number, count) for number in range(count)) == 1, file


def test_every_folder_of_a_part_has_tests() -> None:
    places = {place(file) for file in FILES}
    assert places == {(n, m) for n, names in enumerate(PARTS) for m in range(len(names))}


def test_files_that_use_the_shared_farm_are_run_by_one_process() -> None:
    """The last file of that process ends the farm, so that a test of another file would not find it."""
    for file in FILES:
        source = (FOLDER / file).read_text(encoding="utf-8")
        if re.search(r"^def test_\w+\([^)]*\bfarm: Farm", source, re.MULTILINE) and "\ndef farm(" not in source:
            assert file.startswith(SHARE_A_FARM), file


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("pytestmark = [pytest.mark.long, pytest.mark.timeout(9)]\n\ndef test_a():\n", True),
        ("@pytest.mark.long\n@grid('a', 'bc')\ndef test_a(a):\n\n\n@pytest.mark.long  # minutes\ndef test_b():\n", True),
        ("@pytest.mark.long\n@pytest.mark.long\ndef test_a():\n\n\ndef test_b():\n", False),
        ("@pytest.mark.parametrize('a', [pytest.param(1, marks=pytest.mark.long), 2])\ndef test_a(a):\n", False),
        ("def a():\n    pass\n", False),
    ],
)
def test_files_with_only_long_tests_are_recognized(source: str, expected: bool) -> None:
    assert has_only_long(source) == expected
