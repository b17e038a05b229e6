"""Kernels that the launcher of confined readers loads, as the worker's main process does."""

from __future__ import annotations

from renderer.render import warm_up

__all__ = ["load"]


def load() -> None:
    """Loads the plain kernel, and the kernels used to compile every scene; compiles them if they are not cached."""
    warm_up()
