"""Tests of parallel compilation: several processes compile exactly the functions that a kernel needs, each once."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from pathlib import Path
from typing import Any

import psutil
import pytest
from numba import typeof
from numba.core import ir, types
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.typed_passes import NopythonTypeInference

from renderer import parallel_compile
from renderer.arrays.kernel_variant import strip_absent_features
from renderer.arrays.scene import example
from renderer.kernel import accumulate
from renderer.kernel.backends.cpu.intersect import trace_shadow_rays
from renderer.kernel.backends.cpu.scattering import scatter_vertices
from renderer.parallel_compile import Helpers
from renderer.prune_absent_features import Compiler
from renderer.render import _PICTURE, FULL, PLAIN, _render, warm_up
from renderer.settings import Tile
from renderer.target import KernelDispatcher


class TypedError(Exception):
    """Raised after type inference, to stop a compilation there."""


@register_pass(mutates_CFG=False, analysis_only=True)
class RecordCalls(FunctionPass):
    """A compiler pass that records the called functions and their argument types."""

    _name = "tell_calls"
    calls: frozenset[tuple[str, str]] = frozenset()

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        called = (
            (state.typemap[e.func.name], s) for e, s in state.calltypes.items() if isinstance(e, ir.Expr) and e.op == "call"
        )
        RecordCalls.calls = frozenset((f.dispatcher.__name__, str(s.args)) for f, s in called if isinstance(f, types.Dispatcher))
        raise TypedError


class Typed(Compiler):
    def define_pipelines(self) -> list[Any]:
        (steps,) = super().define_pipelines()
        steps.add_pass_after(RecordCalls, NopythonTypeInference)
        steps.finalize()
        return [steps]


def calls_of(function: Any, arguments: tuple[types.Type, ...]) -> frozenset[tuple[str, str]]:
    options = {"nopython": True, "error_model": "numpy", "_nrt": False, "no_cpython_wrapper": True}
    fresh = KernelDispatcher(function.py_func, targetoptions=options, pipeline_class=Typed)
    with pytest.raises(TypedError):
        fresh.compile(arguments)
    return RecordCalls.calls


@pytest.mark.long
@pytest.mark.parametrize("variant", [PLAIN, pytest.param(FULL, marks=pytest.mark.long)])
def test_shared_parts_belong_to_the_kernel(monkeypatch: pytest.MonkeyPatch, variant: str) -> None:
    warm_up(variant=variant)  # otherwise all called functions would be compiled here
    asked: list[tuple[types.Type, ...]] = []

    def asking(*arguments: Any) -> tuple[int, int]:
        asked.append(tuple(typeof(argument) for argument in arguments))
        return 0, 0

    monkeypatch.setattr(accumulate, "_render_pool", asking)
    _render(strip_absent_features(example(), variant), _PICTURE, Tile(0, 0, 0, 0), 0, 0)
    (arguments,) = asked
    parts = accumulate.pool_stages(strip_absent_features(example(), variant), _PICTURE)
    called = calls_of(accumulate._with_pool, arguments)
    for part, types_of_it in parts:
        if part.__name__ == "arrive":
            wanted = (*types_of_it, types.boolean)  # the types already compiled, and one more
            assert {s for name, s in called if name == "scatter_vertices"} == {str(wanted)}, (
                "else it is compiled once more for each"
            )
            called |= calls_of(scatter_vertices, wanted)
        if part.__name__ == "trace_shadow_rays":
            called |= calls_of(trace_shadow_rays, types_of_it)
    assert {(part.__name__, str(types_of_it)) for part, types_of_it in parts} <= called
    assert len(parts) > 8


class Part:
    """A compilable part that records the process that compiles it."""

    def __init__(self, folder: Path, number: int) -> None:
        self.path = folder / str(number)

    def compile(self, arguments: Any) -> None:
        time.sleep(0.02)  # lets the other processes take parts
        with self.path.open("a") as file:
            file.write(f"{os.getpid()}\n")


class Deadly(Part):
    """A compilable part that kills the process that compiles it, except the test's own process."""

    def compile(self, arguments: Any) -> None:
        if os.getppid() == arguments[0]:
            os.kill(os.getpid(), signal.SIGKILL)
        super().compile(arguments)


