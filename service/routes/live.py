"""WS /api/jobs/{id}/live: a job's state as JSON, its frames' states, and the tiles of one frame as they change.

The client first gets the state and a snapshot: all tiles of the frame that have samples. Then it gets changes. By sending
{"frame": n} it selects another frame, of which it gets a snapshot. A client that fetches the film itself (GET
.../frames/{n}/film) requests no snapshot; it then sends {"have": [samples per pixel of every tile]}, and receives the tiles
that differ.

For a shot, the states of all frames are sent first, and then those that change. Tiles are sent in rounds. Every packet has a
number; the client answers {"ack": number}, which acknowledges all packets up to it. At most two rounds are unacknowledged. In
the meantime changed tiles are only recorded, and read from the film when their round is sent, so a slow client gets fewer
pictures, but never outdated ones.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import deque
from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any

from fastapi import Query, WebSocket, WebSocketDisconnect
from sqlalchemy import select
from starlette.concurrency import run_in_threadpool

from protocol.live import FROM_CLIENT, Frames, Have, JobState, WatchFrame
from protocol.pictures import encode_tile
from protocol.websocket import GONE, NOT_FOUND, Acknowledge, FromClient, read_client
from renderer.frames import MAX_FRAME, frame_key
from renderer.sentences import Sentence
from service.errors import FarmError
from service.farm import Farm
from service.http.farm import FarmDependency
from service.http.routers import api_router
from service.http.websocket_messages import throttled_messages
from service.jobs.describe import job_out
from service.jobs.describe_frames import frame_numbers, plain_frames
from service.jobs.lookup import job_not_found
from service.scheduling.jobs.active_frame import FrameNumbers
from service.store.films import Film
from service.store.models import ACTIVE_STATES, Frame, Job
from service.watching.broadcast import Listener

__all__ = ["router"]

router = api_router()

MAX_UNACKNOWLEDGED = 2  # rounds
KEEP_ALIVE_EVERY_S = 5.0
FRAMES_PER_MESSAGE = 2000  # frames in one message
FRAMES_PAUSE_FACTOR = 20  # minimum pause between frame updates, as a multiple of their CPU time
MAX_MESSAGE_CHARACTERS = 1 << 16  # characters of a message without its list of tiles; it is parsed on the event loop
CHARACTERS_PER_TILE = 16  # characters for a tile's samples
ASSUMED_TILES = 1 << 16  # assumed while the number of tiles is unknown


@router.websocket("/api/jobs/{id}/live")
async def live(
    socket: WebSocket,
    id: str,
    farm: FarmDependency,
    frame: Annotated[float | None, Query(ge=0, le=MAX_FRAME, multiple_of=0.5, allow_inf_nan=False)] = None,
    snapshot: bool = True,
) -> None:
    """Sends a job's state, and the tiles of one frame as they change.

    frame: the frame number; null: the first frame. snapshot: whether to send all tiles first.
    """
    await socket.accept()
    first = await run_in_threadpool(_first_frame, farm, id)
    if first is None:
        await socket.close(NOT_FOUND, str(job_not_found(id))[:120])
        return
    with farm.broadcast.listen(id, first if frame is None else frame_key(frame)) as listener:
        watcher = _Watcher(socket, id, farm, listener, snapshot)
        sending = asyncio.create_task(watcher.send())
        receiving = asyncio.create_task(watcher.receive())
        done, pending = await asyncio.wait((sending, receiving), return_when=asyncio.FIRST_COMPLETED)
        for task in pending:
            task.cancel()
        for task in (*done, *pending):
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError, OSError):
                await task


class _Watcher:
    def __init__(self, socket: WebSocket, job: str, farm: Farm, listener: Listener, snapshot: bool) -> None:
        self._socket = socket
        self._job = job
        self._farm = farm
        self._listener = listener
        self._film: Film | None = None
        self._snapshot = snapshot
        self._wanted: tuple[int, bool] | None = None  # the requested frame, and whether with a snapshot
        self._have: list[Any] | None = None  # the client's samples of every tile, to be compared
        self._sequence = 0
        self._rounds: deque[int] = deque()  # number of the last packet of every unacknowledged round
        self._spoke = 0.0
        self._state_at = 0.0
        self._sent_frames: dict[int, FrameNumbers] = {}  # frame numbers of a shot, as last sent
        self._frames_at = 0.0  # earliest time of the next frame update

    async def receive(self) -> None:
        """Processes the client's messages until it disconnects. Ignores malformed messages."""
        async for text in throttled_messages(self._socket):
            tiles = ASSUMED_TILES if self._film is None else len(self._film.tiles)
            if len(text) > MAX_MESSAGE_CHARACTERS + CHARACTERS_PER_TILE * tiles:
                continue
            with contextlib.suppress(ValueError, TypeError, OverflowError, RecursionError):
                self._handle_message(read_client(text, FROM_CLIENT))

    def _handle_message(self, message: FromClient | None) -> None:
        """Processes one message of the client. Raises ValueError if it is malformed."""
        match message:
            case WatchFrame(frame, snapshot):
                self._wanted, self._have = (_frame(frame), snapshot), None
                self._listener.wake()
            case Have(samples):
                self._have = samples
                self._listener.wake()
            case Acknowledge(seq) if self._rounds and self._rounds[0] <= seq:
                while self._rounds and self._rounds[0] <= seq:
                    self._rounds.popleft()
                self._listener.wake()

    def _switch_frame(self) -> None:
        """Switches to the frame that the client requested last, and skips earlier requests."""
        if self._wanted is None:
            return
        (self._listener.frame, self._snapshot), self._wanted = self._wanted, None
        self._listener.tiles.clear()
        if self._film is not None:
            self._queue_all_tiles(self._film)

    def _queue_all_tiles(self, film: Film) -> None:
        """Queues all tiles of the frame for sending, unless the client has requested no snapshot."""
        if self._snapshot:
            self._listener.tiles.update(dict.fromkeys(range(len(film.tiles))))

    async def _queue_differing_tiles(self, film: Film, have: list[Any]) -> None:
        """Queues the tiles whose numbers of samples differ from the client's list.

        have: samples per pixel by tile. If it has another length than the list of tiles, queues all tiles.
        """
        frame = self._listener.frame
        counts = await run_in_threadpool(lambda: [film.coverage(frame, tile).total for tile in range(len(film.tiles))])
        if frame == self._listener.frame:
            differ = have if len(have) == len(counts) else [None] * len(counts)
            self._listener.tiles.update((tile, None) for tile, (a, b) in enumerate(zip(differ, counts, strict=True)) if a != b)

    async def send(self) -> None:
        """Sends states and tiles until the service stops or the job is deleted."""
        self._listener.changed["job", self._job] = None
        while not self._farm.broadcast.closing:
            if self._film is None:
                self._film = await run_in_threadpool(_film, self._farm, self._job)
                if self._film is not None:
                    self._queue_all_tiles(self._film)
            self._switch_frame()
            if self._film is not None and self._have is not None:
                have, self._have = self._have, None
                with contextlib.suppress(FarmError):  # tiles that cannot be compared now are queued when they change
                    await self._queue_differing_tiles(self._film, have)
            now = time.monotonic()
            if self._is_state_due(now) and not await self._send_state(now):
                await self._socket.close(GONE, Sentence("job-deleted", "The job was deleted."))
                return
            if self._film is not None and self._listener.tiles and len(self._rounds) < MAX_UNACKNOWLEDGED:
                try:
                    await self._send_tiles(self._film)
                except FarmError:  # job deleted, film unreadable or service stopping, as the next state shows
                    self._film = None
                    self._listener.changed["job", self._job] = None
                    self._listener.tiles.clear()
                    self._state_at = 0.0
                    continue
                await asyncio.sleep(self._farm.settings.live_interval)
            else:
                await self._listener.wait(self._farm.shared.state_every_s if self._listener.changed else 1.0)
        await self._socket.close(1012, Sentence("service-stopping", "The service is shutting down."))

    def _is_state_due(self, now: float) -> bool:
        if now - self._spoke > KEEP_ALIVE_EVERY_S:
            return True
        return bool(self._listener.changed) and now - self._state_at >= self._farm.shared.state_every_s

    async def _send_state(self, now: float) -> bool:
        self._listener.changed.clear()
        self._state_at = self._spoke = now
        state, text = await self._farm.shared.shared_result(self._job, "state", partial(_job_state, self._farm, self._job))
        if state is None:
            return False
        await self._socket.send_text(text)
        if state["shot"] is not None and now < self._frames_at and state["state"] in ACTIVE_STATES:
            self._listener.changed["job", self._job] = None  # send again later
        elif state["shot"] is not None:
            job, frames, taken_s = await self._farm.shared.shared_result(
                self._job, "frames", partial(_frames, self._farm, self._job)
            )
            self._frames_at = now + FRAMES_PAUSE_FACTOR * taken_s
            before, self._sent_frames = self._sent_frames, frames
            for text in await run_in_threadpool(_frame_messages, job, before, frames):
                await self._socket.send_text(text)
        return True

    async def _send_tiles(self, film: Film) -> None:
        chosen, pixels, most = [], 0, self._farm.shared.round_pixels
        for tile in list(self._listener.tiles):
            if pixels >= most:
                break
            del self._listener.tiles[tile]
            chosen.append(tile)
            pixels += film.tiles[tile].w * film.tiles[tile].h
        frame = self._listener.frame
        packed = await self._farm.shared.tiles(self._job, film, frame, chosen)
        if not packed or frame != self._listener.frame:
            return
        self._rounds.append(self._sequence + len(packed))
        for tile, spp, words in packed:
            self._sequence += 1
            await self._socket.send_bytes(encode_tile(frame // 2, self._sequence, film.tiles[tile], spp, words))
        self._spoke = time.monotonic()


def _frame(number: float) -> int:
    """Returns the frame key of a frame number. Raises ValueError."""
    if not 0 <= number <= MAX_FRAME or not (2 * number).is_integer():
        raise ValueError(f"there is no frame {number}")
    return frame_key(number)


def _first_frame(farm: Farm, id: str) -> int | None:
    with farm.sessions() as session:
        return session.scalar(select(Frame.number).where(Frame.job == id).order_by(Frame.number).limit(1))


def _frames(farm: Farm, id: str) -> tuple[Job | None, dict[int, FrameNumbers], float]:
    """Returns a job, the numbers of its frames by key, and the processor time, in seconds, that reading them took."""
    begun = time.thread_time()
    with farm.sessions() as session:
        job = session.get(Job, id)
        found = {} if job is None else dict(frame_numbers(job, session, farm.engine))
    return job, found, time.thread_time() - begun


def _frame_messages(job: Job | None, before: Mapping[int, FrameNumbers], now: Mapping[int, FrameNumbers]) -> list[str]:
    """Returns messages about the frames whose numbers differ, each with at most FRAMES_PER_MESSAGE frames.

    before, now: numbers by frame key, as sent last and as they are.
    """
    changed = [(key, numbers) for key, numbers in now.items() if before.get(key) != numbers]
    some = (changed[at : at + FRAMES_PER_MESSAGE] for at in range(0, len(changed), FRAMES_PER_MESSAGE))
    return [Frames(plain_frames(job, part)).to_text() for part in some] if job is not None else []


def _job(farm: Farm, id: str) -> Job | None:
    with farm.sessions() as session:
        return session.get(Job, id)


def _film(farm: Farm, id: str) -> Film | None:
    job = _job(farm, id)
    try:
        return farm.film(job) if job is not None else None
    except FarmError:
        return None  # the reason is in the job's state


def _job_state(farm: Farm, id: str) -> tuple[dict[str, Any] | None, str]:
    """Returns a job's state as JSON data, and as an encoded message."""
    with farm.sessions() as session:
        job = session.get(Job, id)
        state = None if job is None else job_out(job, session, farm.engine).model_dump()
    return state, JobState(state).to_text() if state is not None else ""
