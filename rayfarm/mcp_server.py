"""Server of the Model Context Protocol for a farm: its scenes, jobs and pictures as tools of an assistant.

Tools call the farm's REST API through a Client, so they may do what its token may do. Needs the package mcp
(pip install "rayfarm[mcp]").
"""

from __future__ import annotations

import functools
import inspect
import io
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, TypeVar

import anyio
from anyio.to_thread import run_sync
from mcp.server.mcpserver import Context, Image, MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.types import ToolAnnotations
from PIL import Image as Pillow
from pydantic import Field

from rayfarm.client import Client
from rayfarm.errors import CommandError
from rayfarm.responses import Job, Scene
from rayfarm.scene_files import files_to_upload
from renderer import __version__
from renderer.errors import RayfarmError
from renderer.frames import frame_text

__all__ = ["create_server"]

T = TypeVar("T")

POLL_S = 0.5
MAX_WIDTH = 2048
MAX_WAIT_S = 3600.0
INSTRUCTIONS = (
    "Renders 3D scenes on the render farm at {url}. A scene is uploaded (or found by list_scenes), a job renders it, and "
    "get_picture shows its picture, also while it is rendered. Scenes and jobs are named by their ids. Begin with a small "
    "size and few samples per pixel (spp); the time grows with width x height x spp."
)

SceneId = Annotated[str, Field(description="The scene's id.")]
JobId = Annotated[str, Field(description="The job's id.")]
Limit = Annotated[int, Field(ge=1, le=100, description="The largest number of rows.")]
Search = Annotated[str, Field(description="Words of the name, or the beginning of the id; all if empty.")]
Wait = Annotated[float, Field(ge=0, le=MAX_WAIT_S, description="Seconds to wait before the present state is returned.")]


def create_server(farm: Client, folders: Sequence[Path] = ()) -> MCPServer[Any]:
    """Returns the server of a farm.

    folders: those whose scenes may be uploaded. Without one there is no tool for uploads, since a tool that reads any file of
    the user would be at the disposal of whatever text an assistant reads.
    """
    server: MCPServer[Any] = MCPServer(
        "rayfarm", title="Rayfarm", instructions=INSTRUCTIONS.format(url=farm.url), version=__version__, log_level="WARNING"
    )
    tools = _Tools(farm, [folder.resolve() for folder in folders])
    looks = ToolAnnotations(read_only_hint=True)
    adds = ToolAnnotations(read_only_hint=False, destructive_hint=False)
    ends = ToolAnnotations(read_only_hint=False, destructive_hint=True)
    offered: list[tuple[Callable[..., Any], ToolAnnotations]] = [
        (tools.list_scenes, looks),
        (tools.inspect_scene, looks),
        *([(tools.upload_scene, adds)] if folders else []),
        (tools.submit_job, adds),
        (tools.list_jobs, looks),
        (tools.job_status, looks),
        (tools.wait_for_job, looks),
        (tools.get_picture, looks),
        (tools.cancel_job, ends),
        (tools.list_workers, looks),
    ]
    for tool, hints in offered:
        structured = False if tool == tools.get_picture else None
        server.add_tool(_with_sentences(tool), annotations=hints, structured_output=structured)
    return server


def _with_sentences(tool: Callable[..., Any]) -> Callable[..., Any]:
    """Returns the tool with errors that users can fix as ToolErrors, whose sentence the assistant reads."""

    def sentence(error: Exception) -> ToolError:
        if isinstance(error, OSError):
            return ToolError(f"{error.filename or 'A file'} cannot be read: {error.strerror or error}.")
        return ToolError(str(error))

    if inspect.iscoroutinefunction(tool):

        @functools.wraps(tool)
        async def called(*args: Any, **kwargs: Any) -> Any:
            try:
                return await tool(*args, **kwargs)
            except (RayfarmError, OSError) as error:
                raise sentence(error) from error

        return called

    @functools.wraps(tool)
    def called_in_thread(*args: Any, **kwargs: Any) -> Any:
        try:
            return tool(*args, **kwargs)
        except (RayfarmError, OSError) as error:
            raise sentence(error) from error

    return called_in_thread