@pytest.fixture
def parts(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, tuple[int]]]:
    """Returns an empty list, to which a test adds the parts that this process and one helper process compile; nothing else is."""
    found: list[tuple[Any, tuple[int]]] = []
    monkeypatch.setattr(parallel_compile, "pool_stages", lambda *_: found)
    monkeypatch.setattr(parallel_compile, "_number_of_helpers", lambda: 1)
    monkeypatch.setattr(parallel_compile, "is_prepared", lambda: True)
    monkeypatch.setattr(threading, "active_count", lambda: 1)
    return found


def test_each_part_is_compiled_by_one_process(parts: list[tuple[Any, tuple[int]]], tmp_path: Path) -> None:
    parts += [(Part(tmp_path, number), (os.getpid(),)) for number in range(20)]
    with Helpers(PLAIN) as helpers:
        helpers.share()
        done = [(tmp_path / str(number)).read_text().split() for number in range(20)]
        helpers.finish()
    assert all(len(by) == 1 for by in done)
    assert len({by[0] for by in done}) == 2


def test_killed_helper_is_not_awaited(parts: list[tuple[Any, tuple[int]]], tmp_path: Path) -> None:
    parts += [(Deadly(tmp_path, number), (os.getpid(),)) for number in range(20)]
    with Helpers(PLAIN) as helpers:
        helpers.share()
        helpers.finish()
    missing = [number for number in range(20) if not (tmp_path / str(number)).exists()]
    assert len(missing) <= 1, "what it was at is compiled with the kernel, the rest by who is left"


def test_helpers_end_without_work_or_after_an_error(
    parts: list[tuple[Any, tuple[int]]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parallel_compile, "prepare_first", lambda: (tmp_path / "prepared").touch())
    monkeypatch.setattr(parallel_compile, "is_prepared", lambda: False)
    with Helpers(PLAIN) as helpers:
        (child,) = helpers._forked
        helpers.finish()
    assert not psutil.pid_exists(child)
    assert not (tmp_path / "prepared").exists()
    with pytest.raises(ZeroDivisionError), Helpers(PLAIN) as helpers:
        (child,) = helpers._forked
        _ = 1 / 0
    assert not psutil.pid_exists(child)


def test_helper_is_spawned_beside_other_threads(
    parts: list[tuple[Any, tuple[int]]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[list[str]] = []
    popen = subprocess.Popen

    def start(command: list[str], **options: Any) -> subprocess.Popen[bytes]:
        started.append(command)
        return popen(["true"], **options)

    monkeypatch.setattr(threading, "active_count", lambda: 2)
    monkeypatch.setattr(subprocess, "Popen", start)
    parts += [(Part(tmp_path, 0), ())]
    with Helpers(PLAIN) as helpers:
        assert started == [], "nobody knows yet whether there is anything to do"
        helpers.share()
    assert [command[1:4] for command in started] == [["-m", "renderer.parallel_compile", PLAIN]]
    assert (tmp_path / "0").exists()


def test_number_of_helpers_by_cores_and_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel_compile, "cores", lambda: 16)
    monkeypatch.setattr(parallel_compile, "_free_memory", lambda: 64 << 30)
    assert parallel_compile._number_of_helpers() == parallel_compile.MOST
    monkeypatch.setattr(parallel_compile, "_free_memory", lambda: parallel_compile.NEEDS)
    assert parallel_compile._number_of_helpers() == 1
    monkeypatch.setattr(parallel_compile, "_free_memory", lambda: parallel_compile.NEEDS - 1)
    assert parallel_compile._number_of_helpers() == 0
    monkeypatch.setattr(parallel_compile, "_free_memory", lambda: 64 << 30)
    monkeypatch.setattr(parallel_compile, "cores", lambda: 1)
    assert parallel_compile._number_of_helpers() == 0
    with Helpers(PLAIN) as helpers:
        helpers.share()  # without helpers this process compiles everything with the kernel
        helpers.finish()
