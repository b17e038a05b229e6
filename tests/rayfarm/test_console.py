"""Tests that the command line prints names and messages from untrusted sources safely."""

from __future__ import annotations

import io

import pytest
from rich.progress import Progress, TextColumn
from rich.table import Table
from rich.text import Text

from rayfarm.console import PlainConsole
from rayfarm.watch.words import fit_columns

HOSTILE = "a\x1b[2J\x1b]0;owned\x07\u202eb\x9b31m\r\ud800"
SHOWN = r"a\u001b[2J\u001b]0;owned\u0007\u202eb\u009b31m\u000d\ud800"


def _table(cell: str | Text) -> Table:
    table = Table()
    table.add_column(cell)
    table.add_row(cell)
    return table


@pytest.mark.parametrize("what", [HOSTILE, Text(HOSTILE, style="bold"), _table(HOSTILE), _table(Text(HOSTILE))])
@pytest.mark.parametrize("is_terminal", [False, True])
def test_control_characters_are_shown_as_escapes(what: object, is_terminal: bool) -> None:
    file = io.StringIO()
    PlainConsole(file=file, width=200, force_terminal=is_terminal, highlight=False).print(what, markup=False, soft_wrap=True)
    said = file.getvalue()
    assert r"a\u001b[2J" in said
    if isinstance(what, str):
        assert said == f"{SHOWN}\n"
    if isinstance(what, Table) and isinstance(what.columns[0].header, str):
        assert said.count(SHOWN) == 2, "cells are measured as they are shown"
    for dangerous in ("\x1b[2J", "\x1b]", "\x07", "\u202e", "\x9b", "\r", "\ud800"):
        assert dangerous not in said


def test_styles_and_progress_still_reach_a_terminal() -> None:
    file = io.StringIO()
    console = PlainConsole(file=file, width=80, force_terminal=True, color_system="standard")
    console.print("[bold]x[/bold]")
    assert "\x1b[1mx" in file.getvalue()
    with Progress(TextColumn("{task.description}", markup=False), console=console) as progress:
        progress.add_task(HOSTILE)
    assert "\x1b[2J" not in file.getvalue() and r"\u001b[2J" in file.getvalue()


def test_line_is_fitted_to_width() -> None:
    assert fit_columns("a\x1bb\nc", 12) == r"a\u001bb c  "
