"""Resolves the page's request for a view to a compiled scene and render settings."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass, replace
from typing import Any

from protocol.contract import FrameInfo, PrepareFrames, home_camera
from renderer.errors import SettingsError
from renderer.frames import frame_key
from renderer.sentences import Sentence, with_full_stop
from renderer.settings import OPTIONAL, SETTINGS, RenderSettings, View
from renderer.work import DEFAULT_SIZE
from service.errors import Conflict, FarmError, Invalid
from service.intake.frame_view import requested_view
from service.intake.resolve import frame_settings, resolve
from service.models.jobs import JobIn
from service.store.models import Job, Scene

__all__ = [
    "MAX_PIXELS",
    "MAX_SAMPLES",
    "FrameRequest",
    "ViewRequest",
    "home_view",
    "move_view",
    "resolve_view",
    "shows_home",
    "view_hash",
]

MAX_PIXELS = 1 << 21  # the sums of a view are held in memory
MAX_SAMPLES = 256
MAX_SIDE = int(SETTINGS["width"].setting.high or 0)  # longest side of a picture in pixels, also of a slender home view
HOME_PIXELS = 1280 * 720
MAX_ASPECT_ERROR = 0.01  # relative: sizes are whole pixels
SHUTTER = tuple(name for name in OPTIONAL if name.startswith("shutter"))


@dataclass(frozen=True)
class FrameRequest:
    """Request for one frame of an animated scene."""

    key: int  # twice the frame number
    fps: float | None
    clip: str | None
    turntable: float | None
    camera: str | int | None
    view: dict[str, Any] | None
    shutter: dict[str, Any]
    auto: dict[str, Any]  # the camera that frames the scene at its first frame

    def message(self, scene: str, base: str, session: str, message: str) -> PrepareFrames:
        """Returns the message by which a worker prepares the frame.

        base: SHA-256 of the scene compiled at its first frame. session: the session's id. message: id of the message.
        """
        return PrepareFrames(
            *(message, session, scene, [self.key], base, self.auto, self.fps, self.clip, self.camera, self.view, self.turntable),
            shutter=self.shutter,
        )

    def cache_key(self, scene: str, base: str) -> str:
        """Returns the key of the frame in `FrameCache`; equal frames have equal keys. base: as for `message`."""
        return json.dumps([scene, base, asdict(self)], sort_keys=True)


@dataclass(frozen=True)
class ViewRequest:
    """A request for a view with its settings resolved."""

    id: int  # number chosen by the page
    upload: str  # id of the uploaded scene
    scene: str  # id of the scene to render, which differs if the light is replaced
    settings: RenderSettings
    samples: int
    compiled: dict[str, str]  # kind of worker -> SHA-256 of the scene compiled at its first frame
    job_request: dict[str, Any]
    noise: float | None = None  # relative noise at which a tile is complete before it has all samples
    frame_request: FrameRequest | None = None  # None: the scene's first frame
    has_alpha: bool = False  # whether a transparent background is shown as such
    draft_exposure: float | None = None  # in stops, of drafts; None: the page shows none
    is_home: bool = False  # whether it is the view that a page opens the scene with (`shows_home`)

    def settings_at_frame(self, info: FrameInfo) -> RenderSettings:
        """Returns the render settings for a prepared animation frame. Raises SettingsError if the frame's view is invalid."""
        return frame_settings(self.job_request, self.settings, info.view, info.defaults, info.views)


def resolve_view(
    id: int,
    request: dict[str, Any],
    scene: Scene,
    is_shot: bool,
    frame: float,
    has_alpha: bool = False,
    draft_exposure: float | None = None,
) -> ViewRequest:
    """Resolves a page's request for a view of a scene that is ready, with the requested lighting. Raises Conflict and Invalid.

    id: the number that the page has chosen. request: a job's request (service.models.jobs.JobIn) as JSON. is_shot: whether an
    animation frame is requested instead of a still at the scene's start. frame: the frame number. has_alpha: whether the page
    shows alpha. draft_exposure: as in ViewRequest.
    """
    if scene.status == "failed":
        raise Conflict(Sentence("scene-not-renderable", "The scene cannot be rendered: {error}", error=scene.error))
    job = Job(request=request, spp=1, noise=None, seconds=None, tile_size=64, shot=None)
    try:
        resolve(job, scene, MAX_PIXELS)
        settings = RenderSettings.from_json(job.settings or {})
        view = requested_view(request, frame)
    except SettingsError as error:
        raise Invalid(with_full_stop(error)) from None
    frame_request = None
    if is_shot or settings.shutter:
        cameras = (scene.info or {})["cameras"]
        frame_request = FrameRequest(
            frame_key(frame),
            **{name: request.get(name) for name in ("fps", "clip", "turntable", "camera")},
            view=view,
            shutter={name: request[name] for name in SHUTTER if request.get(name) is not None},
            auto=cameras[-1]["view"],
        )
    samples = min(request.get("spp") or MAX_SAMPLES, MAX_SAMPLES)
    compiled = {kind: str(ref["sha256"]) for kind, ref in scene.compiled.items()}
    upload, noise = scene.of or scene.id, request.get("noise")
    shown = has_alpha, draft_exposure
    return ViewRequest(id, upload, scene.id, settings, samples, compiled, request, noise, frame_request, *shown)


