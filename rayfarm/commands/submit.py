"""`rayfarm submit`: sends a scene to a farm for rendering."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from rayfarm import options
from rayfarm.client import Client, ClientError
from rayfarm.console import PROGRAM, PlainProgress, bar, err, out
from rayfarm.errors import EXIT_INTERRUPTED, CommandError
from rayfarm.job_template import is_template, read_template
from rayfarm.login import farm_client
from rayfarm.output_files import check_still_size, check_writable, write
from rayfarm.picture import Picture, takes_picture
from rayfarm.responses import Job, Scene
from rayfarm.scene_files import files_to_upload, is_numbered, relative_to_root
from rayfarm.shot import FarmShot, fetch_shot, look_of_file
from rayfarm.strict import refuse_warnings
from renderer.frames import frames_text
from renderer.image.tonemap import CURVES
from renderer.work import DEFAULT_SIZE
from service.clock import deadline_of
from service.watching.movie import MOVIES

__all__ = ["register"]

FORMATS = ("png", "exr", "jpg", "avif", "jxl")
TEMPLATE_OPTIONS = ("frame", "fps", "clip", "turntable", "variant", "aov", "denoise", "strict", "root")


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("submit")(takes_picture(submit))


def submit(
    scene: Annotated[
        Path,
        typer.Argument(
            help="A scene file, a folder, or a .zip; files that it refers to are uploaded too. Or a job template of OpenJD."
        ),
    ],
    server: options.Server = None,
    wait: Annotated[
        bool, typer.Option("--wait", help="Wait for the picture and show progress.", rich_help_panel=options.OUTPUT)
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Wait, and write the picture: .png .jpg .avif .jxl or .exr; of several frames also .mp4 .webm or .webp.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    picture: Picture = Picture(),
    variant: options.Variant = None,
    frame: options.Frame = None,
    frames: options.Frames = None,
    overwrite: options.Overwrite = False,
    fps: options.Fps = None,
    clip: options.Clip = None,
    turntable: options.Turntable = None,
    order: options.Order = None,
    every: options.Every = None,
    aov: options.Aov = None,
    denoise: options.Denoise = False,
    exposure: Annotated[
        float,
        typer.Option(
            min=-32,
            max=32,
            help="Exposure in stops, of -o and of the page's view; not of .exr and .hdr.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = 0.0,
    tonemap: Annotated[
        str,
        typer.Option(
            metavar="CURVE",
            help=f"Tone curve, of -o (.png, .jpg, movies) and of the page's view: {', '.join(CURVES)}; or a view of the farm's "
            "OCIO config, `ocio:VIEW`.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = "neutral",
    project: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="The project to add it to, visible only to the project's members; by default all users see it.",
            rich_help_panel=options.QUEUE,
        ),
    ] = "",
    strict: options.Strict = False,
    root: options.Root = None,
    priority: Annotated[int, typer.Option(min=-100, max=100, help="Higher goes first.", rich_help_panel=options.QUEUE)] = 0,
    after: Annotated[
        list[str] | None,
        typer.Option(
            metavar="JOB", help="Start when this job is finished; may be given several times.", rich_help_panel=options.QUEUE
        ),
    ] = None,
    deadline: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="Deadline: a time such as 08:00, or an ISO time such as 2026-05-01T08:00. Warns if the forecast is later.",
            rich_help_panel=options.QUEUE,
        ),
    ] = None,
    need: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NEED",
            help="What its workers must have: a tag, or memory_gb=32; may be given several times.",
            rich_help_panel=options.QUEUE,
        ),
    ] = None,
    max_slots: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="The most slots that may render it at a time.", rich_help_panel=options.QUEUE),
    ] = None,
    verify: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=1.0,
            help="The share of its batches that two workers render, for comparison.",
            rich_help_panel=options.QUEUE,
        ),
    ] = None,
    fresh: Annotated[
        bool,
        typer.Option(
            "--fresh",
            help="Render all samples, without reusing those of earlier jobs of the same picture.",
            rich_help_panel=options.QUEUE,
        ),
    ] = False,
    param: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="A parameter of a job template; may be given several times.",
            rich_help_panel=options.FILE_PANEL,
        ),
    ] = None,
) -> str | None:
    """Upload a scene to a farm and submit a job that renders it.

    Prints the job's id. Without --wait it returns at once; Ctrl-C while waiting leaves the job running. Checks first whether
    the picture can be written. Options replace what the scene file states; defaults hold where it states nothing. Exits with 1
    and a sentence if anything fails, with 130 on Ctrl-C.

    [bold]Examples[/bold]

      rayfarm submit scene.glb
      rayfarm submit scene.glb --wait -o out.exr
      rayfarm submit folder/ -o out.png --denoise --noise 0.02
      rayfarm submit shot.glb --frames 0-99 --wait -o out.####.png
      rayfarm submit shot.glb --frames 0-99 --order breadth-first -o out.mp4
      rayfarm submit shot.glb --frames 0-99 --after 7f3a1c
      rayfarm submit room.obj --spp 512 --server http://studio:8000
      rayfarm submit shot.openjd.yaml --param Frames=1-10:2
    """
    if is_template(scene):
        given: dict[str, Any] = {"frame": frame, "frames": frames, "variant": variant, "fps": fps, "clip": clip}
        given |= {"turntable": turntable, "exposure": exposure or None, "tonemap": None if tonemap == "neutral" else tonemap}
        given |= {"aov": aov, "root": root, **picture.given, "denoise": denoise or None, "strict": strict or None}
        among: dict[str, Any] = {"server": server, "wait": wait, "project": project, "priority": priority, "after": after}
        among |= {"deadline": deadline, "max_slots": max_slots, "verify": verify, "fresh": fresh, "order": order, "every": every}
        _submit_template(scene, param or [], given, output, need or [], overwrite, **among)
        return None
    if param:
        raise CommandError(f"--param needs a job template, which {scene.name} is not")
    look = {**({"exposure": exposure} if exposure else {}), **({} if tonemap == "neutral" else {"tonemap": tonemap})}
    moving = {"fps": fps, "clip": clip, "turntable": turntable, "order": order, "every": every}
    _check_output_format(output, is_shot=frames is not None)
    shot = FarmShot.from_options(frames, frame, moving, output, aov, denoise, overwrite, look)
    if shot is not None and picture.changes_view_partly():
        raise CommandError("A farm needs a camera of the scene or a complete view: give both --eye and --target")
    if overwrite and frames is None:
        raise CommandError("--overwrite needs --frames; a single picture is always overwritten")
    if shot is not None and not shot.frames:
        err.print(f"All {len(shot.all_frames)} frames are there; --overwrite renders them again", markup=False)
        return None
    _check_output(output, shot, aov, denoise)
    if shot is not None and len(shot.frames) < len(shot.all_frames):
        kept = len(shot.all_frames) - len(shot.frames)
        err.print(f"{kept} of {len(shot.all_frames)} frames are there and kept; --overwrite renders them again", markup=False)
    if is_numbered(scene) and frames is None:
        raise CommandError(f"{scene.name} is a file for each frame: say which, by --frames, or name one of them")
    picture.check()
    place = {"after": after, "max_slots": max_slots, "deadline": _deadline(deadline), "needs": need, "verify": verify}
    with farm_client(server) as farm:
        ready = _upload(farm, scene, picture, project, root, strict)
        asked = picture.request([asdict(camera) for camera in ready.cameras])
        if output is not None:
            size = {"width": DEFAULT_SIZE[0], "height": DEFAULT_SIZE[1], **ready.defaults, **asked}
            check_still_size(output, size["width"], size["height"])
        if (image := picture.environment().image) is not None:
            asked["environment"]["image"] = farm.upload_environment(image, project).id
        if shot is not None:
            asked |= {**shot.request, "frames": frames_text(shot.frames)}
        chosen = {**place, **look, "variant": variant, "fresh": fresh or None, "strict": strict or None}
        # As the page does: a still is shown denoised where a worker can denoise. Its film stays as it is.
        chosen["denoise"] = denoise or (shot is None and any(worker.denoises for worker in farm.workers())) or None
        asked |= {name: value for name, value in chosen.items() if value is not None and value != []}
        job = farm.submit(ready.id, priority=priority, **asked)
        out.print(job.id, markup=False)
        _report_reused_samples(job)
        if wait or output is not None:
            _wait_for_job(farm, job.id, output, aov, denoise, look, shot)
        else:
            err.print(f"Watch it at {farm.url}/#/jobs/{job.id}", markup=False, soft_wrap=True)
        return job.id


def _upload(farm: Client, scene: Path, picture: Picture, project: str, root: Path | None, strict: bool) -> Scene:
    """Uploads a scene and waits until it is prepared. Prints its warnings, which are an error if `strict`."""
    name = scene.name if is_numbered(scene) else None
    main = name if root is None else relative_to_root(scene, root)
    files = files_to_upload(scene, root)
    uploaded = farm.upload(files, main=main, name=name, project=project, **picture.placement()._asdict())
    ready = _wait_until_prepared(farm, uploaded)
    warnings = options.relevant_warnings(ready.warnings, picture.environment())
    refuse_warnings(scene.name, warnings, strict)
    for warning in [*warnings, *picture.floor_notes(ready.has_floor)]:
        err.print(f"note: {warning}", markup=False, soft_wrap=True)
    return ready


def _submit_template(
    path: Path,
    values: list[str],
    given: dict[str, Any],
    output: Path | None,
    need: list[str],
    overwrite: bool,
    **kept: Any,
) -> None:
    """Submits a job for each step of a job template, which begins after the jobs of the steps on which it depends.

    given: options of the picture on the command line, of which a template takes none. kept: options of `submit` alone.
    """
    if named := [name for name, value in given.items() if value is not None]:
        raise CommandError(
            f"--{named[0].replace('_', '-')} is not taken with a job template, which has its own options; --param changes a "
            f"parameter of {path.name}"
        )
    if wrong := [value for value in values if "=" not in value]:
        raise CommandError(f"--param is {wrong[0]!r}; it takes a name and a value as --param Frames=1-10:2")
    calls = read_template(path, dict(value.split("=", 1) for value in values))
    if output is not None and len(calls) > 1:
        raise CommandError(f"-o names the files of one job, and {path.name} has {len(calls)} steps; --wait writes those of each")
    after: list[str] = kept.pop("after") or []
    jobs: dict[str, list[str]] = {}  # of each step: none if all of its frames are there
    for call in calls:
        found = dict(call.options)
        own, again = found.pop("output", None), found.pop("overwrite", False)
        target = output
        if output is None and kept["wait"]:
            target = own or Path(f"{Path(found['scene']).resolve().stem}{'' if call.frames is None else '.####'}.png")
        plain = {name: found.pop(name) for name in TEMPLATE_OPTIONS if name in found}
        job = submit(
            found.pop("scene"),
            output=target,
            picture=Picture(found),
            frames=call.frames,
            overwrite=overwrite or again,
            need=[*need, *call.needs],
            after=[*after, *(job for name in call.after for job in jobs[name])] or None,
            **plain,
            **kept,
        )
        jobs[call.step] = [] if job is None else [job]


def _check_output_format(output: Path | None, is_shot: bool) -> None:
    """Raises CommandError if a farm cannot produce files of this format."""
    if output is None or _format(output) in FORMATS:
        return
    given = (*FORMATS, *MOVIES) if is_shot else FORMATS
    if _format(output) not in given:
        raise CommandError(f"{output.name}: a farm writes .{', .'.join(given)}; end the name with one of these")


def _check_output(output: Path | None, shot: FarmShot | None, aov: str | None, denoise: bool) -> None:
    """Raises CommandError if the picture could not be written after rendering."""
    if output is None:
        if aov:
            raise CommandError("--aov needs an output file: give -o")
        return
    if shot is None:
        check_writable(output)
        if denoise:
            check_writable(options.denoised_name(output))
    if aov and output.suffix.lower() != ".exr":
        raise CommandError(f"--aov needs an .exr: {output.suffix} cannot contain further channels")


def _format(output: Path) -> str:
    return output.suffix.lower().lstrip(".").replace("jpeg", "jpg")


def _report_reused_samples(job: Job) -> None:
    if job.taken is not None:
        of = f" of {job.spp}" if job.spp and job.noise is None else ""
        sentence = f"Taken from job {job.taken['job']}: {job.taken['spp']:g}{of} samples. --fresh renders it anew"
        err.print(sentence, markup=False, soft_wrap=True)


def _deadline(text: str | None) -> str | None:
    """Returns the deadline with this machine's time zone, since the farm may be in another one."""
    try:
        return None if text is None else datetime.fromtimestamp(deadline_of(text)).astimezone().isoformat()
    except ValueError as error:
        raise CommandError(f"--deadline: {error}") from None


