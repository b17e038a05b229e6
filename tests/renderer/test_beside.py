"""What a second process compiles is what the first one asks for."""

from __future__ import annotations

from typing import Any

import pytest
from numba import njit, typeof
from numba.core import ir, types
from numba.core.compiler_machinery import FunctionPass, register_pass

from renderer import beside
from renderer.absent import Compiler
from renderer.arrays.edition import only
from renderer.arrays.scene import example
from renderer.kernel import accumulate
from renderer.reference import Reference
from renderer.render import _PICTURE, PLAIN, _render, warm_up
from renderer.settings import Tile
from renderer.typed_before import TypeOnce


class TypedError(Exception):
    """Ends a compilation when types are known."""


@register_pass(mutates_CFG=False, analysis_only=True)
class TellCalls(FunctionPass):
    """Which functions are called, and with what."""

    _name = "tell_calls"
    calls: frozenset[tuple[str, str]] = frozenset()

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        called = (
            (state.typemap[e.func.name], s) for e, s in state.calltypes.items() if isinstance(e, ir.Expr) and e.op == "call"
        )
        TellCalls.calls = frozenset((f.dispatcher.__name__, str(s.args)) for f, s in called if isinstance(f, types.Dispatcher))
        raise TypedError


class Typed(Compiler):
    def define_pipelines(self) -> list[Any]:
        (steps,) = super().define_pipelines()
        steps.add_pass_after(TellCalls, TypeOnce)
        steps.finalize()
        return [steps]


def calls_of(function: Any, arguments: tuple[types.Type, ...]) -> frozenset[tuple[str, str]]:
    fresh = njit(error_model="numpy", _nrt=False, no_cpython_wrapper=True, pipeline_class=Typed)(function.py_func)
    with pytest.raises(TypedError):
        fresh.compile(arguments)
    return TellCalls.calls


def test_what_is_compiled_beside_is_a_part_of_the_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    warm_up(edition=PLAIN)  # else all that is called would be compiled here
    asked: list[tuple[types.Type, ...]] = []
    made = set()

    class Stage:
        def __init__(self, name: str) -> None:
            self.name = name

        def compile(self, arguments: tuple[types.Type, ...]) -> None:
            made.add((self.name, str(arguments)))

    def asking(*arguments: Any) -> tuple[int, int]:
        asked.append(tuple(typeof(argument) for argument in arguments))
        return 0, 0

    monkeypatch.setattr(accumulate, "_render_pool", asking)
    for name in ("scatter", "choose_lamps"):
        monkeypatch.setattr(accumulate, name, Stage(name))
    monkeypatch.setattr(beside, "prepare", lambda: None)
    _render(only(example(), PLAIN), _PICTURE, Tile(0, 0, 0, 0), 0, 0)
    beside.main([PLAIN])
    (arguments,) = asked
    assert len(made) == 2
    assert made <= calls_of(accumulate._with_pool, (Reference(arguments[0]), *arguments[1:]))


def test_no_edition_is_what_prepares_scenes_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    monkeypatch.setattr(beside, "prepare", lambda: done.append("prepared"))
    beside.main([])
    assert done == ["prepared"]
