"""`rayfarm watch`: shows a job's picture in the terminal while it is rendered."""

from __future__ import annotations

import contextlib
import signal
import sys
import tempfile
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from rayfarm import options
from rayfarm.console import PROGRAM, err
from rayfarm.errors import EXIT_INTERRUPTED, CommandError
from rayfarm.job_lookup import find_job
from rayfarm.login import farm_client
from rayfarm.output_files import check_writable, write
from renderer.image.tonemap import CURVES

if TYPE_CHECKING:
    from rayfarm.client import Client
    from rayfarm.responses import Job
    from rayfarm.watch.live import LiveJob
    from rayfarm.watch.tev import TevFeed

__all__ = ["register"]

OPTIONS_WITH_OPTIONAL_VALUE = ("--tev", "--viewer")  # options with an optional value
ACTIVE = ("running", "queued", "paused")


class _WatchCommand(TyperCommand):
    """A typer command in which some options may be given without their value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        words: list[str] = []
        for number, each in enumerate(args):
            words.append(each)
            following = args[number + 1] if number + 1 < len(args) else "--"
            if each in OPTIONS_WITH_OPTIONAL_VALUE and following.startswith("-"):
                words.append("")
        return super().parse_args(ctx, words)


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("watch", cls=_WatchCommand)(watch)


def watch(
    job: Annotated[
        str | None, typer.Argument(help="The job's id, or its beginning; by default the newest unfinished job.")
    ] = None,
    server: options.Server = None,
    frame: Annotated[
        float | None,
        typer.Option(metavar="N", help="The frame of a shot to show; by default the one being rendered."),
    ] = None,
    graphics: Annotated[
        str, typer.Option(metavar="NAME", help="auto asks the terminal; or kitty, sixel, blocks, or none (lines only).")
    ] = "auto",
    exposure: Annotated[float, typer.Option(min=-20, max=20, metavar="STOPS", help="+1 doubles the light.")] = 0.0,
    tonemap: Annotated[str, typer.Option(metavar="NAME", help=f"One of {', '.join(CURVES)}.")] = "neutral",
    tev: Annotated[
        str | None,
        typer.Option("--tev", metavar="[HOST:PORT]", help="Also send the picture to a running tev while it grows."),
    ] = None,
    viewer: Annotated[
        str | None,
        typer.Option(
            "--viewer", metavar="[COMMAND]", help="Open the EXR at the end, in this system's default program or in COMMAND."
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", dir_okay=False, help="Where to write the EXR for --viewer; by default a temporary file."),
    ] = None,
) -> None:
    """Show a job's picture in the terminal while it grows, with progress and rate beneath.

    Sharp if the terminal supports kitty's graphics or sixels, otherwise in half blocks. In a pipe it prints lines until the job
    ends.

    Keys: q quits (the job continues), + and - change the exposure, t the tone curve, arrows the frame, c cancels the job.

    Exits with 1 and a sentence if there is no such job, or, in a pipe, if the job fails; with 130 on Ctrl-C.

    [bold]Examples[/bold]

      rayfarm watch                               the newest job
      rayfarm watch 7f3a --graphics blocks
      rayfarm watch 7f3a --tev --viewer           tev, then the system's viewer
      rayfarm watch 7f3a --viewer blender
      rayfarm watch 7f3a | tee log
    """
    from rayfarm.watch.live import LiveJob
    from rayfarm.watch.screen import GRAPHICS
    from rayfarm.watch.terminal import Terminal
    from rayfarm.watch.tev import TevFeed, address_of
    from rayfarm.watch.viewer import command_of

    if tonemap not in CURVES:
        raise CommandError(f"--tonemap is {tonemap!r}; there are {', '.join(CURVES)}")
    if graphics not in (*GRAPHICS, "none"):
        raise CommandError(f"--graphics is {graphics!r}; there are {', '.join((*GRAPHICS, 'none'))}")
    if output is not None:
        if viewer is None or output.suffix.lower() != ".exr":
            raise CommandError("-o names the .exr that --viewer opens: rayfarm watch JOB --viewer -o out.exr")
        check_writable(output)
    if viewer is not None:
        command_of(viewer, Path("picture.exr"))  # raises now instead of after the job
    address = None if tev is None else address_of(tev)

    news = threading.Event()
    with farm_client(server) as farm, contextlib.ExitStack() as ends:
        terminal = Terminal() if graphics != "none" and Terminal.is_terminal() else None
        wake = terminal.wake if terminal is not None else news.set
        live = LiveJob(farm, _find_job_to_watch(farm, job), frame, wake)
        feed = TevFeed(live, address) if address is not None else None
        ends.enter_context(live)
        if feed is not None:
            ends.enter_context(feed)
        ended = _show_until_ended(farm, live, terminal, graphics, exposure, tonemap, news)
        final = live.job
        _send_final_picture(farm, live, feed, viewer, output)
    if ended == signal.SIGINT:
        raise typer.Exit(EXIT_INTERRUPTED)
    if terminal is None and final.state != "finished":
        raise CommandError(
            f"The job {final.id} failed: {final.error or 'no reason given'}"
            if final.state == "failed"
            else f"The job {final.id} was {final.state}."
        )


def _find_job_to_watch(farm: Client, job: str | None) -> Job:
    if job is not None:
        return find_job(farm, job)
    jobs = farm.jobs()
    if not jobs:
        raise CommandError("There is no job to watch. `rayfarm submit SCENE` makes one.")
    return next((each for each in jobs if each.state in ACTIVE), jobs[0])


def _show_until_ended(
    farm: Client, live: LiveJob, terminal: Any, graphics: Any, exposure: float, tonemap: str, news: threading.Event
) -> int | None:
    """Shows the job until it ends or the user quits. Returns the signal that ended the display, or None."""
    from rayfarm.watch.lines import print_progress
    from rayfarm.watch.screen import Screen
    from rayfarm.watch.words import frame_title, progress_text

    if terminal is None:
        try:
            print_progress(live, news)
        except KeyboardInterrupt:
            return signal.SIGINT
        except BrokenPipeError:  # the reader of the pipe has closed it
            sys.stdout = None
        return None
    with terminal:
        ended = Screen(terminal, farm, live, graphics, exposure, tonemap).run()
    err.print(f"{frame_title(live.job, live.watched_frame)} · {progress_text(live.job)}", markup=False, soft_wrap=True)
    if not live.job.is_over:
        err.print(f"The job continues: `{PROGRAM} watch {live.job.id}`", markup=False, soft_wrap=True)
    return None if ended is None else int(ended)


def _send_final_picture(farm: Client, live: LiveJob, feed: TevFeed | None, viewer: str | None, output: Path | None) -> None:
    """Sends the EXR of a finished job to tev and opens it in the viewer, if these were requested."""
    from rayfarm.reading_files import read_picture
    from rayfarm.watch.viewer import open_in

    if live.job.state != "finished" or (feed is None and viewer is None):
        return
    picture = farm.image(live.job.id, "exr", live.frame)
    if feed is not None:
        feed.finish(read_picture(picture, "film.exr"))
    if viewer is not None:
        if output is None:
            output = Path(tempfile.mkdtemp(prefix="rayfarm-")) / f"{live.job.id}-{live.frame:g}.exr"
        write(output, picture)
        open_in(viewer, output)
        err.print(f"{output} opened", markup=False, soft_wrap=True)
