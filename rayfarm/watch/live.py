"""Follows a job on a farm: its state, frames, and the film of one frame, updated by a thread."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from protocol.live import FROM_SERVICE, Frames, JobState, WatchFrame
from protocol.pictures import decode_tile
from protocol.websocket import CLOSED, Acknowledge, read_service
from rayfarm.client import Client, ClientError
from rayfarm.responses import Frame, Job, read
from renderer.frames import frame_text
from renderer.image import rgbe9995
from renderer.settings import Tile

__all__ = ["LiveJob"]

PAUSES_S = (0.2, 1.0, 2.0, 5.0)
UNREACHABLE_TIMEOUT_S = 60.0
LOOK_EVERY_S = 0.5  # whether it is to end
ACTIVE = ("preparing", "running")


class LiveJob:
    """Current state of a job. `wake` is called in the thread after each update.

    While the farm is unreachable, retries for up to a minute.
    """

    def __init__(self, farm: Client, job: Job, frame: float | None, wake: Callable[[], None]) -> None:
        """Prepares to follow the job; `with` starts it. frame: the frame to show; None: always one that is being rendered."""
        self._farm = farm
        self._wake = wake
        self._lock = threading.Lock()
        self._socket: ClientConnection | None = None
        self._versions: dict[Tile, int] = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="live", daemon=True)
        self.job = job
        self.frames = {each.number: each for each in job.frames}
        self.follows = frame is None
        self.frame = frame if frame is not None else (job.frames[0].number if job.frames else 0.0)
        self.film: npt.NDArray[np.float32] | None = None
        self.trouble: str | None = None  # while the farm is away
        self.error: ClientError | None = None  # what ended the watching
        self.life = 0  # another one for every film
        self.changes = 0  # of what there is to see

    def __enter__(self) -> LiveJob:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        with self._lock:
            socket = self._socket
        if socket is not None:
            with contextlib.suppress(OSError):
                socket.close()
        self._thread.join(5)

    @property
    def watched_frame(self) -> Frame | None:
        """Returns the frame that is shown, or None before it is known."""
        return self.frames.get(self.frame)

    def versions(self) -> tuple[int, npt.NDArray[np.float32] | None, dict[Tile, int]]:
        """Returns the current film's sequence number, its linear radiance (height, width, 3), and a version of each changed tile.

        Pixels without samples are black. The radiance is None before the size is known.
        """
        with self._lock:
            return self.life, None if self.film is None else self.film.copy(), dict(self._versions)

    def watch_frame(self, frame: float) -> None:
        """Shows another frame of the shot."""
        with self._lock:
            self.frame = frame
            self._begin()
            socket = self._socket
        if socket is not None:
            with contextlib.suppress(ConnectionClosed, OSError):  # requested again after the reconnection
                socket.send(WatchFrame(frame).to_text())

    def _begin(self) -> None:
        self._versions.clear()
        self.life += 1
        self.changes += 1
        if self.job.width and self.job.height:
            self.film = np.zeros((self.job.height, self.job.width, 3), np.float32)

    def _run(self) -> None:
        away_since: float | None = None
        tries = 0
        while not self._stop.is_set():
            try:
                self._listen()
                away_since, tries = None, 0
            except ClientError as error:
                away_since = away_since or time.monotonic()
                gone = error.status is not None and error.status < 500
                if gone or time.monotonic() - away_since > UNREACHABLE_TIMEOUT_S:
                    self.error = error
                    self._wake()
                    return
                self.trouble = "The farm is away; it is tried again."
            except Exception as error:  # the screen must end with a sentence, and not stand still
                self.error = ClientError(f"What {self._farm.url} tells of the job cannot be read ({error}).")
                self._wake()
                return
            self._wake()
            self._stop.wait(PAUSES_S[min(tries, len(PAUSES_S) - 1)])
            tries += 1

    def _listen(self) -> None:
        """Receives messages until the connection ends. Raises ClientError if there is none or the job is gone."""
        with self._farm.socket(f"/api/jobs/{self.job.id}/live?frame={frame_text(self.frame)}") as socket:
            with self._lock:
                self._socket = socket
            try:
                while not self._stop.is_set():
                    with contextlib.suppress(TimeoutError):
                        self._handle_message(socket, socket.recv(timeout=LOOK_EVERY_S))
                        self.trouble = None
                        self._wake()
            except ConnectionClosed as closed:
                if closed.rcvd is not None and closed.rcvd.code in CLOSED:
                    raise ClientError(closed.rcvd.reason or "There is no such job.", 404) from None
                self.trouble = "The farm is away; it is tried again."
            finally:
                with self._lock:
                    self._socket = None

    def _handle_message(self, socket: ClientConnection, message: str | bytes) -> None:
        if isinstance(message, bytes):
            socket.send(Acknowledge(self._tile(message)).to_text())
            return
        match read_service(message, FROM_SERVICE):
            case JobState(job):
                self._update_job(read(Job, job))
            case Frames(frames):
                found = [read(Frame, each) for each in frames]
                self.frames |= {each.number: each for each in found}
                self._follow_rendering()

    def _update_job(self, job: Job) -> None:
        with self._lock:
            before, self.job = self.job, job
            if (job.width, job.height) != (before.width, before.height) or self.film is None:
                self._begin()
        if job.shot is None:
            self.frames = {each.number: each for each in job.frames}

    def _follow_rendering(self) -> None:
        """Switches to a frame of the shot that is being rendered, once the present one no longer is."""
        shown = self.watched_frame
        if not self.follows or (shown is not None and shown.state in ACTIVE):
            return
        under_way = sorted(number for number, frame in self.frames.items() if frame.state == "running")
        if under_way:
            self.watch_frame(under_way[0])

    def _tile(self, message: bytes) -> int:
        (frame, sequence, x, y, w, h, _), words = decode_tile(message)
        rgb = rgbe9995.unpack(words)
        with self._lock:
            film = self.film
            if film is not None and frame == int(self.frame) & 0xFFFF and film[y : y + h, x : x + w].shape == rgb.shape:
                film[y : y + h, x : x + w] = rgb
                self.changes += 1
                self._versions[Tile(x, y, w, h)] = self.changes
        return sequence
