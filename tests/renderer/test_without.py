"""What counts as not installed, and for whom."""

from __future__ import annotations

import importlib
import sys
import threading
from pathlib import Path

import pytest

from renderer.without import without


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "spare_part.py").write_text("x = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "spare_part", raising=False)
    return "spare_part"


def test_it_is_not_found_meanwhile_and_found_again_later(module: str) -> None:
    with without(module), pytest.raises(ImportError):
        importlib.import_module(module)
    assert importlib.import_module(module).x == 1


def test_what_is_loaded_stays(module: str) -> None:
    importlib.import_module(module)
    with without(module):
        assert importlib.import_module(module).x == 1


def test_another_thread_finds_it_all_the_while(module: str) -> None:
    found = []
    with without(module):
        thread = threading.Thread(target=lambda: found.append(importlib.import_module(module).x))
        thread.start()
        thread.join()
    assert found == [1]
