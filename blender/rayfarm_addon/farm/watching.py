"""A live view of a scene: a thread that sends scenes and cameras to the farm and stores the newest image."""

from __future__ import annotations

import contextlib
import threading
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .client import Cancelled, Client, FarmError
from .packets import ProgressiveView
from .protocol.messages import Look, Refused, ViewState
from .protocol.websocket import Acknowledge, read_service
from .render_request import Light
from .rendering import light_of
from .uploads import Uploads
from .websocket import Closed, Socket

__all__ = ["LiveView", "ViewPicture"]

WAIT_S = 0.02
RETRY_S = 2.0


@dataclass(frozen=True)
class ViewPicture:
    """An image of a view that the farm has rendered.

    rgb: (h, w, 3) linear, rows from the top. id: number of the view. whole: size of the complete view. samples: per pixel. done:
    True if no better image follows.
    """

    rgb: npt.NDArray[np.float32]
    id: int
    whole: tuple[int, int]
    samples: float
    done: bool


class LiveView:
    """A thread that keeps the image of one viewport up to date.

    Only `join` blocks. If several scenes or views have been set, only the newest is shown.
    """

    def __init__(self, client: Client, uploads: Uploads, title: str) -> None:
        self._client, self._uploads, self._title = client, uploads, title
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._scene: tuple[dict[str, Any], str, Light] | None = None
        self._looks_at: Any = None  # the scene that arriving pictures show
        self._view: dict[str, Any] | None = None
        self._number = 0
        self._ended = False
        self._shown: ViewPicture | None = None
        self._text = "Waiting for the scene"
        self.is_fresh = threading.Event()  # set when there is something new to draw
        self._thread = threading.Thread(target=self._run, name="rayfarm view", daemon=True)
        self._thread.start()

    def set_scene(self, files: dict[str, Any], main: str, light: Light) -> None:
        """Sets the scene to be shown."""
        with self._lock:
            self._scene = files, main, light
        self._wake.set()

    def set_view(self, view: dict[str, Any]) -> int:
        """Sets the view: a request without scene and light. Returns its number, the `id` of its images."""
        with self._lock:
            self._number += 1
            self._view = {**view, "id": self._number}
            return self._number

    @property
    def picture_and_status(self) -> tuple[ViewPicture | None, str]:
        """Returns the newest image and a status line for the user."""
        with self._lock:
            return self._shown, self._text

    @property
    def number(self) -> int:
        """The number of the view that was set last, which is the `id` of that view's images."""
        return self._number

    @property
    def is_up_to_date(self) -> bool:
        """True if the newest image shows the newest scene."""
        return self._looks_at is not None and self._looks_at is self._scene

    def close(self) -> None:
        """Ends the view and its thread."""
        self._ended = True
        self._wake.set()

    def join(self, patience_s: float) -> None:
        """Waits until the thread has ended, at most `patience_s` seconds."""
        self._thread.join(patience_s)

    def _report(self, text: str) -> None:
        with self._lock:
            if text == self._text:
                return
            self._text = text
        self.is_fresh.set()

    def _run(self) -> None:
        while not self._ended:
            try:
                self._show_scene()
            except Cancelled:
                continue
            except (FarmError, Closed) as error:
                self._report(str(error) or "The farm has ended the connection")
                self._wake.wait(RETRY_S)
                self._wake.clear()
            except Exception as error:
                self._report(f"The add-on failed: {error!r}")
                self._wake.wait(RETRY_S)
                self._wake.clear()

    def _report_upload(self, sent: int, size: int) -> None:
        if self._ended:
            raise Cancelled
        if size > 1 << 20:
            self._report(f"Sending the scene: {sent / 1e6:.0f} of {size / 1e6:.0f} MB")

    def _show_scene(self) -> None:
        """Shows one scene until another scene is set.

        Raises FarmError or Closed if the farm or the connection fails, Cancelled if the view ends.
        """
        with self._lock:
            wanted = self._scene
        if wanted is None:
            self._wake.wait(1.0)
            self._wake.clear()
            return
        files, main, light = wanted
        before = self._uploads.scene
        title = f"{self._title} (viewport)"
        found = self._uploads.upload_and_prepare(
            files, main, title, self._report_upload, lambda: self._ended or self._scene is not wanted, self._report
        )
        scene = str(found["id"])
        environment = light_of(light, self._uploads, self._report_upload)
        if before is not None and before != scene:
            self._delete_scene(before)
        socket = Socket(self._client, f"/api/scenes/{scene}/viewport")
        try:
            self._receive(socket, wanted, environment)
        finally:
            socket.close()

    def _receive(self, socket: Socket, requested_view: Any, environment: dict[str, Any] | None) -> None:
        sent, picture = 0, ProgressiveView()
        samples, done = 0.0, False
        while not self._ended and self._scene is requested_view:
            with self._lock:
                view = self._view
            if view is not None and view["id"] != sent:
                sent, done = view["id"], False
                self._report("Rendering")
                socket.send(Look(view if environment is None else {**view, "environment": environment}).to_text())
            message = socket.receive(WAIT_S)
            if isinstance(message, bytes):
                picture.add_packet(message)
                socket.send(Acknowledge(picture.seq).to_text())
                self._store_picture(ViewPicture(picture.rgb.copy(), picture.id, picture.whole, samples, done), requested_view)
            elif message is not None:
                told = read_service(message, (ViewState, Refused))
                if isinstance(told, Refused):
                    self._report(told.detail)
                elif isinstance(told, ViewState) and told.id in (None, sent):
                    samples, done = told.mean, told.done
                    self._report(told.message or f"{samples:.0f} samples" + (", done" if done else ""))

    def _store_picture(self, picture: ViewPicture, scene: Any) -> None:
        with self._lock:
            self._shown, self._looks_at = picture, scene
        self.is_fresh.set()

    def _delete_scene(self, scene: str) -> None:
        with contextlib.suppress(FarmError):  # a job uses it, or the farm is unavailable
            self._uploads.delete_viewed(scene)
