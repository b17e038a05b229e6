"""Tests of the order in which pytest-xdist hands out test files to its processes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.conftest import SHARE_A_FARM, hand_out, has_only_long, rotated

FILES = [
    "tests/e2e/test_page.py",
    "tests/rayfarm/test_cli.py",
    "tests/renderer/test_film.py",
    "tests/service/test_main.py",
    "tests/test_words.py",
    "tests/worker/test_tasks.py",
]


def test_farm_files_come_first_and_waiting_ones_are_spread() -> None:
    places = hand_out(FILES)
    assert sorted(FILES, key=lambda file: places[file]) == [
        "tests/e2e/test_page.py",
        "tests/test_words.py",
        "tests/worker/test_tasks.py",
        "tests/service/test_main.py",
        "tests/rayfarm/test_cli.py",
        "tests/renderer/test_film.py",
    ]


def test_files_that_use_the_shared_farm_are_run_by_one_process() -> None:
    """The last file of that process ends the farm, so that a test of another file would not find it."""
    root = Path(__file__).parents[1]
    for path in Path(__file__).parent.rglob("test_*.py"):
        source = path.read_text(encoding="utf-8")
        if re.search(r"^def test_\w+\([^)]*\bfarm: Farm", source, re.MULTILINE) and "\ndef farm(" not in source:
            assert path.relative_to(root).as_posix().startswith(SHARE_A_FARM), path


def test_order_does_not_depend_on_collection() -> None:
    """The order of test files is the same in all processes, as xdist requires.

    Each process collects other files first.
    """
    assert hand_out(FILES) == hand_out(FILES[::-1])


def test_processes_collect_all_files_from_different_starts() -> None:
    whole = rotated(0, 1)
    names = [Path(name) for name in whole]
    assert len(set(names)) == len(names)
    for path in Path(__file__).parent.rglob("test_*.py"):
        assert len({path, *path.parents}.intersection(names)) == 1, path
    orders = [rotated(process, 3) for process in range(3)]
    assert all(sorted(order) == sorted(whole) for order in orders)
    assert len({order[0] for order in orders}) == 3


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