class _Tools:
    """The tools. Their docstrings are what an assistant reads."""

    def __init__(self, farm: Client, folders: list[Path]) -> None:
        self._farm = farm
        self._folders = folders

    def list_scenes(self, search: Search = "", limit: Limit = 20) -> dict[str, Any]:
        """List the farm's scenes, newest first: id, name, status (preparing, ready or failed)."""
        rows = self._farm.scenes(search=search, limit=limit)
        return {"scenes": [{"id": row.id, "name": row.name, "status": row.status, "created": row.created} for row in rows]}

    def inspect_scene(self, scene: SceneId) -> dict[str, Any]:
        """Describe a scene: status, cameras, counts, bounds, animations, frames a second, variants, warnings and its settings."""
        return self._scene(self._farm.scene(scene))

    async def upload_scene(
        self,
        path: Annotated[str, Field(description="The scene file, a folder or a .zip on this computer.")],
        context: Context,
        up: Annotated[
            str | None, Field(description="The axis of an OBJ, PLY, STL or OFF file that is up: x, y, z, -x, -y or -z.")
        ] = None,
        floor: Annotated[str | None, Field(description="on, or auto: a floor under a scene without light.")] = "auto",
        project: Annotated[str, Field(description="The project whose members alone see it.")] = "",
        timeout_s: Wait = 45,
    ) -> dict[str, Any]:
        """Upload a scene with the files that it refers to, wait until it is prepared, and describe it.

        A scene still in preparation at the timeout is described by inspect_scene.
        """
        scene = await run_sync(functools.partial(self._upload, path, up=up, floor=floor, project=project))

        def is_prepared(scene: Scene) -> bool:
            return scene.status != "preparing"

        ready = await _until(lambda: self._farm.scene(scene.id), is_prepared, lambda found: found.progress, timeout_s, context)
        if ready.status == "failed":
            raise CommandError(f"The scene cannot be rendered: {ready.error or 'no reason given'}")
        return self._scene(ready)

    def _upload(self, path: str, **options: Any) -> Scene:
        scene = Path(path).expanduser()
        scene = (scene if scene.is_absolute() else self._folders[0] / scene).resolve()
        if not any(scene.is_relative_to(folder) for folder in self._folders):
            named = ", ".join(map(str, self._folders))
            raise CommandError(
                f"{path} is not in a folder whose scenes may be uploaded: {named}. `rayfarm mcp --folder` adds one."
            )
        files = files_to_upload(scene)
        for file in files.values():
            if not any(file.resolve().is_relative_to(folder) for folder in self._folders):
                raise CommandError(f"{file} leads outside the folders whose scenes may be uploaded.")
        return self._farm.upload(files, **options)

    def submit_job(
        self,
        scene: SceneId,
        width: Annotated[int | None, Field(description="Pixels; by default the scene's, else 960.")] = None,
        height: Annotated[int | None, Field(description="Pixels; by default the scene's, else 540.")] = None,
        spp: Annotated[int | None, Field(description="Samples per pixel.")] = None,
        noise: Annotated[float | None, Field(description="Relative noise at which it ends, such as 0.02.")] = None,
        seconds: Annotated[float | None, Field(description="Rendering time at which it ends.")] = None,
        camera: Annotated[str | int | None, Field(description="A camera of the scene, by name or number from 0.")] = None,
        frames: Annotated[str | None, Field(description="Frames of an animation, such as 0-99 or 1-250x5,300.")] = None,
        denoise: Annotated[bool, Field(description="Show it denoised on the farm's page.")] = False,
        name: Annotated[str | None, Field(description="The job's name.")] = None,
        settings: Annotated[
            dict[str, Any] | None,
            Field(description="Further fields of POST /api/jobs: view, environment, max_depth, seed, fps, clip, priority, ..."),
        ] = None,
    ) -> dict[str, Any]:
        """Submit a job that renders a scene, and return it with its id. It ends at spp, noise or seconds, whichever is first."""
        named = {"width": width, "height": height, "spp": spp, "noise": noise, "seconds": seconds, "camera": camera}
        named |= {"frames": frames, "name": name, "denoise": denoise or None}
        request = {**(settings or {}), **{key: value for key, value in named.items() if value is not None}}
        request.pop("scene", None)
        return self._job(self._farm.submit(scene, **request))

    def list_jobs(
        self,
        search: Search = "",
        state: Annotated[str, Field(description="queued, running, paused, finished, failed or cancelled; all if empty.")] = "",
        limit: Limit = 20,
    ) -> dict[str, Any]:
        """List the farm's jobs, newest first: id, name, state, progress from 0 to 1."""
        query = {"search": search, "state": state, "limit": limit}
        rows = self._farm.jobs(**{key: value for key, value in query.items() if value})
        return {"jobs": [{"id": row.id, "name": row.name, "state": row.state, "progress": row.progress} for row in rows]}

    def job_status(self, job: JobId) -> dict[str, Any]:
        """Describe a job: state, progress from 0 to 1, remaining seconds (eta_s), settings, frames, why it waits or failed."""
        return self._job(self._farm.job(job))

    async def wait_for_job(self, job: JobId, context: Context, timeout_s: Wait = 45) -> dict[str, Any]:
        """Wait until a job has ended, or for timeout_s; then describe it. Reports progress. A job that is not over goes on."""
        found = await _until(
            lambda: self._farm.job(job), lambda state: state.is_over, lambda state: state.progress, timeout_s, context
        )
        return self._job(found)

    def get_picture(
        self,
        job: JobId,
        frame: Annotated[float, Field(description="The frame of a shot; 0 for a still.")] = 0,
        width: Annotated[int, Field(ge=16, le=MAX_WIDTH, description="The largest width; larger pictures are reduced.")] = 768,
        exposure: Annotated[float, Field(description="Stops.")] = 0.0,
        denoise: Annotated[bool, Field(description="Denoised by Open Image Denoise.")] = False,
        aov: Annotated[str, Field(description="color, albedo, normal, depth or another of the film's channels.")] = "color",
    ) -> list[Any]:
        """Show the present picture of a job as a PNG, also while it is being rendered."""
        query = {"exposure": exposure, "denoise": denoise, "aov": aov, "width": width}
        png = self._farm.image(job, "png", frame, **query)
        found = self._farm.job(job)
        caption = f"Frame {frame_text(frame)} of job {job}, which is {found.state}: {100 * found.progress:.0f} %."
        return [Image(data=_reduced(png, width), format="png"), caption]

    def cancel_job(self, job: JobId) -> dict[str, Any]:
        """Cancel a job. What is rendered is kept."""
        return self._job(self._farm.change(job, state="cancelled"))

    def list_workers(self) -> dict[str, Any]:
        """List the farm's workers: name, state (starting, ready or paused), slots, processor, and why one is paused."""
        names = ("name", "state", "slots", "cpu", "message", "samples_per_s")
        return {"workers": [_given({name: getattr(row, name) for name in names}) for row in self._farm.workers()]}

    def _scene(self, scene: Scene) -> dict[str, Any]:
        found = _given(asdict(scene))
        found["files"] = [file["path"] for file in scene.files if "path" in file][:50]
        return found

    def _job(self, job: Job) -> dict[str, Any]:
        return {**_given(asdict(job)), "page": f"{self._farm.url}/#/jobs/{job.id}"}


