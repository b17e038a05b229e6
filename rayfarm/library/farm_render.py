"""Renders a scene on a farm, for `render` and `progressive`. Yields intermediate pictures."""

from __future__ import annotations

import contextlib
import tempfile
import time
import warnings
from collections.abc import Generator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rayfarm import options
from rayfarm.library.arguments import RenderArguments
from rayfarm.library.image import F32, Image
from rayfarm.library.local_render import SceneWarning
from rayfarm.scene_files import files_to_upload
from renderer import aovs
from renderer.errors import SettingsError
from renderer.frames import frame_text
from renderer.scene.animation import Moment
from renderer.settings import light_planes

if TYPE_CHECKING:
    from rayfarm.client import Client
    from rayfarm.responses import Job, Scene

__all__ = ["images", "job_request", "submit_ready_scene", "upload_and_submit"]

POLL_S = 0.3
_COLOR = ("R", "G", "B")


def upload_and_submit(farm: Client, scene: Path, arguments: RenderArguments) -> Job:
    """Uploads the scene and submits a job. Raises ClientError, or SettingsError for settings that a farm does not support."""
    uploaded = farm.upload(files_to_upload(scene), **arguments.picture.placement()._asdict())
    return submit_ready_scene(farm, farm.wait_for_scene(uploaded.id), arguments)


def submit_ready_scene(farm: Client, ready: Scene, arguments: RenderArguments) -> Job:
    """Submits a job for a scene that is ready on the farm. Raises as `upload_and_submit` does."""
    return farm.submit(ready.id, **job_request(farm, ready, arguments))


def job_request(farm: Client, ready: Scene, arguments: RenderArguments) -> dict[str, Any]:
    """Returns the body of a job's request, after uploading its environment. Raises as `upload_and_submit` does."""
    if arguments.threads is not None:
        raise SettingsError("threads are this machine's; a farm's workers have slots of their own")
    light = arguments.picture.environment()
    for warning in options.relevant_warnings(ready.warnings, light):
        warnings.warn(warning, SceneWarning, stacklevel=2)
    request = arguments.picture.request([asdict(camera) for camera in ready.cameras])
    if light.image is not None:
        request.setdefault("environment", {})["image"] = farm.upload_environment(light.image).id
    moment = arguments.moment
    if moment != Moment():
        asked = {"frames": frame_text(moment.frame), "fps": moment.fps, "clip": moment.clip}
        request |= {name: value for name, value in asked.items() if value is not None}
    if arguments.variant is not None:
        request["variant"] = arguments.variant
    return request


def images(farm: Client, job: str, arguments: RenderArguments, at_once: bool = False) -> Generator[Image]:
    """Yields the job's picture whenever it has new samples; the last one is final. Raises ClientError.

    at_once: yields only the final one. Closing the iterator early does not affect the job.
    """
    from rayfarm.client import ClientError

    seen = -1
    while True:
        found = farm.job(job)
        if found.state in ("failed", "cancelled"):
            raise ClientError(f"The job {job} {'failed: ' + (found.error or '') if found.state == 'failed' else 'was cancelled'}")
        is_final = found.state == "finished"
        if is_final or (not at_once and found.samples > max(seen, 0)):
            seen = found.samples
            yield _fetch_image(farm, found, arguments, is_final)
        if is_final:
            return
        time.sleep(POLL_S)


def _fetch_image(farm: Client, job: Job, arguments: RenderArguments, is_final: bool) -> Image:
    frame = job.frames[0] if job.frames else None
    settings = job.settings or {}
    groups = light_planes(str(settings.get("light_groups") or ""), str(settings.get("light_paths") or ""))
    is_transparent = (job.settings or {}).get("background") == "transparent"
    layers = aovs.parse_names(arguments.aovs, groups, is_transparent=is_transparent)
    planes = [name for name in layers if name not in ("color", aovs.MOTION)]
    extra = [aovs.MOTION] if aovs.MOTION in arguments.aovs and is_final else []
    number = frame.number if frame is not None else 0
    channels = _channels(farm.image(job.id, "exr", number, aov=",".join(["color", *planes, *extra])))
    names = ["color", *planes, *extra]
    if arguments.denoise and is_final:
        clean = _channels(farm.image(job.id, "exr", number, denoise=True))
        channels |= {f"denoised.{name}": clean[name] for name in _COLOR}
        names.append("denoised")

    def values(name: str) -> F32:
        if name in ("color", "denoised"):
            parts = [channels[each if name == "color" else f"denoised.{each}"] for each in _COLOR]
        else:
            parts = [channels[each] for each in aovs.channels(name)]
        return parts[0] if len(parts) == 1 else np.stack(parts, axis=-1)

    spp = frame.spp if frame is not None else 0.0
    return Image(names, values, spp, job.spp, frame.noise if frame is not None else None, is_final)


def _channels(exr: bytes) -> dict[str, F32]:
    """Returns the channels of an EXR file by name, each (h, w) float32."""
    import OpenImageIO as oiio  # noqa: N813

    with tempfile.NamedTemporaryFile(suffix=".exr") as file, contextlib.ExitStack() as stack:
        file.write(exr)
        file.flush()
        source = oiio.ImageInput.open(file.name)
        if source is None:
            raise SettingsError("what the farm sent is not an EXR picture")
        stack.callback(source.close)
        pixels = np.asarray(source.read_image(oiio.FLOAT), np.float32)
        return {name: pixels[..., i] for i, name in enumerate(source.spec().channelnames)}
