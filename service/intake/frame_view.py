"""The camera that a request gives for a frame: `view` for all frames, or one of `views` for each."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from renderer.errors import SettingsError
from renderer.frames import frame_key, frame_text, parse_frames
from renderer.sentences import Sentence

__all__ = ["requested_view"]


def requested_view(request: dict[str, Any], frame: float) -> dict[str, Any] | None:
    """Returns the view of a frame as JSON; None if the request leaves it to the scene's cameras.

    `views` belong to the frames of the request in ascending order. Raises SettingsError for a frame that is not among them, as of
    a shot that was extended.
    """
    views: list[dict[str, Any]] | None = request.get("views")
    if views is None:
        return request.get("view")
    single = request.get("frame")
    index = {frame_key(single): 0} if single is not None else _index_by_key(str(request.get("frames")))
    number = index.get(frame_key(frame))
    if number is None or number >= len(views):
        raise SettingsError(
            Sentence("frame-without-view", "views has no view for frame {frame}; add one", frame=frame_text(frame)), field="views"
        )
    return views[number]


@lru_cache(8)  # each frame of a job looks its view up
def _index_by_key(frames: str) -> dict[int, int]:
    return {key: index for index, key in enumerate(sorted(map(frame_key, parse_frames(frames))))}
