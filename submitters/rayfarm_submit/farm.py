"""Functions shared by the hooks: submit a scene by the program `rayfarm`, and fetch pictures by the REST API."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from http.client import HTTPException, IncompleteRead
from pathlib import Path
from typing import Any
from urllib.parse import quote

__all__ = ["Farm", "FarmError", "frames_of", "keep_frame_numbers", "submit"]

PROGRAM_VARIABLE, SERVER_VARIABLE, TOKEN_VARIABLE = "RAYFARM_PROGRAM", "RAYFARM_SERVER", "RAYFARM_API_TOKEN"
TIMEOUT_S = 60.0
CHUNK = 1 << 20  # bytes


class FarmError(RuntimeError):
    """Raised with an error sentence of the farm or of the program `rayfarm`."""


def submit(
    scene: Path,
    frames: str | None = None,
    camera: str | None = None,
    size: tuple[int, int] | None = None,
    server: str | None = None,
    options: Sequence[str] = (),
) -> str:
    """Uploads a scene with the files that it refers to, and submits a job. Returns the job's id. Raises FarmError.

    frames: as 1001-1100 or 1001-1100x2; None for a still. server: the farm's address; by default $RAYFARM_SERVER. options:
    further ones of `rayfarm submit`. The program is $RAYFARM_PROGRAM, or `rayfarm` on the PATH; it reads the token from
    $RAYFARM_API_TOKEN.
    """
    program = os.environ.get(PROGRAM_VARIABLE) or shutil.which("rayfarm")
    if not program:
        raise FarmError(f"The program rayfarm is not on the PATH. Install it, or set {PROGRAM_VARIABLE} to its path.")
    command = [program, "submit", str(scene)]
    for option, value in (
        ("--frames", frames),
        ("--camera", camera),
        ("--size", f"{size[0]}x{size[1]}" if size else None),
        ("--server", server),
    ):
        if value is not None:
            command += [option, value]
    # The host's Python must not find its own packages in that of the program.
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONHOME", "PYTHONPATH")}
    done = subprocess.run([*command, *options], capture_output=True, text=True, env=environment, check=False)
    printed = done.stdout.strip().splitlines()
    if done.returncode or not printed:
        raise FarmError(done.stderr.strip() or f"{program} ended with {done.returncode}.")
    return printed[-1]


def frames_of(first: float, last: float, step: float = 1.0) -> str:
    """Returns a range of frames as `rayfarm submit --frames` takes it. Raises FarmError for frames before 0."""
    if first < 0:
        raise FarmError(f"The range begins at frame {first:g}; a farm's frames begin at 0.")
    text = f"{first:.10g}-{last:.10g}" if last > first else f"{first:.10g}"
    return text if step == 1 or last <= first else f"{text}x{step:.10g}"


def keep_frame_numbers(stage: Path) -> None:
    """Makes a USD file begin at time code 0, so that the farm's frames have the numbers of the shot.

    A farm counts frames from the start of a stage. Needs `pxr`, which Maya's USD plug-in and Houdini bring along.
    """
    from pxr import Sdf

    layer = Sdf.Layer.FindOrOpen(str(stage))
    if layer is None:
        raise FarmError(f"{stage} is no USD file.")
    layer.startTimeCode = 0.0
    layer.Save()


class Farm:
    """A farm's REST API. Every method raises FarmError."""

    def __init__(self, server: str | None = None, token: str | None = None) -> None:
        """server, token: by default $RAYFARM_SERVER and $RAYFARM_API_TOKEN."""
        self.server = (server or os.environ.get(SERVER_VARIABLE, "")).rstrip("/")
        self._token = os.environ.get(TOKEN_VARIABLE, "") if token is None else token
        if not self.server.startswith(("http://", "https://")):
            raise FarmError(f"Name the farm's address, as http://studio:8000, or set {SERVER_VARIABLE}.")

    def job(self, job: str) -> dict[str, Any]:
        """Returns a job, as GET /api/jobs/{id} describes it."""
        return dict(self._json(f"/api/jobs/{quote(job, safe='')}"))

    def finished_frames(self, job: str) -> list[int]:
        """Returns the numbers of a job's finished frames, in order. Half frames are left out."""
        frames = self._json(f"/api/jobs/{quote(job, safe='')}/frames?state=finished")
        return sorted(int(frame["number"]) for frame in frames if float(frame["number"]).is_integer())

    def fetch(self, job: str, frame: int, path: Path, aov: str = "all") -> None:
        """Writes a frame as an .exr with the planes of `aov`. The file appears once it is complete."""
        part = path.with_name(f"{path.name}.part")
        with part.open("wb") as file:
            for data in self._read(f"/api/jobs/{quote(job, safe='')}/frames/{frame}/image.exr?aov={quote(aov)}"):
                file.write(data)
        part.replace(path)

    def _json(self, path: str) -> Any:
        try:
            return json.loads(b"".join(self._read(path)))
        except ValueError:
            raise FarmError(f"{self.server} is no farm: its answer is not JSON.") from None

    def _read(self, path: str) -> Iterator[bytes]:
        """Yields the body of an answer in parts. Raises FarmError, also if it ends early."""
        request = urllib.request.Request(self.server + path)
        if self._token:
            request.add_unredirected_header("Authorization", f"Bearer {self._token}")
        try:
            with urllib.request.urlopen(request, timeout=TIMEOUT_S) as answer:
                while data := answer.read(CHUNK):
                    yield data
                if answer.length:  # bytes that did not come, for which read() raises nothing
                    raise IncompleteRead(b"", answer.length)
        except urllib.error.HTTPError as error:
            raise FarmError(_sentence(error)) from None
        except (OSError, HTTPException) as error:
            raise FarmError(f"The farm at {self.server} does not answer ({error}).") from None


def _sentence(error: urllib.error.HTTPError) -> str:
    try:
        return str(json.loads(error.read())["detail"])
    except (ValueError, KeyError, TypeError, OSError):
        return f"The farm answers {error.code} {error.reason}."
