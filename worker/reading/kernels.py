"""Loads the kernels that confined readers use. The launcher of the readers loads them once, before it forks."""

from __future__ import annotations

from renderer.render import warm_up

__all__ = ["load"]


def load() -> None:
    """Loads the plain kernel, and the kernels used to compile every scene; compiles them if they are not cached."""
    warm_up()
