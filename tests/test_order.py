"""The order in which test files are handed out to the processes of a run."""

from __future__ import annotations

from tests.conftest import hand_out

FILES = [
    "tests/e2e/test_page.py",
    "tests/rayfarm/test_cli.py",
    "tests/renderer/test_film.py",
    "tests/service/test_main.py",
    "tests/test_words.py",
    "tests/worker/test_tasks.py",
]


def test_the_farm_comes_first_and_files_that_wait_are_spread() -> None:
    places = hand_out(FILES)
    assert sorted(FILES, key=lambda file: places[file]) == [
        "tests/e2e/test_page.py",
        "tests/test_words.py",
        "tests/worker/test_tasks.py",
        "tests/service/test_main.py",
        "tests/rayfarm/test_cli.py",
        "tests/renderer/test_film.py",
    ]


def test_the_order_does_not_depend_on_the_order_of_collection() -> None:
    """xdist requires that all processes have the same order; each collects other files first."""
    assert hand_out(FILES) == hand_out(FILES[::-1])
