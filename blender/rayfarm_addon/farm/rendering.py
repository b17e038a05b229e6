"""Renders one image on a farm in a thread: uploads, submits the job, receives tiles, fetches the result. Emits events."""

from __future__ import annotations

import contextlib
import queue
import secrets
import threading
import time
import urllib.parse
from collections.abc import Callable
from typing import Any

from . import exr
from .client import Cancelled, Client, FarmError
from .protocol.messages import JobState
from .protocol.pictures import decode_tile
from .protocol.websocket import Acknowledge, read_service
from .render_request import Failed, FinishedPicture, Light, RenderRequest, StatusMessage, TileUpdate
from .uploads import Uploads
from .websocket import Closed, Socket

__all__ = ["Rendering", "light_of"]

WAIT_S = 0.1
POLL_S = 0.5
TRIES = 20  # attempts to reach an unavailable farm: most of a minute
PAUSE_S = 3.0
FINAL_STATES = ("finished", "failed", "cancelled")

Event = StatusMessage | TileUpdate | FinishedPicture | Failed


class _OverError(FarmError):
    """Raised if the job has ended without success, so that retrying is useless."""


def light_of(light: Light, uploads: Uploads, progress: Callable[[int, int], None]) -> dict[str, Any] | None:
    """Returns the `environment` field of a job's request for a light; None to use the scene file's environment.

    An image is uploaded if the farm lacks it. Raises FarmError, or Cancelled if `progress` does.
    """
    if light.image is not None:
        id = uploads.environment(*light.image, progress)
        rotation = (light.rotation + 180) % 360 - 180
        return {"image": id, "strength": light.strength, "rotation": rotation}
    if light.is_own:
        return None
    return {"color": [max(c, 0.0) for c in light.color or [0.0] * 3]}


