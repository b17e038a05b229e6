"""render() and progressive(): render a scene from a program, in this process or on a farm."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rayfarm.library.arguments import parse_arguments
from rayfarm.library.image import Image
from rayfarm.library.scene_input import as_files
from renderer.errors import SettingsError

if TYPE_CHECKING:
    from rayfarm.client import Client

__all__ = ["progressive", "render"]


def render(scene: Any, *, farm: str | Client | None = None, base: str | Path = ".", **settings: Any) -> Image:
    """Renders a picture of a scene: arrays by AOV name.

        image = rayfarm.render("truck.glb", width=640, height=360, spp=64)
        image["color"]            # (360, 640, 3) float32, scene-linear
        image.save("truck.exr")

    scene: a path; a dict as in docs/scene-format.md, in which a mesh may have arrays and a texture pixels; a trimesh.Trimesh or
    trimesh.Scene. base: the folder of the files that a dict names.
    farm: a farm's address or a Client; None renders in this process, with all cores.
    device: "cuda", or "cuda:1" for another card, renders in this process with an NVIDIA card instead, to the same bits; "cpu" is
    the default. Not together with farm, whose workers choose.
    settings: width, height, spp, noise, seconds; camera, eye, target, fov, aperture ...; environment; frame, fps, clip; variant;
    up_axis, floor (True, or "auto": if the scene has no light);
    aovs (default: all of the film; "motion" only on request); denoise; threads; and each of `settings` of the scene format by its
    name.
    Raises SceneError, SettingsError, ClientError (all RayfarmError), or TypeError for an unknown keyword.
    """
    with closing(_images(scene, farm, base, settings, at_once=True)) as images:
        return list(images)[-1]


def progressive(scene: Any, *, farm: str | Client | None = None, base: str | Path = ".", **settings: Any) -> Generator[Image]:
    """Like `render`, but returns an iterator of Images with growing sample counts, the last of which is final.

        for image in rayfarm.progressive(scene, spp=1024, farm="http://studio:8000"):
            print(image.spp, image.noise)

    Leaving the loop ends the rendering; a farm's job is cancelled.
    """
    return _images(scene, farm, base, settings, at_once=False)


def _images(scene: Any, farm: str | Client | None, base: str | Path, settings: dict[str, Any], at_once: bool) -> Generator[Image]:
    wanted = parse_arguments(settings)
    if farm is not None and wanted.device != "cpu":
        raise SettingsError(
            "device is for rendering in this process: leave it out for a farm, whose workers choose their devices"
        )
    with ExitStack() as stack:
        path = stack.enter_context(as_files(scene, base))
        if farm is None:
            from rayfarm.library.local_render import passes

            yield from passes(path, wanted, at_once)
            return
        from rayfarm.client import ClientError
        from rayfarm.library.farm_render import images, upload_and_submit
        from rayfarm.login import farm_client

        client = stack.enter_context(farm_client(farm)) if isinstance(farm, str) else farm
        job = upload_and_submit(client, path, wanted)
        is_done = False
        try:
            for image in images(client, job.id, wanted, at_once):
                is_done = image.is_final
                yield image
        finally:
            if not is_done:
                with suppress(ClientError):  # already ended, or the farm is unreachable
                    client.change(job.id, state="cancelled")