def home_view(scene: Scene, samples: int = MAX_SAMPLES) -> ViewRequest:
    """Returns the view that a page opens a ready scene with, of about HOME_PIXELS pixels and denoised.

    It has the scene's `home_camera`, its own light, and the settings of its file. Raises Conflict and Invalid.
    """
    defaults: dict[str, Any] = (scene.info or {}).get("defaults") or {}
    width, height = (int(defaults.get(name) or usual) for name, usual in zip(("width", "height"), DEFAULT_SIZE, strict=True))
    scale = min(math.sqrt(HOME_PIXELS / (width * height)), MAX_SIDE / max(width, height))
    size = {"width": max(1, round(width * scale)), "height": max(1, round(height * scale))}
    cameras: list[dict[str, Any]] = (scene.info or {}).get("cameras") or []
    camera = {"camera": home_camera(cameras)} if cameras else {}
    request = JobIn.model_validate({"scene": scene.id, "spp": samples, "denoise": True, **camera, **size})
    view = resolve_view(0, request.model_dump(mode="json"), scene, is_shot=False, frame=0.0)
    return replace(view, is_home=True)


def shows_home(view: ViewRequest, scene: Scene) -> bool:
    """Returns True if a view of a ready scene differs from `home_view` in size, samples and noise at most.

    Returns False for a transparent background.
    """
    shown = view.settings
    cameras: list[dict[str, Any]] = (scene.info or {}).get("cameras") or []
    if (
        scene.of is not None
        or shown.is_transparent
        or not cameras
        or shown.view != View.from_json(cameras[home_camera(cameras)]["view"])
    ):
        return False  # as for most requests, while the camera turns
    try:
        own = home_view(scene)
    except FarmError:
        return False
    home = own.settings
    error = shown.width * home.height / (shown.height * home.width) - 1.0
    is_same = _what_is_seen(shown) == _what_is_seen(home) and _frame(view) == _frame(own)
    return is_same and abs(error) <= MAX_ASPECT_ERROR + 1.0 / min(shown.width, shown.height)


def view_hash(view: ViewRequest) -> str:
    """Returns a hash of what a view shows, which its size, samples and noise do not change.

    Equal for a scene's `home_view` and all views for which `shows_home` is true.
    """
    frame = _frame(view)
    seen = [_what_is_seen(view.settings).to_json(), asdict(frame) if frame else None]
    return hashlib.sha256(json.dumps(seen, sort_keys=True).encode()).hexdigest()[:16]


def _what_is_seen(settings: RenderSettings) -> RenderSettings:
    return replace(settings, width=1, height=1, light_groups="", light_paths="off", cryptomatte=0, deep=0)


def _frame(view: ViewRequest) -> FrameRequest | None:
    """Returns the frame of a view without its camera, which the settings have."""
    return None if view.frame_request is None else replace(view.frame_request, camera=None, view=None)


def move_view(request: ViewRequest, id: int, view: dict[str, Any]) -> ViewRequest:
    """Returns a request with another camera, as `resolve_view` would, in a tenth of its time. Raises Invalid.

    request: its camera was given by `view`, not by a name. id: number that the page has chosen. view: the new camera as JSON.
    """
    camera = View.from_json({name: value for name, value in view.items() if value is not None})
    try:
        settings = replace(request.settings, view=camera)
    except SettingsError as error:
        raise Invalid(with_full_stop(error)) from None
    frame_request = request.frame_request and replace(request.frame_request, view=view)
    job_request = {**request.job_request, "view": view}
    return replace(request, is_home=False, id=id, settings=settings, job_request=job_request, frame_request=frame_request)