async def _until(
    ask: Callable[[], T], is_over: Callable[[T], bool], progress: Callable[[T], float | None], timeout_s: float, context: Context
) -> T:
    """Returns the first result of `ask` that is over, or the one at the timeout; reports progress from 0 to 1."""
    deadline = time.monotonic() + timeout_s
    reported = -1.0
    while True:
        found = await run_sync(ask)
        done = progress(found) or 0.0
        if done > reported:
            await context.report_progress(done, 1.0)
            reported = done
        if is_over(found) or time.monotonic() >= deadline:
            return found
        await anyio.sleep(min(POLL_S, max(deadline - time.monotonic(), 0.0)))


def _reduced(png: bytes, width: int) -> bytes:
    """Returns a PNG of at most `width` pixels in width: the farm reduces by whole factors, this by the rest."""
    with Pillow.open(io.BytesIO(png)) as picture:
        if picture.width <= width:
            return png
        small = picture.convert("RGB").resize(
            (width, max(1, round(picture.height * width / picture.width))), Pillow.Resampling.BOX
        )
    out = io.BytesIO()
    small.save(out, "PNG")
    return out.getvalue()


def _given(found: dict[str, Any]) -> dict[str, Any]:
    """Returns the values that say something: without None, and without empty texts and lists."""
    return {name: value for name, value in found.items() if value is not None and value not in ("", [], {})}