def _wait_until_prepared(farm: Client, uploaded: Scene) -> Scene:
    ticker = PlainProgress()
    with bar() as progress:
        task = progress.add_task("preparing", total=1.0)

        def show_progress(scene: Scene) -> None:
            step = scene.step or "preparing"
            progress.update(task, description=step, completed=scene.progress or 0.0)
            ticker.print_if_due(f"The scene is prepared: {step}")

        return farm.wait_for_scene(uploaded.id, watch=show_progress)


def _wait_for_job(
    farm: Client,
    job: str,
    output: Path | None,
    aov: str | None,
    denoise: bool,
    look: Mapping[str, Any],
    shot: FarmShot | None,
) -> None:
    ticker = PlainProgress()
    try:
        if shot is not None:
            ended = fetch_shot(farm, job, shot)
            if ended.state != "finished":
                raise CommandError(f"The job {job} {_failure_text(ended)}")
            return
        with bar() as progress:
            task = progress.add_task("rendering", total=1.0)

            def show_progress(job: Job) -> None:
                progress.update(task, description=job.message or job.state, completed=job.progress)
                ticker.print_if_due(f"{job.message or job.state}: {100 * job.progress:.0f} %")

            final = farm.wait(job, watch=show_progress)
    except KeyboardInterrupt:
        err.print(f"The job continues. Its state: `{PROGRAM} jobs {job}`, its picture: {farm.url}", markup=False, soft_wrap=True)
        raise typer.Exit(EXIT_INTERRUPTED) from None
    if final.state != "finished":
        raise CommandError(f"The job {job} {_failure_text(final)}")
    if output is None:
        return
    try:
        own = look_of_file(look, _format(output))
        write(output, farm.image(job, _format(output), aov=f"color,{aov}" if aov else "color", **own))
        err.print(f"{output} written", markup=False, soft_wrap=True)
        if denoise:
            clean = options.denoised_name(output)
            write(clean, farm.image(job, _format(output), denoise=True, **own))
            err.print(f"{clean} written", markup=False, soft_wrap=True)
        if (final.settings or {}).get("deep"):
            deep = options.deep_name(output)
            write(deep, farm.deep_image(job))
            err.print(f"{deep} written", markup=False, soft_wrap=True)
    except (ClientError, CommandError) as error:
        raise CommandError(f"{error} The farm keeps the picture: {farm.url}/#/jobs/{job}") from error


def _failure_text(job: Job) -> str:
    if job.state == "failed":
        return f"failed: {job.error or 'no reason given'}"
    return f"was {job.state} before it was finished."
