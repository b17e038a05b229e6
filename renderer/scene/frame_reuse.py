"""A cache of the parts of a compiled scene that are reused from one frame of a shot to the next."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from renderer.scene.scene_equality import are_equal

__all__ = ["PartOffsets", "ShotCache"]

Made = TypeVar("Made")
Array = npt.NDArray[Any]

_SLACK = 8  # arrays whose end may grow get 1/8 spare rows, which take no memory until used


class _Entry(NamedTuple):
    token: object | None
    key: Any
    made: Any


class PartOffsets(NamedTuple):
    """The offsets at which a compiled scene's arrays are divided into parts.

    heads: for each part that the next frame may reuse, its name -> the objects it was computed from. Parts computed from
    identical objects have equal bytes.
    """

    vertex: tuple[int, ...]  # start of static, bodies and loose geometry, then the end
    triangle: tuple[int, ...]
    node: tuple[int, ...]  # start of the top tree, then as `vertex`
    packet: tuple[int, ...]  # as `vertex`: the top tree has none
    heads: dict[str, tuple[object, ...]]  # of the parts that may be reused by the next frame


class ShotCache:
    """A cache of the compiled parts of one shot. What it returns depends on the requested key only, not on earlier requests.

    Returned arrays are valid until the next frame is compiled, which overwrites their last rows in place.
    """

    def __init__(self) -> None:
        self._entries: dict[Hashable, _Entry] = {}
        self._buffers: dict[str, Array] = {}
        self._heads: dict[str, tuple[object, ...]] = {}
        self._used: set[Hashable] = set()
        self.cuts: PartOffsets | None = None  # of the last compiled frame
        self.lights_power = 0.0  # its lights' total power, without the environment

    def begin_frame(self) -> None:
        """Begins compiling a frame: drops entries that the last frame did not use."""
        self._entries = {slot: entry for slot, entry in self._entries.items() if slot in self._used}
        self._used = set()

    def get_or_make(self, slot: Hashable, key: Callable[[], Any], make: Callable[[], Made], token: object | None = None) -> Made:
        """Returns the value cached in `slot` if its key is equal, else the result of `make()`.

        token: if it is the same object as in the last call, the keys are taken as equal without comparing them. Callers must not
        modify the value.
        """
        self._used.add(slot)
        entry = self._entries.get(slot)
        if entry is not None and token is not None and entry.token is token:
            found: Made = entry.made
            return found
        wanted = key()
        if entry is not None and are_equal(entry.key, wanted):
            made: Made = entry.made
        else:
            self._entries.pop(slot, None)  # both need not fit into memory
            made = make()
        self._entries[slot] = _Entry(token, wanted, made)
        return made

    def is_unchanged(self, what: str, heads: tuple[object, ...]) -> bool:
        """Returns True if `heads` are the same as in the last call with the same `what`; stores them for the next call.

        what: name of the checked data. heads: the objects, compared by identity, and integers from which that data was computed.
        """
        known, self._heads[what] = self._heads.get(what), heads
        return known is not None and _hold_same_objects(known, heads)

    def array_for(
        self, name: str, length: int, shape: tuple[int, ...], dtype: Any, heads: tuple[object, ...]
    ) -> tuple[Array, bool]:
        """Returns (an array of `length` rows, reused from the last frame if possible; whether its first rows are still valid).

        name: identifies the array. shape: of one row. heads: the objects and integers from which the array's first rows are
        computed. The rows are valid if `heads` is unchanged since the last frame; otherwise the caller must fill them.
        """
        buffer = self._buffers.get(name)
        known = self._heads.get(name, ())
        is_there = _hold_same_objects(known, heads)
        if buffer is None or len(buffer) < length or buffer.shape[1:] != shape or not is_there:
            self._buffers.pop(name, None)
            buffer, is_there = np.zeros((length + length // _SLACK, *shape), dtype), False
            self._buffers[name], self._heads[name] = buffer, heads
        return buffer[:length], is_there


def _hold_same_objects(cached: tuple[object, ...], current: tuple[object, ...]) -> bool:
    """Returns True if both tuples contain the same objects (by identity) and equal numbers."""
    return len(cached) == len(current) and all(
        a is b or (isinstance(a, int) and isinstance(b, int) and a == b) for a, b in zip(cached, current, strict=True)
    )
