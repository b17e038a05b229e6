"""Cache of compiled animation frames for live views. When no session shows a scene any more, its frames are deleted."""

from __future__ import annotations

from collections import Counter, OrderedDict
from dataclasses import asdict

from protocol.contract import FrameInfo
from service.events import BlobsReleased, Events
from service.store.models import blobs_of

__all__ = ["FrameCache"]

MAX_FRAMES = 48  # enough for scrubbing to and fro


class FrameCache:
    """LRU cache of frames. The parameter `name` is always the key from FrameRequest.cache_key.

    Used in the scheduler's thread only.
    """

    def __init__(self, events: Events) -> None:
        self._events = events
        self._infos: OrderedDict[str, tuple[str, FrameInfo]] = OrderedDict()  # (scene, frame) by cache key

    def get(self, name: str) -> FrameInfo | None:
        """Returns a cached frame and marks it as used; None if it is not cached."""
        if name not in self._infos:
            return None
        self._infos.move_to_end(name)
        return self._infos[name][1]

    def put(self, name: str, scene: str, info: FrameInfo) -> None:
        """Adds a frame of a scene. If there are more than MAX_FRAMES frames, evicts the least recently used one."""
        earlier = self._infos.pop(name, None)
        self._infos[name] = scene, info
        gone = [earlier[1]] if earlier else []
        if len(self._infos) > MAX_FRAMES:
            gone.append(self._infos.popitem(last=False)[1][1])
        self.delete_unused_blobs(*gone)

    def keep_only(self, scenes: set[str]) -> None:
        """Evicts the frames of all scenes that are not in `scenes`."""
        names = [name for name, (scene, _) in self._infos.items() if scene not in scenes]
        self.delete_unused_blobs(*[self._infos.pop(name)[1] for name in names])

    def clear(self) -> None:
        """Evicts all frames, so that workers prepare them again."""
        self.keep_only(set())

    def delete_unused_blobs(self, *infos: FrameInfo) -> None:
        """Deletes the blobs of evicted frames, except those that cached frames still refer to."""
        gone = Counter[str]()
        for info in infos:
            gone.update(_blobs(info))
        for _, info in self._infos.values():
            for sha256 in _blobs(info):
                del gone[sha256]
        if gone:
            self._events.publish(BlobsReleased(gone))


def _blobs(info: FrameInfo) -> set[str]:
    return blobs_of([asdict(info.compiled)]) if info.compiled else set()
