"""From what a page asks to see to what is rendered: the compiled scene and the settings of a view."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

from renderer.errors import SettingsError
from renderer.frames import frame_key
from renderer.settings import OPTIONAL, RenderSettings
from service.errors import Conflict, Invalid
from service.intake.resolve import frame_settings, resolve
from service.store.models import Job, Scene
from worker.protocol.contract import FrameInfo, PrepareFrames

__all__ = ["MOST_PIXELS", "MOST_SAMPLES", "Look", "Moment", "look_at"]

MOST_PIXELS = 1 << 21  # the sums of a view lie in memory
MOST_SAMPLES = 256
SHUTTER = tuple(name for name in OPTIONAL if name.startswith("shutter"))


@dataclass(frozen=True)
class Moment:
    """A frame of a scene that moves, as a view shows it."""

    key: int  # in halves
    fps: float | None
    clip: str | None
    turntable: float | None
    camera: str | int | None
    view: dict[str, Any] | None
    shutter: dict[str, Any]
    auto: dict[str, Any]  # the view that frames the scene at its beginning

    def work(self, scene: str, base: str, watch: str, message: str) -> PrepareFrames:
        """The wish to have it prepared. base: what the scene is compiled to at its beginning."""
        return PrepareFrames(
            *(message, watch, scene, [self.key], base, self.auto, self.fps, self.clip, self.camera, self.view, self.turntable),
            shutter=self.shutter,
        )

    def name(self, scene: str, base: str) -> str:
        """The same for whoever asks for the same."""
        return json.dumps([scene, base, asdict(self)], sort_keys=True)


@dataclass(frozen=True)
class Look:
    """A view, settled."""

    id: int  # as the page named it
    upload: str  # the scene's id for people
    scene: str  # that of what is rendered: the same under another light is another
    settings: RenderSettings
    samples: int
    compiled: dict[str, str]  # kind of worker -> SHA-256 of the scene compiled for it, as it is at its beginning
    request: dict[str, Any]
    noise: float | None = None  # relative, at which it is done before it has all samples
    moment: Moment | None = None  # None: as the scene is at its beginning

    def at(self, info: FrameInfo) -> RenderSettings:
        """The settings at its moment. Raises SettingsError."""
        return frame_settings(self.request, self.settings, info.view, info.defaults, info.views)


def look_at(id: int, request: dict[str, Any], scene: Scene, is_shot: bool, frame: float) -> Look:
    """What a request means for a scene that is ready, and lit as the request wants it. Raises Conflict and Invalid.

    request: a job's (service.api.schemas.JobIn), as JSON. is_shot: whether it is more than a still of the scene's beginning.
    """
    if scene.status == "failed":
        raise Conflict(f"The scene cannot be rendered: {scene.error}")
    job = Job(request=request, spp=1, noise=None, seconds=None, tile_size=64, shot=None)
    try:
        resolve(job, scene, MOST_PIXELS)
        settings = RenderSettings.from_json(job.settings or {})
    except SettingsError as error:
        raise Invalid(f"{error}.") from None
    moment = None
    if is_shot or settings.shutter:
        cameras = (scene.info or {})["cameras"]
        moment = Moment(
            frame_key(frame),
            **{name: request.get(name) for name in ("fps", "clip", "turntable", "camera", "view")},
            shutter={name: request[name] for name in SHUTTER if request.get(name) is not None},
            auto=cameras[-1]["view"],
        )
    samples = min(request.get("spp") or MOST_SAMPLES, MOST_SAMPLES)
    compiled = {kind: str(ref["sha256"]) for kind, ref in scene.compiled.items()}
    return Look(id, scene.of or scene.id, scene.id, settings, samples, compiled, request, request.get("noise"), moment)
