"""Tests of kernel preparation: a starting worker waits only for the parts of a kernel that all scenes need.

The remaining parts are compiled with the second kernel.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from renderer import jit, render
from renderer.render import FULL, PLAIN, kernel_name, load_preparing, warm_up
from tests.helpers import ROOT

_PROGRAM = """
import sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from renderer.preparation_kernels import prepare_first
from renderer.scene.compile import compile_scene
from renderer.scene.animation import Moment
from renderer.scene.load import Shot

prepare_first()
compile = Dispatcher.compile
Dispatcher.compile = lambda self, types: (print(self.py_func.__name__), compile(self, types))[1]
shot = Shot(Path(sys.argv[1]), sys.argv[2], None, None)
compile_scene(shot.scene_at(Moment(shot.start)))
"""

_READING = """
from numba.core.dispatcher import Dispatcher
from renderer.preparation_kernels import prepare
from renderer.scene.readers.obj_lines import parse
from renderer.scene.readers.threemf_rows import cut_out

prepare()
compile = Dispatcher.compile
Dispatcher.compile = lambda self, types: (print(self.py_func.__name__), compile(self, types))[1]
assert parse(b"v 0 0 0\\nv 1 0 0\\nv 0 1 0\\nf 1 2 3\\n", "a.obj")
assert cut_out(b'<triangles><triangle v1="0" v2="1" v3="2" /></triangles>')[1]
"""


@pytest.mark.long
def test_parsers_of_text_files_need_no_compilation() -> None:
    done = subprocess.run([sys.executable, "-c", _READING], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == ""


@pytest.mark.long
@pytest.mark.parametrize("name", ["cornell-box.yaml", "spheres.yaml", "smallpt.yaml"])
def test_first_scene_needs_no_compilation(name: str) -> None:
    command = [sys.executable, "-c", _PROGRAM, str(ROOT / "scenes"), name]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == ""


@pytest.mark.parametrize("has_full", [True, False])
def test_remaining_kernels_are_loaded_if_cached(monkeypatch: pytest.MonkeyPatch, has_full: bool) -> None:
    done: list[str] = []
    monkeypatch.setattr(jit, "is_cached", lambda name: has_full and name == kernel_name(variant=FULL))
    monkeypatch.setattr(render, "prepare", lambda: done.append("all"))
    load_preparing()
    assert done == ["all"] * has_full


@pytest.mark.parametrize(("variant", "prepares", "wanted"), [(PLAIN, True, ["first"]), (FULL, True, ["all"]), (PLAIN, False, [])])
def test_preparation_kernels_loaded_with_a_kernel(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, variant: str, prepares: bool, wanted: list[str]
) -> None:
    done: list[str] = []
    monkeypatch.setattr(jit, "cache_folder", lambda: tmp_path)  # the folder where that kernel would be listed
    monkeypatch.setattr(jit, "_ready", set())
    monkeypatch.setattr(render, "_render", lambda *_: None)
    monkeypatch.setattr(render, "load_preparing", lambda: None)
    monkeypatch.setattr(render, "prepare_first", lambda: done.append("first"))
    monkeypatch.setattr(render, "prepare", lambda: done.append("all"))
    with render.Helpers(variant, wanted=False) as nobody:
        warm_up(variant=variant, helpers=nobody, prepares=prepares)
    assert done == wanted
