"""WS /api/scenes/{id}/viewport: interactive views of a scene. No job is created, and only a poster is stored.

Messages: protocol/viewport.py; pictures: protocol/pictures.py. First a small picture is sent, then the whole view with an
increasing number of samples. With graphics cards, a draft of the view comes first, and all else when no further view has been
requested for a while. A picture contains the tiles whose samples have grown by half since they were last sent, and all
tiles that are complete. At most two pictures are unacknowledged, so a slow client gets fewer pictures, but never outdated ones.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections import deque
from dataclasses import replace
from typing import Annotated, Any

from fastapi import WebSocket, WebSocketDisconnect
from pydantic import Field, ValidationError
from starlette.concurrency import run_in_threadpool

from protocol.viewport import FROM_CLIENT, Look, Pause, People, Pick, Presence, Refused, TakesChanged, ViewState
from protocol.websocket import NOT_FOUND, Acknowledge, FromService, read_client
from renderer.sentences import Sentence, encoded, with_full_stop
from service.errors import FarmError, NotFound
from service.farm import Farm
from service.http.farm import FarmDependency
from service.http.problems import validation_message
from service.http.routers import api_router
from service.http.visit import VisitDependency
from service.http.websocket_messages import throttled_messages
from service.intake.names import plain_title
from service.jobs.lookup import find_scene
from service.models.jobs import JobIn, ViewModel
from service.models.notes import MAX_AUTHOR
from service.models.strict import Strict
from service.viewing.session import ViewSession
from service.viewing.view_request import ViewRequest, move_view, resolve_view, shows_home

__all__ = ["router"]

router = api_router()

MAX_UNACKNOWLEDGED = 2
STATE_EVERY_S = 0.2
PEOPLE_EVERY_S = 0.1
MAX_EXPOSURE = 32  # stops
KEEP_ALIVE_EVERY_S = 5.0
MAX_WAIT_S = 0.25
PREPARING_POLL_S = 0.1
SUPERSEDED_WAIT_S = 3.0  # seconds to wait for an environment that is already superseded
RETRY_EVERY_S = 1.0  # seconds between attempts to render a view
SCENE_VALID_S = 1.0  # seconds for which a scene's row is not read again while only the camera moves
MAX_MESSAGE_BYTES = 1 << 16  # of a message
INVALID_MESSAGE = Sentence(
    "view-message-invalid",
    'The message is invalid. Send a view, {"pick": [x, y]}, {"ack": seq} or {"paused": true}, '
    "as a JSON object of at most {most} characters.",
    most=MAX_MESSAGE_BYTES,
)


class ViewIn(JobIn):
    """A requested view: the fields of a job's request, and three of its own.

    id: a number, chosen by the page. alpha: whether a transparent background is sent as alpha; otherwise it is visible. draft:
    exposure, in stops, for which drafts are encoded; null: none are sent.
    """

    id: int = Field(ge=0, lt=1 << 32)
    scene: str = Field("", max_length=100)
    noise: float | None = Field(None, gt=0, allow_inf_nan=False)
    alpha: bool = False
    draft: float | None = Field(None, ge=-MAX_EXPOSURE, le=MAX_EXPOSURE, allow_inf_nan=False)


Heights = Annotated[float, Field(ge=-100, le=100, allow_inf_nan=False)]  # lengths in heights of the picture


class PresenceIn(Strict):
    """A viewer's name, cursor and view, which are sent to the scene's other viewers (`Presence`)."""

    name: str | None = Field(None, max_length=MAX_AUTHOR)
    cursor: tuple[Heights, Heights] | None = None
    view: ViewModel | None = None


@router.websocket("/api/scenes/{id}/viewport")
async def viewport(socket: WebSocket, id: str, farm: FarmDependency, visit: VisitDependency) -> None:
    """Serves interactive views of a scene to one page."""
    await socket.accept()
    try:
        await run_in_threadpool(find_scene, id, farm)
    except NotFound as error:
        await socket.close(NOT_FOUND, str(error)[:120])
        return
    except FarmError as error:
        await socket.close(1013, str(error)[:120])
        return
    viewer = _Viewer(socket, id, farm, visit.user)
    tasks = [asyncio.create_task(each) for each in (viewer.receive(), viewer.resolve_views(), viewer.send())]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        farm.posters.end_session(viewer.session)
        farm.visitors.leave(viewer.person)
        try:
            for task in tasks:
                task.cancel()
            for task in tasks:
                with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError, OSError):
                    await task
        finally:
            viewer.release()


class _Viewer:
    def __init__(self, socket: WebSocket, scene: str, farm: Farm, user: str | None) -> None:
        self._socket = socket
        self._user = user
        self._scene = scene
        self._farm = farm
        self._changed = asyncio.Event()
        self._asked = asyncio.Event()
        self._ask: ViewIn | None = None
        self._awaited: ViewIn | None = None  # the view whose environment is being prepared
        self._patient_until = 0.0
        self._errors: deque[Refused] = deque(maxlen=16)
        self._unacknowledged: deque[int] = deque()
        self._seq = 0
        self._sent_state: ViewState | None = None
        self._told_error: Refused | None = None
        self._sent_at = 0.0
        self._notice: str | None = None  # why the requested view is not rendered yet
        self._rests_s = RETRY_EVERY_S
        self._held: str | None = None  # id of the scene's row
        self._resolved: tuple[ViewIn, ViewRequest, float] | None = None  # the latest that was looked up, and when
        self.person = farm.visitors.enter(scene, user, self._changed.set)
        self._sent_people: list[dict[str, Any]] = []
        self._people_sent_at = 0.0
        self._sent_take_changes = 0
        loop = asyncio.get_running_loop()

        def wake() -> None:
            with contextlib.suppress(RuntimeError):  # the loop is closed
                loop.call_soon_threadsafe(self._changed.set)

        self.session = ViewSession(wake)

    async def receive(self) -> None:
        """Processes messages until the page disconnects."""
        async for text in throttled_messages(self._socket):
            try:
                self._handle_message(text)
            except ValidationError as error:
                self._queue_error(with_full_stop(validation_message(error.errors()[0])))
            except FarmError as error:
                self._queue_error(str(error))
            except (ValueError, TypeError, OverflowError, RecursionError):
                self._queue_error(INVALID_MESSAGE)

    def _handle_message(self, text: str) -> None:
        """Processes one message of the page. Raises ValueError, TypeError, OverflowError or RecursionError."""
        if len(text) > MAX_MESSAGE_BYTES:
            raise ValueError("too long")
        match read_client(text, FROM_CLIENT):
            case Acknowledge(seq):
                while self._unacknowledged and self._unacknowledged[0] <= seq:
                    self._unacknowledged.popleft()
                self._changed.set()
            case Pick(x, y):
                self._farm.views.pick(self.session, x, y)
            case Pause(paused):
                self._farm.views.pause(self.session, paused)
                self._farm.visitors.update(self.person, is_away=paused or self.person.view is None)
            case Presence(presence):
                self._show_presence(PresenceIn.model_validate(presence))
            case Look(view):
                self._ask = ViewIn.model_validate(view)
                self._asked.set()
            case None:
                raise ValueError("no known key")

    def _show_presence(self, shown: PresenceIn) -> None:
        """Shows others the cursor and camera of this page's user. Raises Invalid if the name has control characters."""
        name = self._user or plain_title(shown.name or "") or None
        view = None if shown.view is None else shown.view.model_dump(mode="json")
        is_away = self.session.is_paused or view is None
        self._farm.visitors.update(self.person, name=name, cursor=shown.cursor, view=view, is_away=is_away)

    def _queue_error(self, detail: str, id: int | None = None) -> None:
        self._errors.append(Refused(id, detail))
        self._changed.set()

    async def resolve_views(self) -> None:
        """Resolves the view that was requested last and starts rendering it; runs until cancelled.

        Environments are prepared one after another, and each prepared one is shown: while the sun is dragged, new ones are
        requested faster than they can be prepared.
        """
        while True:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._asked.wait(), self._rests_s)
            is_new = self._asked.is_set()
            self._asked.clear()
            newest, awaited = self._ask, self._awaited
            if newest is None or not (is_new or self._may_have_been_compiled()):
                continue
            self._notice, self._rests_s = None, RETRY_EVERY_S
            if awaited is None or awaited is newest or time.monotonic() > self._patient_until:
                if not await self._try_to_resolve(newest, makes=True, tries_again=is_new) and self._awaited is not newest:
                    self._awaited, self._patient_until = newest, time.monotonic() + SUPERSEDED_WAIT_S
            elif not await self._try_to_resolve(newest, makes=False) and await self._try_to_resolve(awaited, makes=True):
                self._asked.set()

    async def _try_to_resolve(self, ask: ViewIn, makes: bool, tries_again: bool = False) -> bool:
        """Resolves a requested view. Returns True if it is being rendered or was rejected, False while it is being prepared.

        ask, makes, tries_again: as for `_resolve`. Does not raise FarmError: queues it as a message for the page.
        """
        try:
            view = self._move(ask) if tries_again else None
            if view is None:
                view = await run_in_threadpool(self._resolve, ask, makes, tries_again)
        except FarmError as error:
            self._queue_error(str(error), ask.id)
            self._ask = None if ask is self._ask else self._ask
        else:
            if view is None:
                of_light = self._held != self._scene
                self._notice = (
                    Sentence("progress-scene-light", "The scene is being prepared with this light.")
                    if of_light
                    else Sentence("progress-scene", "The scene is being prepared.")
                )
                self._rests_s = PREPARING_POLL_S
                return False
            self._farm.views.request_view(self.session, view)
            self._notice = None
        self._awaited = None
        return True

    def _may_have_been_compiled(self) -> bool:
        """Returns True if the view must be resolved again, since the scene may now be compiled for the connected workers."""
        return self._notice is not None or (self.session.request is not None and self.session.message is not None)

    def _resolve(self, ask: ViewIn, makes: bool, tries_again: bool) -> ViewRequest | None:
        """Returns the view to render; None while its scene is being prepared. Raises FarmError.

        ask: the requested view. makes: whether to create the scene with the requested lighting if it does not exist; otherwise
        the result is None then. tries_again: with `makes`, whether to prepare a scene again whose preparation failed.
        """
        request = ask.model_dump(mode="json", exclude={"id", "alpha", "draft"})
        lighting = self._farm.lighting
        row = None if tries_again else lighting.find_row(self._scene, request)
        if row is None and makes:
            row = lighting.row(self._scene, request)
        if row is None or (row.status == "preparing" and not makes):
            return None
        if row.id != self._held:
            lighting.hold(row.id)
            self.release()
            self._held, self._resolved = row.id, None
        if row.status == "preparing":
            return None
        view = resolve_view(ask.id, request, row, ask.is_shot, ask.numbers()[0], ask.alpha, ask.draft)
        view = replace(view, is_home=shows_home(view, row))
        self._resolved = ask, view, time.monotonic()
        return view

    def _move(self, ask: ViewIn) -> ViewRequest | None:
        """Returns the view to render if it differs in its camera alone from one looked up a moment ago; otherwise None."""
        if self._resolved is None or ask.view is None or ask.views:
            return None
        known, view, at = self._resolved
        is_same = known.view is not None and ask.model_copy(update={"id": known.id, "view": known.view}) == known
        if not is_same or time.monotonic() - at > SCENE_VALID_S:
            return None
        return move_view(view, ask.id, ask.view.model_dump(mode="json"))

    def release(self) -> None:
        """Releases the scene that was derived for the current view's lighting, so that it can be deleted."""
        if self._held is not None:
            self._farm.lighting.release(self._held)
            self._held = None

    async def send(self) -> None:
        """Sends pictures and states until the service stops."""
        while not self._farm.broadcast.closing:
            while self._errors:
                await self._socket.send_text(_encoded_message(self._errors.popleft()))
            while self.session.picked:
                await self._socket.send_text(_encoded_message(self.session.picked.pop(0)))
            picture = None
            if not self.session.is_paused and len(self._unacknowledged) < MAX_UNACKNOWLEDGED:
                picture = self.session.take_draft(self._seq + 1)  # is encoded already
                if picture is None and self.session.is_picture_due():
                    picture = await run_in_threadpool(self.session.take_packet, self._seq + 1)
            if picture is not None:
                self._seq += 1
                self._unacknowledged.append(self._seq)
                await self._socket.send_bytes(picture)
            await self._send_state()
            await self._send_people()
            if self.person.take_changes != self._sent_take_changes:
                self._sent_take_changes = self.person.take_changes
                await self._socket.send_text(TakesChanged(self._sent_take_changes).to_text())
            if picture is None:
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._changed.wait(), MAX_WAIT_S)
                self._changed.clear()
        await self._socket.close(1012, Sentence("service-stopping", "The service is shutting down."))

    async def _send_people(self) -> None:
        people, now = self._farm.visitors.others(self.person), time.monotonic()
        if people != self._sent_people and now - self._people_sent_at > PEOPLE_EVERY_S:
            self._sent_people, self._people_sent_at = people, now
            await self._socket.send_text(People(people).to_text())

    async def _send_state(self) -> None:
        session, now = self.session, time.monotonic()
        if session.request is None:
            state = ViewState(None, message=self._notice)
        else:
            id, mean, message = session.request.id, round(session.mean_samples, 1), self._notice or session.message
            progress = session.samples, session.max_samples, mean, session.noise, session.is_done, session.slots
            shown = session.denoised_samples
            samples = None if shown is None else round(shown, 1)
            state = ViewState(id, *progress, message, session.is_denoised, samples, session.denoises, _rounded(session.sample_s))
            if session.error is not None and self._told_error != (refused := Refused(id, session.error)):
                self._told_error = refused
                await self._socket.send_text(_encoded_message(refused))
        has_changed = state != self._sent_state
        is_urgent = has_changed and state.message != (self._sent_state and self._sent_state.message)
        if is_urgent or now - self._sent_at > (STATE_EVERY_S if has_changed else KEEP_ALIVE_EVERY_S):
            self._sent_state, self._sent_at = state, now
            await self._socket.send_text(_encoded_message(state))


def _rounded(seconds: float | None) -> float | None:
    return None if seconds is None else float(f"{seconds:.3g}")


def _encoded_message(message: FromService) -> str:
    """Encodes a message as JSON. Sentences in it also have their codes, by which the page translates them."""
    return json.dumps(encoded({"type": message.TYPE, **vars(message)}))
