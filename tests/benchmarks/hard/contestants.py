"""The renderers that the benchmark of hard light compares, each with the strategies that it has for such light."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.benchmarks.hard.scenes import Kind
from tests.benchmarks.peers.surroundings import mitsuba_with_llvm, python_with_bpy, python_with_luxcore

__all__ = ["CONTESTANTS", "OFF", "ON", "Contestant"]

_ALL: tuple[Kind, ...] = ("path guiding", "caustics")
_CAUSTICS: tuple[Kind, ...] = ("caustics",)


@dataclass(frozen=True)
class Contestant:
    """A renderer with one strategy. program: its module in this package. kinds: of the scenes that it renders.

    python: returns the interpreter that runs the program; raises MissingPeerError if the renderer cannot be installed.
    """

    name: str
    title: str
    program: str
    method: str
    python: Callable[[], Path]
    kinds: tuple[Kind, ...] = _ALL
    is_ours: bool = False
    is_biased: bool = False


def _own_python() -> Path:
    return Path(sys.executable)


def _python_with_mitsuba() -> Path:
    mitsuba_with_llvm()
    return _own_python()


OFF = Contestant("off", "`off`", "rayfarm_peer", "off", _own_python, is_ours=True)
ON: dict[Kind, Contestant] = {
    "path guiding": Contestant(
        "guiding", "`guiding: on`", "rayfarm_peer", "guiding", _own_python, ("path guiding",), is_ours=True
    ),
    "caustics": Contestant("caustics", "`caustics: on`", "rayfarm_peer", "caustics", _own_python, _CAUSTICS, is_ours=True),
}

CONTESTANTS: dict[str, Contestant] = {
    contestant.name: contestant
    for contestant in (
        *ON.values(),
        OFF,
        Contestant("mitsuba", "Mitsuba, path", "mitsuba_peer", "path", _python_with_mitsuba),
        Contestant("cycles", "Cycles", "blender_peer", "plain", python_with_bpy),
        Contestant("cycles-guided", "Cycles with OpenPGL", "blender_peer", "guided", python_with_bpy),
        Contestant(
            "cycles-caustics",
            "Cycles, shadow caustics (biased)",
            "blender_peer",
            "caustics",
            python_with_bpy,
            _CAUSTICS,
            is_biased=True,
        ),
        Contestant("luxcore", "LuxCore, path", "luxcore_peer", "path", python_with_luxcore),
        Contestant("luxcore-bidir", "LuxCore, bidirectional", "luxcore_peer", "bidirectional", python_with_luxcore),
        Contestant(
            "luxcore-cache",
            "LuxCore, caustic cache (biased)",
            "luxcore_peer",
            "caustic cache",
            python_with_luxcore,
            _CAUSTICS,
            is_biased=True,
        ),
    )
}
