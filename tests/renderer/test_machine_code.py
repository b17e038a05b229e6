"""Tests of machine code cached in files: it is found again, also by other processes, and only used where it is valid."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from renderer import machine_code
from renderer.machine_code import collect_cache_files

KEY = (("int64", "float32"), ("x86-64", "v3"), ("ab", "cd"))


@pytest.fixture
def files(tmp_path: Path) -> Any:
    return machine_code._Files(tmp_path, "path._render-1.py311", "stamp")


def test_saved_code_is_loaded_by_its_key_only(files: Any, tmp_path: Path) -> None:
    assert files.load(KEY) is None
    files.save(KEY, {"code": b"x"})
    assert files.load(KEY) == {"code": b"x"}
    assert machine_code._Files(tmp_path, "path._render-1.py311", "stamp").load(KEY) == {"code": b"x"}
    others = [(("int64",), *KEY[1:]), (KEY[0], ("arm", ""), KEY[2]), (*KEY[:2], ("ab", "ce"))]
    assert all(files.load(other) is None for other in others)
    assert machine_code._Files(tmp_path, "path._render-1.py311", "another stamp").load(KEY) is None
    assert machine_code._Files(tmp_path, "path._other-1.py311", "stamp").load(KEY) is None


@pytest.mark.parametrize("left", [b"", b"\x80\x05\x95", b"no pickle", b"cnowhere\nNothing\n.", b"crenderer.jit\nNothing\n."])
def test_damaged_cache_file_is_ignored(files: Any, tmp_path: Path, left: bytes) -> None:
    files.save(KEY, 1)
    (path,) = tmp_path.iterdir()
    path.write_bytes(left)
    assert files.load(KEY) is None
    files.save(KEY, 2)
    assert files.load(KEY) == 2


def test_unwritable_cache_folder_caches_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    files = machine_code._Files(tmp_path / "file" / "gone", "path._render-1.py311", "stamp")
    files.save(KEY, 1)
    assert files.load(KEY) is None


def test_accessed_files_are_collected(files: Any, tmp_path: Path) -> None:
    files.save(KEY, 1)
    with collect_cache_files() as paths:
        assert paths == set()
        files.load(KEY)
        files.load((("nobody",), *KEY[1:]))
        read = set(paths)
        files.save((("int32",), *KEY[1:]), 2)
    assert len(read) == 1
    assert read < paths == set(tmp_path.iterdir())
    files.flush()
    assert not list(tmp_path.iterdir())


def test_files_of_inner_functions_are_not_collected(tmp_path: Path) -> None:
    files = machine_code._Files(tmp_path, "walk.walk-1.py311", "stamp", is_kernel=False)
    with collect_cache_files() as paths:
        files.save(KEY, 1)
        assert files.load(KEY) == 1
    assert paths == set()
