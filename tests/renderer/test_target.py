"""Tests of the kernels' own compile target: a host program's Numba is unchanged before and after rendering."""

from __future__ import annotations

import json
import operator
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit
from numba.core import config
from numba.core.registry import cpu_target

from renderer import cpu, jit
from renderer.bvh.simd import f32x8
from renderer.target import KernelDispatcher
from tests.helpers import ROOT

SCENE = ROOT / "scenes" / "cornell-box.yaml"
# A host program's function: a sum with a product that could be fused, a vectorisable loop, a reference-counted array.
HOST = """
import math
from numba import njit

@njit(cache=True)
def total(values, factor):
    found = values * factor
    result = 0.0
    for i in range(len(found)):
        result += math.sqrt(found[i]) * factor + 1.0
    return result
"""

# A kernel that no cache contains; rendering a picture loads only cached kernels.
COLD = """
from renderer import jit

@jit.entry
def fused(a, b, c):
    return a * b + c
"""

# Prints what a process compiles of HOST; with `render`, before and after rendering a picture and compiling a kernel.
PROGRAM = """
import json, os, re, sys

import numpy as np

order = sys.argv[1]

def render():
    import rayfarm
    rayfarm.render(sys.argv[2], width=8, height=8, spp=1)
    import cold
    assert cold.fused(2.0, 3.0, 1.0) == 7.0 and not cold.fused.stats.cache_hits

def compiled():
    from numba import njit
    import host
    fresh = njit(host.total.py_func)  # compiled, not loaded
    fresh(np.arange(64.0), 2.0)
    (listing,) = fresh.inspect_asm().values()
    # without numbers of this process's functions and objects, and the sizes of names with them
    return re.sub(r"0x[0-9a-f]+|v\\d+B|B\\d+v\\d+|\\d{10,}|\t.size\t.*", "", listing)

def state():
    from numba.core import config
    found = {"config": {name: repr(getattr(config, name)) for name in dir(config) if name.isupper()}}
    found["environment"] = dict(os.environ)
    return found

def held():
    kept = {}
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] in ("numba", "llvmlite"):
            for key, value in list(vars(module).items()):
                if callable(value):
                    kept[name, key] = value
                if isinstance(value, type) and value.__module__ == name:
                    kept.update({(name, key, each): what for each, what in list(vars(value).items()) if callable(what)
                                 or isinstance(what, (property, classmethod, staticmethod))})
    return kept

if order == "first":
    render()
answer = {"code": [compiled()]}
if order == "between":
    import gc
    import llvmlite.binding as llvm
    known, before, finders, garbage = held(), state(), list(sys.meta_path), gc.get_threshold()
    render()
    now = held()
    answer["replaced"] = sorted(".".join(key) for key, value in known.items() if now.get(key) is not value)
    answer["same"] = [state() == before, sys.meta_path == finders, gc.get_threshold() == garbage]
    answer["code"].append(compiled())
import host
host.total(np.arange(64.0), 2.0)
answer["cache"] = host.total.stats.cache_path
print(json.dumps(answer))
"""


@pytest.fixture
def answer(tmp_path: Path) -> Any:
    """Returns a function that runs the program and returns its output."""
    (tmp_path / "host.py").write_text(HOST)
    (tmp_path / "cold.py").write_text(COLD)

    def run(order: str) -> Any:
        path = os.pathsep.join([str(tmp_path), str(ROOT)])
        environment = {**os.environ, "PYTHONPATH": path, "PYTHONHASHSEED": "0"}
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, order, str(SCENE)], cwd=tmp_path, env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


def test_host_programs_numba_is_unchanged(answer: Any, tmp_path: Path) -> None:
    between = answer("between")
    assert between["replaced"] == []
    assert between["same"] == [True, True, True]
    before, after = between["code"]  # the process has imported nothing of the renderer when it compiles first
    assert before == after
    assert Path(between["cache"]) == tmp_path / "__pycache__"


@pytest.mark.long
def test_rendering_first_does_not_change_host_code(answer: Any) -> None:
    assert answer("first")["code"] == answer("alone")["code"]


def test_process_options_do_not_affect_kernels() -> None:
    context = KernelDispatcher.targetdescr.target_context
    assert context.codegen().magic_tuple()[1:] == (cpu.NAME, cpu.FEATURES)
    assert context.codegen() is not cpu_target.target_context.codegen()
    assert getattr(config, "CPU_NAME") is None  # noqa: B009 - which Numba sets when it is loaded
    assert not context.enable_boundscheck


def test_signatures_are_cached() -> None:
    context = KernelDispatcher.targetdescr.typing_context
    context.refresh()
    first = context.resolve_function_type(operator.add, (f32x8, f32x8), {})
    assert first is not None
    assert context.resolve_function_type(operator.add, (f32x8, f32x8), {}) is first


def test_kernels_call_numbas_own_overloads() -> None:
    """Numba's own overloads that kernels call are compiled for the kernels' target."""

    @jit.builder
    def summed(values: Any) -> Any:
        return values.copy().sum()

    assert summed(np.arange(4.0)) == 6.0
    assert njit(lambda values: values.sum())(np.arange(4.0)) == 6.0


KERNELS = """
import sys
import numpy as np
from renderer import jit

@jit.builder
def spread(values, factor):
    found = np.empty(2 * len(values))
    for i in range(len(found)):
        found[i] = np.sin(values[i // 2]) * factor
    return found

@jit.builder
def added(values):
    return values + 1.0

print(spread(np.arange(3.0), 2.0).tolist(), "numba.np.linalg" in sys.modules)
if len(sys.argv) > 1:  # another kernel must be compiled after one was loaded
    print(added(np.arange(3.0)).tolist(), "numba.np.linalg" in sys.modules)
"""


@pytest.mark.long
def test_loading_a_kernel_needs_none_of_numbas_declarations(tmp_path: Path) -> None:
    """Loading a compiled kernel does not import Numba's declarations, which take three quarters of a worker's loading time."""
    program = tmp_path / "kernels.py"
    program.write_text(KERNELS)
    environment = {**os.environ, "RAYFARM_CACHE": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}

    def run(*arguments: str) -> list[str]:
        return subprocess.check_output([sys.executable, str(program), *arguments], env=environment, text=True).splitlines()

    (compiled,) = run()
    values, has_declarations = compiled.rsplit(" ", 1)
    assert has_declarations == "True"
    assert run() == [f"{values} False"]
    assert run("more") == [f"{values} False", "[1.0, 2.0, 3.0] True"]
