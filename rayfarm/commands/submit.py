"""`rayfarm submit`: a scene for a farm."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from rayfarm import options
from rayfarm.answers import Job, Scene
from rayfarm.client import Client, ClientError
from rayfarm.console import PROGRAM, Ticker, bar, err, out
from rayfarm.errors import EXIT_INTERRUPTED, CommandError
from rayfarm.output_files import check_writable, write
from rayfarm.picture import Picture, takes_picture
from rayfarm.scene_files import belonging, is_numbered

__all__ = ["register", "server_url"]

FORMATS = ("png", "exr", "jpg")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("submit")(submit)


def server_url(server: str | None) -> str:
    """The farm to talk to: --server, $RAYFARM_SERVER, the one that runs on the data folder, or this machine's port 8000."""
    from rayfarm.local.state import running_farm
    from service.places import default_data_folder

    if server or (server := os.environ.get("RAYFARM_SERVER")):
        return server
    here = running_farm(default_data_folder())
    return here.url if here else "http://127.0.0.1:8000"


@takes_picture
def submit(
    scene: Annotated[Path, typer.Argument(help="A scene file, a folder, or a .zip. Files that it names are taken along.")],
    server: options.Server = None,
    wait: Annotated[bool, typer.Option("--wait", help="Wait for the picture, with a progress bar.")] = False,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Wait, and write the picture: .png .exr or .jpg.")] = None,
    picture: Picture = Picture(),
    variant: options.Variant = None,
    aov: options.Aov = None,
    denoise: options.Denoise = False,
    priority: Annotated[int, typer.Option(min=-100, max=100, help="Higher goes first.")] = 0,
) -> None:
    """Upload a scene to a farm and ask for its picture.

    Prints the job's number. Without --wait it returns at once; Ctrl-C while waiting leaves the job running.
    Whether the picture can be written is looked at first. Ends with 1 and a sentence where anything fails, with 130 at Ctrl-C.

    [bold]Examples[/bold]

      rayfarm submit scene.glb
      rayfarm submit scene.glb --wait -o out.exr
      rayfarm submit folder/ -o out.png --denoise --noise 0.02
      rayfarm submit room.obj --size 1920x1080 --spp 512 --server http://studio:8000
    """
    if output is not None:
        if output.suffix.lower().lstrip(".").replace("jpeg", "jpg") not in FORMATS:
            raise CommandError(f"{output.name}: a farm gives .{', .'.join(FORMATS)}; end the name with one of these")
        check_writable(output)
        if denoise:
            check_writable(options.denoised_name(output))
        if aov and output.suffix.lower() != ".exr":
            raise CommandError(f"--aov needs an .exr: {output.suffix} has no room for further channels")
        wait = True
    elif aov or denoise:
        raise CommandError("--aov and --denoise say what to write; name the picture with -o")
    if is_numbered(scene):
        raise CommandError(f"{scene.name} is a file for each frame, and a farm renders stills: name one of them")
    environment = picture.environment().image
    files: dict[str, Path] = belonging(scene)
    inside = None
    if environment is not None:
        inside = f"rayfarm-environment{environment.suffix.lower()}"
        files[inside] = environment

    with Client(server_url(server)) as farm:
        uploaded = farm.upload(
            files, main=scene.name if inside and scene.is_file() else None, environment=inside, name=scene.name
        )
        ready = _prepared(farm, uploaded)
        for warning in options.told(ready.warnings, picture.environment()):
            err.print(f"note: {warning}", markup=False, soft_wrap=True)
        asked = picture.request([asdict(camera) for camera in ready.cameras])
        if variant is not None:
            asked["variant"] = variant
        job = farm.submit(ready.id, priority=priority, **asked)
        out.print(job.id, markup=False)
        if wait:
            _wait(farm, job.id, output, aov, denoise)
        else:
            err.print(f"Watch it at {farm.url}/#/jobs/{job.id}", markup=False, soft_wrap=True)


def _prepared(farm: Client, uploaded: Scene) -> Scene:
    with bar() as progress:
        task = progress.add_task("preparing", total=1.0)

        def show(scene: Scene) -> None:
            progress.update(task, description=scene.step or "preparing", completed=scene.progress or 0.0)

        return farm.wait_for_scene(uploaded.id, watch=show)


def _wait(farm: Client, job: str, output: Path | None, aov: str | None, denoise: bool) -> None:
    ticker = Ticker()
    try:
        with bar() as progress:
            task = progress.add_task("rendering", total=1.0)

            def show(job: Job) -> None:
                progress.update(task, description=job.message or job.state, completed=job.progress)
                ticker.tick(f"{job.message or job.state}: {100 * job.progress:.0f} %")

            final = farm.wait(job, watch=show)
    except KeyboardInterrupt:
        err.print(f"The job goes on. Its state: `{PROGRAM} jobs {job}`, its picture: {farm.url}", markup=False, soft_wrap=True)
        raise typer.Exit(EXIT_INTERRUPTED) from None
    if final.state != "finished":
        raise CommandError(f"The job {job} {_outcome(final)}")
    if output is None:
        return
    format = output.suffix.lower().lstrip(".").replace("jpeg", "jpg")
    try:
        write(output, farm.image(job, format, aov=f"color,{aov}" if aov else "color"))
        err.print(f"{output} written", markup=False, soft_wrap=True)
        if denoise:
            clean = options.denoised_name(output)
            write(clean, farm.image(job, format, denoise=True))
            err.print(f"{clean} written", markup=False, soft_wrap=True)
    except (ClientError, CommandError) as error:
        raise CommandError(f"{error} The farm keeps the picture: {farm.url}/#/jobs/{job}") from error


def _outcome(job: Job) -> str:
    if job.state == "failed":
        return f"failed: {job.error or 'no reason given'}"
    return f"was {job.state} before it was finished."
