"""`rayfarm notes`: lists the notes on a job's pictures, writes and resolves them, and gives a verdict."""

from __future__ import annotations

import getpass
import json
import time
from typing import TYPE_CHECKING, Annotated, Any
from urllib.parse import quote

import typer

from rayfarm import options
from rayfarm.console import out
from rayfarm.errors import CommandError
from rayfarm.job_lookup import find_job
from rayfarm.login import farm_client
from rayfarm.paged import all_of

if TYPE_CHECKING:
    from rayfarm.client import Client
    from rayfarm.responses import Job

__all__ = ["register"]

VERDICTS = {"approved": "Approved", "changes-requested": "Changes requested"}


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("notes")(notes)


def notes(
    job: Annotated[str, typer.Argument(help="The job's id, or its beginning.")],
    text: Annotated[str | None, typer.Argument(help="A note to add; by default all notes are listed.")] = None,
    at: Annotated[
        str | None, typer.Option(metavar="X,Y", help="The pixel that the note is on; by default it is on the whole picture.")
    ] = None,
    frame: Annotated[float | None, typer.Option(metavar="N", help="The frame of a shot; by default the first.")] = None,
    reply: Annotated[str | None, typer.Option(metavar="NOTE", help="The note that TEXT answers.")] = None,
    resolve: Annotated[str | None, typer.Option(metavar="NOTE", help="Resolve this note.")] = None,
    reopen: Annotated[str | None, typer.Option(metavar="NOTE", help="Open this note again.")] = None,
    approve: Annotated[bool, typer.Option("--approve", help="Approve the job's pictures.")] = False,
    ask_changes: Annotated[bool, typer.Option("--ask-changes", help="Ask for changes of the job's pictures.")] = False,
    name: Annotated[
        str | None, typer.Option(help="Your name on a farm without logins; by default that of your account on this machine.")
    ] = None,
    server: options.Server = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")] = False,
) -> None:
    """List the notes on a job's pictures, write or resolve one, or give a verdict.

    [bold]Examples[/bold]

      rayfarm notes 7f3a
      rayfarm notes 7f3a "The shadow is too hard." --at 480,270
      rayfarm notes 7f3a "Softer now." --reply 0c1d2e3f4a5b
      rayfarm notes 7f3a --resolve 0c1d2e3f4a5b
      rayfarm notes 7f3a --approve
    """
    if approve and ask_changes:
        raise CommandError("--approve cannot be combined with --ask-changes")
    if text is None and (at, frame, reply) != (None, None, None):
        raise CommandError("Give the text of the note: `rayfarm notes JOB TEXT`")
    if reply is not None and (at, frame) != (None, None):
        raise CommandError("--reply cannot be combined with --at or --frame: a reply is where the note is")
    with farm_client(server) as farm:
        found = find_job(farm, job)
        path, author = f"/api/jobs/{found.id}", name or getpass.getuser()
        if text is not None:
            place = {"frame": frame, "reply_to": reply, **(_place(at, found) if at is not None else {})}
            farm.call("POST", f"{path}/notes", text=text, author=author, **place)
        for note, resolved in ((resolve, True), (reopen, False)):
            if note is not None:
                farm.call("PATCH", f"{path}/notes/{quote(note, safe='')}", resolved=resolved, author=author)
        if approve or ask_changes:
            farm.call("PUT", f"{path}/review", state="approved" if approve else "changes-requested", author=author)
        _print_all(farm, found, as_json)


def _place(at: str, job: Job) -> dict[str, float]:
    """Returns the centre of a pixel as a fraction of the picture's size. Raises CommandError if it is outside."""
    x, y = options.parse_pixel(at, "--at")
    if not job.width or not job.height:
        raise CommandError("The size of the picture is not known yet; wait until its scene is prepared")
    if x >= job.width or y >= job.height:
        raise CommandError(f"--at is {at!r}; the picture has {job.width}x{job.height} pixels")
    return {"x": (x + 0.5) / job.width, "y": (y + 0.5) / job.height}


def _print_all(farm: Client, job: Job, as_json: bool) -> None:
    review = farm.call("GET", f"/api/jobs/{job.id}").get("review")
    rows = all_of(farm, f"/api/jobs/{job.id}/notes")
    if as_json:
        print(json.dumps({"review": review, "notes": rows}, indent=1))
        return
    if review and review["state"]:
        verdict = VERDICTS.get(review["state"], review["state"])
        out.print(f"{verdict} by {_named(review['by'], review['guest'])}, {_moment(review['at'])}.", markup=False)
    if not rows:
        out.print("No notes yet. `rayfarm notes JOB TEXT` writes one.")
    for row in rows:
        if row["reply_to"] is None:
            where = _where(row, job)
            done = f", resolved by {_named(row['resolved_by'], row.get('resolved_guest', False))}" if row["resolved"] else ""
            _print(f"{row['id']}  {where}  {_named(row['author'], row['guest'])}, {_moment(row['created'])}{done}")
            _print(row["text"], 2)
            for answer in rows:
                if answer["reply_to"] == row["id"]:
                    _print(f"{_named(answer['author'], answer['guest'])}, {_moment(answer['created'])}", 4)
                    _print(answer["text"], 6)


def _where(row: dict[str, Any], job: Job) -> str:
    frame = f"frame {row['frame']:g}, " if job.shot else ""
    if row["x"] is None or not job.width or not job.height:
        return f"{frame}whole picture"
    x, y = (min(int(row[axis] * size), size - 1) for axis, size in (("x", job.width), ("y", job.height)))
    return f"{frame}{x},{y}"


def _named(author: str, guest: bool) -> str:
    return f"{author} (guest)" if guest else author


def _moment(at: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(at))


def _print(text: str, indent: int = 0) -> None:
    for line in text.split("\n"):
        out.print(f"{' ' * indent}{line}", markup=False, soft_wrap=True)