class Rendering:
    """The rendering of one image, started on creation. `events` is a queue; the last event is FinishedPicture or Failed."""

    def __init__(self, client: Client, uploads: Uploads, request: RenderRequest) -> None:
        self.events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._client, self._uploads, self._asked = client, uploads, request
        self._cancelled = threading.Event()
        self._job: str | None = None
        self._thread = threading.Thread(target=self._run, name="rayfarm picture", daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """Cancels the job on the farm. The final event is still emitted."""
        self._cancelled.set()

    def join(self, patience_s: float) -> None:
        """Waits until the last event was emitted, at most `patience_s` seconds."""
        self._thread.join(patience_s)

    def _run(self) -> None:
        try:
            self.events.put(self._picture())
        except Cancelled:
            self._cancel_job()
            self.events.put(Failed(None))
        except FarmError as error:
            if error.status == 404:
                self._uploads.clear()  # the farm no longer has the earlier uploads: everything is sent next time
            self.events.put(Failed(str(error)))
        except Exception as error:
            self.events.put(Failed(f"The add-on failed: {error!r}."))

    def _picture(self) -> FinishedPicture:
        asked, uploads = self._asked, self._uploads
        self._report("Sending the scene")
        found = uploads.upload_and_prepare(
            asked.files, asked.main, asked.title, self._report_upload, self._cancelled.is_set, self._report
        )
        scene, sent = found["id"], uploads.sent_bytes
        environment = light_of(asked.light, uploads, self._report_upload)
        request = {**asked.request, "scene": scene, "name": asked.title}
        request |= {} if environment is None else {"environment": environment}
        uploads.rendered.add(scene)
        job = self._client.json("POST", "/api/jobs", request, Idempotency_Key=secrets.token_hex(16))
        self._job = job["id"]
        number = job["frames"][0]["number"] if job.get("frames") else 0
        self._watch_job(number)
        return FinishedPicture(self._channels(number), self._job or "", sent, list(found["warnings"]))

    def _report(self, text: str, progress: float | None = None) -> None:
        self.events.put(StatusMessage(text, progress))

    def _report_upload(self, sent: int, size: int) -> None:
        if self._cancelled.is_set():
            raise Cancelled
        if size > 1 << 20:
            self._report(f"Sending the scene: {sent / 1e6:.0f} of {size / 1e6:.0f} MB")

    def _cancel_job(self) -> None:
        if self._job is not None:
            with contextlib.suppress(FarmError):  # it has already ended, or the farm is unavailable
                self._client.json("PATCH", f"/api/jobs/{self._job}", {"state": "cancelled"})

    def _watch_job(self, number: float) -> None:
        """Emits the progress of job `number` until it ends.

        Requests to an unreachable farm are repeated for a while, then FarmError is raised.
        """
        failures = 0
        while True:
            try:
                if self._listen(number):
                    return
            except _OverError:
                raise
            except (Closed, FarmError):
                pass  # the request below reports errors; if only the live channel failed, polling replaces it
            try:
                if self._report_state(self._client.json("GET", f"/api/jobs/{self._job}")):
                    return
                failures = 0
            except FarmError as error:
                failures += 1
                if isinstance(error, _OverError) or failures > TRIES or (error.status is not None and error.status < 500):
                    raise
                self._report("The farm does not answer; asking again")
            self._pause(min(POLL_S * (1 + failures), PAUSE_S))

    def _pause(self, seconds: float) -> None:
        if self._cancelled.wait(seconds):
            raise Cancelled

    def _listen(self, number: float) -> bool:
        """Receives the tiles and states of job `number` from its live channel; returns True once the job has ended.

        Raises Closed or FarmError if the channel fails, Cancelled if the user cancels.
        """
        frame = urllib.parse.quote(f"{number:g}")
        socket = Socket(self._client, f"/api/jobs/{self._job}/live?frame={frame}")
        last = time.monotonic()
        try:
            while True:
                if self._cancelled.is_set():
                    raise Cancelled
                message = socket.receive(WAIT_S)
                if isinstance(message, bytes):
                    tile = decode_tile(message)
                    self.events.put(TileUpdate(tile.head.x, tile.head.y, tile.words))
                    socket.send(Acknowledge(tile.head.seq).to_text())
                elif message is not None:
                    told = read_service(message, (JobState,))
                    if told is not None and self._report_state(told.job):
                        return True
                elif time.monotonic() - last > 10:
                    last = time.monotonic()
                    if self._report_state(self._client.json("GET", f"/api/jobs/{self._job}")):
                        return True
        finally:
            socket.close()

    def _report_state(self, job: dict[str, Any]) -> bool:
        state = job["state"]
        if state == "failed":
            raise _OverError(f"The farm could not render it: {job['error']}")
        if state == "cancelled":
            self._job = None
            raise _OverError("The job was cancelled on the farm's page.")
        text = {"queued": "Waiting for workers", "paused": "Paused on the farm's page"}.get(state, "Rendering")
        if job.get("message"):
            text = str(job["message"])
        elif job.get("eta_s"):
            text += f", {job['eta_s']:.0f} s left"
        self._report(text, float(job["progress"]))
        return state in FINAL_STATES

    def _channels(self, number: float) -> dict[str, Any]:
        path = f"/api/jobs/{self._job}/frames/{number:g}/image.exr"
        planes = ",".join(["color", *self._asked.planes]) if self._asked.planes else "color"
        self._report("Fetching the picture", 1.0)
        found = self._exr(f"{path}?aov={planes}")
        if self._asked.denoise:
            self._report("Denoising", 1.0)
            found |= {name: plane for name, plane in self._exr(f"{path}?denoise=true").items() if name in "RGB"}
        return found

    def _exr(self, path: str) -> dict[str, Any]:
        if self._cancelled.is_set():
            raise Cancelled
        _, _, body = self._client.request("GET", path, patience_s=300.0)
        try:
            return dict(exr.read(body))
        except ValueError as error:
            raise FarmError(f"The farm's picture cannot be read: {error}.") from None
