"""Frames that were prepared for views, kept as long as somebody looks at their scene; then their compiled scenes are deleted."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable
from dataclasses import asdict

from service.store.models import blobs_of
from worker.protocol.contract import FrameInfo

__all__ = ["Moments"]

MOST = 48  # a hand that goes to and fro over the frames finds them


class Moments:
    """By names that say all that a frame depends on. Lives in the desk's thread."""

    def __init__(self, let_go: Callable[[Counter[str]], None]) -> None:
        self._let_go = let_go
        self._infos: OrderedDict[str, tuple[str, FrameInfo]] = OrderedDict()  # with their scenes

    def get(self, name: str) -> FrameInfo | None:
        """What is known of a frame."""
        if name not in self._infos:
            return None
        self._infos.move_to_end(name)
        return self._infos[name][1]

    def put(self, name: str, scene: str, info: FrameInfo) -> None:
        """A frame is prepared; where there are too many, the one that was looked at longest ago goes."""
        earlier = self._infos.pop(name, None)
        self._infos[name] = scene, info
        gone = [earlier[1]] if earlier else []
        if len(self._infos) > MOST:
            gone.append(self._infos.popitem(last=False)[1][1])
        self.let_go(*gone)

    def keep(self, scenes: set[str]) -> None:
        """Let go of the frames of all other scenes."""
        names = [name for name, (scene, _) in self._infos.items() if scene not in scenes]
        self.let_go(*[self._infos.pop(name)[1] for name in names])

    def forget(self) -> None:
        """Have all of them prepared anew."""
        self.keep(set())

    def let_go(self, *infos: FrameInfo) -> None:
        """Of what was compiled for frames, but for what those that are kept share."""
        gone = Counter[str]()
        for info in infos:
            gone.update(_blobs(info))
        for _, info in self._infos.values():
            for sha256 in _blobs(info):
                del gone[sha256]
        if gone:
            self._let_go(gone)


def _blobs(info: FrameInfo) -> set[str]:
    return blobs_of([asdict(info.compiled)]) if info.compiled else set()
