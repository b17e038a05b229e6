"""Scheduler of live views: one thread sends pieces of the views to workers and adds up their results.

Views use no jobs, films or database. Their messages have a queue that slots check first. The sums are held in memory, and are
discarded when the viewer leaves. Lost pieces are sent again. A page that has had no picture yet precedes the other views. Pieces
go to graphics cards first, if they render the view and are not busy with batches, and to CPU slots besides. While a view already
shows a complete picture, it shares the slots with other waiting work, such as preparing the scene with other lighting.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import redis

from protocol.card import card_queue
from protocol.contract import FrameInfo, denoise_queue, prepare_queue, render_queue
from protocol.sums import unpack_sums
from protocol.view_parts import (
    VIEW_ANSWERS,
    Part,
    ViewAnswer,
    ViewDenoise,
    ViewFrame,
    ViewParts,
    card_view_queue,
    view_key,
    view_queue,
)
from renderer.errors import SettingsError
from renderer.film import ALBEDO, ALPHA_PLANES, CHANNELS, COLOR, NORMAL, SAMPLES, alpha_plane
from renderer.sentences import Sentence, with_full_stop
from renderer.settings import Tile
from service.errors import QueueError
from service.events import Events
from service.scheduling.artifacts.unfit_machines import MachineFault, UnfitMachines
from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.faults.redis_errors import redis_fault
from service.scheduling.snapshot import SnapshotHolder
from service.viewing.first_pictures import FirstPictures
from service.viewing.frame_cache import FrameCache
from service.viewing.memory_limit import MEMORY_LIMIT_REACHED, fits_in_memory
from service.viewing.passes import Piece, draft_size
from service.viewing.pending import PendingMessage
from service.viewing.pending_frames import ANSWER_TIMEOUT_S, PendingFrames
from service.viewing.picking import pick_message, record_pick
from service.viewing.sample_costs import SampleCosts
from service.viewing.session import ViewSession
from service.viewing.view_cards import ViewCards
from service.viewing.view_request import ViewRequest
from service.viewing.view_workers import ViewWorkers
from service.viewing.waker import Waker

__all__ = ["ViewScheduler"]

MIN_IDLE_S, IDLE_S = 0.001, 0.2  # between two checks of sessions that wait for something
KEY_TTL_S = 15
ANSWERS_GRACE_S = 1.0  # after the last session closed, for answers on their way
REVIEW_EVERY_S = 0.5
DRAFT_SEND_TIMEOUT_S = 0.3  # for which a view waits for a card that has room for its draft
LOST_AFTER_S = 3.0  # without a report of the message by any slot
WAIT_STATED_S = 2.0  # after which a view that no slot has begun says that it waits
FAILURES_ALLOWED = 3
AFTER_JOB_S = 10.0  # seconds after a page was left in which its last picture waits while batches are rendered

ALPHA = range(alpha_plane(0), alpha_plane(0) + ALPHA_PLANES)  # planes that only a transparent background has
PLAIN = [*range(CHANNELS)[COLOR], SAMPLES, *ALPHA]  # planes of sums that a view uses
GUIDED = sorted({*PLAIN, *range(CHANNELS)[ALBEDO], *range(CHANNELS)[NORMAL]})  # and those that guide the denoiser

log = logging.getLogger(__name__)


class ViewScheduler:
    """Renders the views of all sessions, from `start` to `stop`. The other public methods are thread-safe."""

    def __init__(self, connection: redis.Redis, dispatcher: Dispatcher, board: SnapshotHolder, events: Events) -> None:
        """Stores the connections and the holder of the engine's snapshot. `stop` closes connection and dispatcher."""
        self._redis = connection
        self._dispatcher = dispatcher
        self._board = board
        self._workers = ViewWorkers(board, events)
        self._cards = ViewCards(board)
        self._frame_cache = FrameCache(events)
        self._sessions: dict[str, ViewSession] = {}
        self._out: dict[str, PendingMessage] = {}
        self._costs = SampleCosts()
        self._losses: Counter[str] = Counter()  # by session, since its view began
        self._unfit = UnfitMachines()  # by session
        self._orders: deque[Callable[[], None]] = deque()
        self._frames = PendingFrames()
        self._first_pictures = FirstPictures()
        self._shared: set[str] = set()  # kinds of workers that have other work queued
        self._shared_cards: set[str] = set()  # workers whose graphics cards have batches queued
        self._lingers_until = 0.0
        self._views = 0
        self._messages = 0
        self._reviewed = 0.0
        self._ordered = threading.Event()
        self._waker = Waker(self._redis)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="viewing", daemon=True)

    def start(self) -> None:
        """Starts the thread."""
        self._waker.start()
        self._thread.start()

    def stop(self) -> None:
        """Stops the thread and discards all views."""
        self._stop.set()
        self._wake()
        if self._thread.is_alive():
            self._thread.join(10)
        self._waker.stop()
        self._dispatcher.close()
        self._redis.close()

    def has_unfinished(self) -> bool:
        """Returns True if a session that is not paused shows a view that needs more samples."""
        sessions = list(self._sessions.values())
        return any(each.request is not None and not each.is_paused and not each.is_done for each in sessions)

    def sessions(self) -> list[ViewSession]:
        """Returns the sessions that have requested a view and are not closed."""
        return [each for each in list(self._sessions.values()) if not each.is_closed]

    def request_view(self, session: ViewSession, request: ViewRequest) -> None:
        """Makes a session show a view, as soon as its current view has shown something."""

        def set_view() -> None:
            if not session.is_closed:
                self._sessions[session.id] = session
                current = session.request
                if current is not None and (request.id, request.job_request) == (current.id, current.job_request):
                    session.request = request  # compiled for more kinds of workers by now
                else:
                    session.wanted = request

        self._queue_order(set_view)

    def pick(self, session: ViewSession, x: int, y: int) -> None:
        """Requests the surface at pixel (x, y) of the session's view. The session receives the result."""

        def set_pick() -> None:
            session.pick = (x, y)

        self._queue_order(set_pick)

    def pause(self, session: ViewSession, is_paused: bool) -> None:
        """Pauses a session while its page is hidden (is_paused), or resumes it."""

        def set_paused() -> None:
            session.is_paused = is_paused
            if is_paused:
                self._withdraw_messages(session)
            elif session.view:  # slots drop the messages of a view whose key has expired
                self._redis.set(view_key(session.id), session.view, ex=KEY_TTL_S)

        self._queue_order(set_paused)

    def end_sampling(self, session: ViewSession, min_samples: float) -> None:
        """Ends the sampling of a session whose page was left. The samples that it has are denoised once more.

        This is omitted if a picture of at least `min_samples` samples per pixel is being denoised already.
        """

        def end_sampling() -> None:
            self._withdraw_messages(session, keeps_denoising=True)
            session.end_sampling(min_samples)
            self._redis.set(view_key(session.id), session.view, ex=KEY_TTL_S)

        self._queue_order(end_sampling)

    def close_session(self, session: ViewSession) -> None:
        """Ends a session and discards its view."""
        session.is_closed = True

        def end_session() -> None:
            self._sessions.pop(session.id, None)
            self._withdraw_messages(session)
            session.free_pictures()
            self._lingers_until = time.monotonic() + (ANSWER_TIMEOUT_S if self._frames else ANSWERS_GRACE_S)
            self._losses.pop(session.id, None)
            self._unfit.remove_owner(session.id)
            self._redis.delete(view_key(session.id))
            self._frame_cache.keep_only({each.request.scene for each in self._sessions.values() if each.request is not None})

        self._queue_order(end_session)

    @property
    def _is_active(self) -> bool:
        return bool(self._sessions) or time.monotonic() < self._lingers_until

    def _queue_order(self, order: Callable[[], None]) -> None:
        self._orders.append(order)
        self._wake()

    def _wake(self) -> None:
        if not self._ordered.is_set() and self._sessions:
            self._waker.wake()
        self._ordered.set()

    def _run(self) -> None:
        while not self._stop.is_set():
            if not self._is_active:
                self._ordered.wait()
            try:
                self._step()
            except (redis.RedisError, QueueError) as error:
                for session in self._sessions.values():
                    self._set_message(session, redis_fault(error)[0])
                self._stop.wait(IDLE_S)
            except Exception:
                log.exception("the view scheduler failed")
                self._stop.wait(IDLE_S)
        self._frame_cache.keep_only(set())

    def _step(self) -> None:
        self._ordered.clear()
        while self._orders:
            self._orders.popleft()()
        self._take_back_late()
        for session in list(self._sessions.values()):
            self._switch_view(session)
        self._send_pieces()
        if self._is_active:
            self._read_answers()
        if time.monotonic() - self._reviewed >= REVIEW_EVERY_S:
            self._reviewed = time.monotonic()
            self._maintain_sessions()

    def _switch_view(self, session: ViewSession) -> None:
        """Switches a session to the view that it has requested, if there is one and the current view may be replaced.

        Then begins to render that view, unless it has begun already or cannot be rendered.
        """
        if session.is_ready_for_next and session.wanted is not None:
            self._withdraw_messages(session)
            self._views += 1
            self._losses.pop(session.id, None)
            if session.request is not None and session.request.scene != session.wanted.scene:
                self._unfit.remove_owner(session.id)
            session.switch_to(session.wanted, self._views)
            self._redis.set(view_key(session.id), session.view, ex=KEY_TTL_S)
        has_begun = session.settings is not None or session.error is not None
        if session.request is not None and not (has_begun or session.is_paused or session.is_ending):
            self._begin_view(session, session.request)

    def _begin_view(self, session: ViewSession, request: ViewRequest) -> None:
        """Selects the workers that render a session's view, and its compiled scene and settings; or sets why it must wait."""
        kind = self._workers.best_kind(request)
        if kind is None:
            self._set_message(session, self._workers.unavailable_reason(request))
            return
        settings, compiled = request.settings, request.compiled[kind]
        if request.frame_request is not None:
            info = self._frame_cache.get(request.frame_request.cache_key(request.scene, compiled))
            if info is None:
                self._send_frame(session, kind)
                return
            try:
                settings = request.settings_at_frame(info)
            except SettingsError as error:
                self._fail_session(session, with_full_stop(error))
                return
            compiled = info.compiled.sha256 if info.compiled else compiled
        denoises = bool(request.job_request.get("denoise")) and self._workers.can_denoise(kind)
        if not fits_in_memory(settings.width * settings.height * (2 if denoises else 1), self._sessions.values()):
            self._set_message(session, MEMORY_LIMIT_REACHED)
            return
        slots, cost_s = self._workers.slots(kind), self._costs.estimate(request, kind, self._board.roster)
        card_rate = self._cards.rate(request, kind, compiled, settings)
        draft = None
        if request.draft_exposure is not None:
            draft_cost_s = self._cards.draft_cost_s(request, kind, compiled, settings)
            if draft_cost_s is not None:
                draft = draft_size(settings.width, settings.height, request.samples, draft_cost_s)
        session.begin_rendering(settings, compiled, kind, cost_s, slots, denoises, card_rate, draft)
        if session.awaits_first_picture and self._first_pictures.can_precede(kind):
            self._take_back_others(session)
        self._set_message(session, None, slots)

    def _take_back_others(self, session: ViewSession) -> None:
        """Takes back the pieces of other views that no CPU slot has fetched, so that a session's first picture precedes them."""
        others = [
            out
            for out in self._out.values()
            if out.session is not session and out.kind == session.kind and out.pieces and not (out.card or out.has_started)
        ]
        for out in others:
            if not out.session.awaits_first_picture:
                self._take_back(out)

    def _send_pieces(self) -> None:
        """Sends messages with pieces of all views, until each slot has one in progress and one queued; to cards first.

        Workers of the kinds that `FirstPictures` names get pieces of sessions that await their first picture only, and no
        pictures to denoise.
        """
        kinds = self._first_pictures.preceding_kinds(self._sessions.values())
        for session in list(self._sessions.values()):
            is_asked = any(out.pick is not None and out.session is session for out in self._out.values())
            if session.pick is not None and session.passes is not None and not is_asked:
                self._send_pick(session)
            if not session.is_paused:
                if session.kind not in kinds and not self._awaits_job(session):
                    self._send_denoise(session)
                self._send_draft(session)
        shown = [each for each in self._sessions.values() if each.passes is not None and not each.is_paused]
        shown = [each for each in shown if each.kind not in kinds or each.awaits_first_picture]
        waiting = {each.id: each for each in shown if each.piece_wait_s <= 0 and not each.spares_slots}
        while waiting:
            session = min(waiting.values(), key=lambda each: each.served)
            pieces, card = self._next_pieces(session)
            if not pieces:
                del waiting[session.id]
                continue
            self._messages += 1
            session.served = self._messages
            tiles = session.passes.levels[pieces[0].level].tiles if session.passes is not None else []
            parts = [Part(number, tiles[piece.tile], piece.first, piece.count) for number, piece in enumerate(pieces)]
            queue = card_view_queue(card) if card else ""
            out = PendingMessage(session, session.view, session.kind, dict(enumerate(pieces)), queue=queue, card=card)
            settings = session.settings_of(pieces[0])
            about = (out.id, session.id, session.view, session.compiled)
            has_guides = session.needs_guides(pieces)
            more = {"has_guides": has_guides, "on_card": bool(card), "needs_kernel": not session.compiles}
            self._send(out, ViewParts(*about, settings, parts, **more))

    def _awaits_job(self, session: ViewSession) -> bool:
        """Returns True if a page was left just now while batches are rendered, perhaps of a job that was started from it."""
        return time.monotonic() - session.left_at < AFTER_JOB_S and self._board.latest.batches_out > 0

    def _next_pieces(self, session: ViewSession) -> tuple[list[Piece], str]:
        """Returns the pieces of a session's next message, and the worker whose graphics card is to render them ("": a CPU slot).

        Returns no pieces if none remain, or if no slot has room for a message.
        """
        if session.passes is None or session.request is None:
            return [], ""
        cpu_slots = self._cpu_slots(session)
        card = self._cards.free(session, self._out.values(), self._shared_cards, cpu_slots > 0)
        ahead = 1 if session.kind in self._shared and session.samples else 2  # leaves room for the other work
        room = ahead * cpu_slots - sum(out.kind == session.kind and not out.card for out in self._out.values())
        if card is not None and (room <= 0 or not self._cards.is_busy(card.name)):
            return session.passes.next_card_message(self._cards.cost_s(session.request, card.name)), card.name
        return (session.passes.next_message() if room > 0 else []), ""

    def _cpu_slots(self, session: ViewSession) -> int:
        """Returns the number of slots that render a session's view with the CPU: slots whose card accepts it do not."""
        if session.settings is None:
            return 0
        cards = self._cards.accepting(session.kind, session.compiled, session.settings)
        with_card = sum(report.slots for report in cards if report.views)
        return self._workers.slots(session.kind) - with_card

    def _take_back_late(self) -> None:
        """Takes back messages that a graphics card has not begun in time, so that CPU slots render their pieces."""
        in_progress = {out.card for out in self._out.values() if out.has_started}
        for out in [out for out in self._out.values() if out.card not in in_progress and self._cards.is_late(out)]:
            if self._cpu_slots(out.session) and self._take_back(out):
                self._cards.set_busy(out.card)

    def _take_back(self, out: PendingMessage) -> bool:
        """Takes back a message that no slot has fetched, and queues its pieces again. Returns False if one has fetched it."""
        is_taken = bool(self._dispatcher.withdraw(out.queue, {out.id}))
        if is_taken:
            self._end_message(out)
        return is_taken

    def _send(self, out: PendingMessage, work: ViewParts | ViewFrame | ViewDenoise) -> None:
        out.queue = out.queue or view_queue(out.kind)
        self._out[out.id] = out  # before it is sent, since a worker requests the picture of a message at once
        try:
            self._dispatcher.send_view(work, out.queue)
        except QueueError:
            self._end_message(out)
            raise

    def _send_frame(self, session: ViewSession, kind: str) -> None:
        is_out = any(out.is_frame and out.session is session for out in self._out.values())
        if session.request is None or session.request.frame_request is None or is_out:
            return
        queue = ""
        if session.id in self._unfit:
            able = [report for report in self._board.roster.ready_reports() if report.kind == kind and report.views]
            place = self._unfit.next_destination(session.id, able)
            if place is None:
                self._fail_session(session, self._unfit.error_message(session.id, "prepare this frame"))
                return
            queue = place.queue
        out = PendingMessage(session, session.view, kind, is_frame=True, queue=queue)
        base = session.request.compiled[kind]
        work = session.request.frame_request.message(session.request.scene, base, session.id, out.id)
        self._frames.add(out.id, session.request.frame_request.cache_key(session.request.scene, base), session.request.scene)
        self._send(out, ViewFrame(out.id, session.id, session.view, work))

    def _send_denoise(self, session: ViewSession) -> None:
        """Sends a message with the picture to denoise, if one is due."""
        picture = session.begin_denoising()
        if picture is not None:
            out = PendingMessage(session, session.view, session.kind, denoises=True)
            self._send(out, ViewDenoise(out.id, session.id, session.view, *picture))

    def _send_draft(self, session: ViewSession) -> None:
        """Sends a message for the view's draft, once a card has room for it; if none has in time, the view has no draft."""
        if session.draft_size is None or session.piece_wait_s < math.inf or session.settings is None or session.request is None:
            return
        if any(out.draft is not None and out.session is session for out in self._out.values()):
            return
        has_cpu = self._cpu_slots(session) > 0
        card = self._cards.free(session, self._out.values(), self._shared_cards, has_cpu, drafts=True)
        if card is None:
            if time.monotonic() - session.begun > DRAFT_SEND_TIMEOUT_S:
                session.stop_drafts()
            return
        width, height, samples = size = session.draft_size
        queue = card_view_queue(card.name)
        out = PendingMessage(session, session.view, session.kind, draft=size, queue=queue, card=card.name)
        settings = replace(session.settings, width=width, height=height)
        parts = [Part(0, Tile(0, 0, width, height), 0, samples)]
        about = (out.id, session.id, session.view, session.compiled)
        exposure = session.request.draft_exposure
        self._send(out, ViewParts(*about, settings, parts, on_card=True, draft=exposure, is_smooth=session.denoises))

    def means(self, message: str) -> bytes | None:
        """Returns the picture that a worker is to denoise (ViewDenoise); None if the view has changed. message: its id."""
        out = self._out.get(message)
        return out.session.means_to_denoise if out is not None and out.denoises and out.view == out.session.view else None

    def _send_pick(self, session: ViewSession) -> None:
        assert session.pick is not None
        assert session.settings is not None
        x, y = session.pick
        session.pick = None
        if not (0 <= x < session.settings.width and 0 <= y < session.settings.height):
            return
        out = PendingMessage(session, session.view, session.kind, pick=(x, y))
        self._send(out, pick_message(session, out.id, x, y))

    def _withdraw_messages(self, session: ViewSession, *, keeps_denoising: bool = False) -> None:
        """Takes back a session's messages that are not completely answered. Results that still arrive are discarded."""
        gone = [out for out in self._out.values() if out.session is session and not (keeps_denoising and out.denoises)]
        for out in gone:
            del self._out[out.id]
            out.requeue()
        for queue in {out.queue for out in gone}:
            self._frames.remove(self._dispatcher.withdraw(queue, {out.id for out in gone}))

    def _read_answers(self) -> None:
        waits = [wait for each in self._sessions.values() if (wait := each.piece_wait_s) > 0]
        idle_s = max(MIN_IDLE_S, min([IDLE_S, *waits]))  # 0 would wait without end
        found: Any = None if self._ordered.is_set() else self._redis.blpop([VIEW_ANSWERS], timeout=idle_s)
        data: Any = found[1] if found else self._redis.lpop(VIEW_ANSWERS)  # at least one, even if orders never stop
        while data is not None:
            if data:
                try:
                    self._handle_answer(ViewAnswer.from_bytes(data))
                except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
                    log.warning("an invalid answer about a view is ignored: %.300s", error)
            if self._ordered.is_set():
                return
            data = self._redis.lpop(VIEW_ANSWERS)

    def _handle_answer(self, answer: ViewAnswer) -> None:
        out = self._out.get(answer.message)
        if answer.type == "frame":
            self._handle_frame(answer)
        elif answer.type in ("over", "failed", "returned"):
            self._frames.remove([answer.message])
        if out is None or out.view != answer.view:
            return
        session = out.session
        out.last_seen, out.has_started = time.monotonic(), True
        if out.card:
            self._cards.record_answer(out.card, answer.type in ("begun", "draft"))
        match answer.type:
            case "begun":
                self._set_message(session, None, self._workers.slots(out.kind))
            case "compiling":
                self._set_message(
                    session,
                    Sentence("kernel-compiling", "Compiling renderer (first time, about half a minute)"),
                )
            case "part":
                self._handle_part(out, answer)
            case "denoised":
                self._out.pop(out.id, None)
                session.end_denoising(answer.sums)
                session.wake()
            case "draft":
                self._handle_draft(out, answer)
            case "over":
                self._end_message(out)
            case "declined" | "failed" | "returned" if out.card:
                self._handle_declined(out, answer)
            case "declined":
                session.lacks_kernel = True
                self._fail_session(session, f"{answer.worker} would have to compile its kernel")
            case "failed" if out.denoises:
                log.info("%s cannot denoise a view: %s", answer.worker, answer.more.get("error"))
                self._out.pop(out.id, None)
                session.fail_denoising()
            case "failed":
                self._end_message(out)
                self._fail_session(session, str(answer.more.get("error", ""))[:2000])
            case "returned":
                log.info("%s: %s", answer.worker, answer.more.get("error"))
                if out.is_frame and answer.more.get("unfit") is True:
                    self._unfit.add(
                        session.id, MachineFault(answer.worker, str(answer.more.get("error", ""))[:2000], passing=False)
                    )
                    self._end_message(out)
                    return
                self._handle_loss(out, str(answer.more.get("error", ""))[:2000])

    def _handle_declined(self, out: PendingMessage, answer: ViewAnswer) -> None:
        """Queues the pieces of a message again that a graphics card does not render now, or not at all."""
        is_loading = answer.more.get("is_loading") is True
        if not is_loading:
            self._cards.refuse(out.card, out.session)
        out.requeue()
        out.pieces.clear()
        out.is_declined = True
        for each in [each for each in self._out.values() if each.card == out.card and each.session is out.session]:
            if not each.has_started:
                self._take_back(each)
        if is_loading:  # its slot is occupied until it is "over"
            if not self._cpu_slots(out.session):
                self._set_message(out.session, Sentence("view-card-loads-scene", "The graphics card loads the scene."))
        else:
            log.info("%s: %s", answer.worker, answer.more.get("error"))
            self._end_message(out)

    def _handle_part(self, out: PendingMessage, answer: ViewAnswer) -> None:
        session, seconds = out.session, answer.seconds
        if out.pick is not None:
            record_pick(out, out.pick, answer)
            return
        piece = out.pieces.pop(int(answer.more["number"]), None)
        if piece is None or session.passes is None or session.request is None:
            return
        tile = session.passes.levels[piece.level].tiles[piece.tile]
        session.add(piece, unpack_sums(answer.sums, tile, planes=GUIDED if session.needs_guides([piece]) else PLAIN))
        if not piece.is_guide:  # which costs less than a sample
            cost_s = seconds / (tile.w * tile.h * piece.count)
            if out.card:
                self._cards.update(session.request, out.card, cost_s)
            else:
                self._costs.update(session.request, cost_s)
                session.record_cost(piece, seconds)
        if session.message is not None:
            self._set_message(session, None, self._workers.slots(out.kind))
        if session.is_picture_due():
            session.wake()

    def _handle_draft(self, out: PendingMessage, answer: ViewAnswer) -> None:
        self._out.pop(out.id, None)
        session = out.session
        if out.draft is None or out.draft != session.draft_size or session.request is None:  # the view was restarted
            return
        width, height, samples = out.draft
        self._cards.update_draft(session.request, out.card, answer.seconds / (width * height * samples))
        session.put_draft(answer.sums)
        session.wake()

    def _handle_frame(self, answer: ViewAnswer) -> None:
        """Caches the animation frame in an answer, even if its session shows another view now: the viewer may return to it."""
        info = FrameInfo.from_json(answer.more["info"])
        name, scene = self._frames.key_and_scene(answer.message)
        if any(each.request is not None and each.request.scene == scene for each in self._sessions.values()):
            self._frame_cache.put(name, scene, info)
        else:
            self._frame_cache.delete_unused_blobs(info)

    def _end_message(self, out: PendingMessage) -> None:
        """Removes a message that has ended, and queues its unanswered pieces again."""
        self._out.pop(out.id, None)
        out.requeue()

    def _handle_loss(self, out: PendingMessage, error: str = "") -> None:
        self._end_message(out)
        if out.card:
            self._dispatcher.withdraw(out.queue, {out.id})
        self._losses[out.session.id] += bool(error)
        if self._losses[out.session.id] >= FAILURES_ALLOWED:
            if out.session.request is not None and out.session.request.frame_request is not None:
                self._frame_cache.clear()  # the scene compiled for the frame may be deleted
            self._fail_session(out.session, error)

    def _maintain_sessions(self) -> None:
        """Renews the sessions' Redis keys, sends lost messages again, and reports to viewers why pictures are missing."""
        now = time.monotonic()
        in_hand = {str(doing["message"]) for doing in self._board.roster.current() if "view" in doing and "message" in doing}
        self._frames.remove_expired(self._out, in_hand)
        with self._redis.pipeline(transaction=False) as keys:
            for session in self._sessions.values():
                if session.view and not session.is_paused:
                    keys.set(view_key(session.id), session.view, ex=KEY_TTL_S)
            keys.execute()
        waiting = {queue: bool(self._dispatcher.queue_length(queue)) for queue in {out.queue for out in self._out.values()}}
        kinds = {out.kind for out in self._out.values()}
        others = prepare_queue, render_queue, denoise_queue
        self._shared = {kind for kind in kinds if any(self._dispatcher.queue_length(queue(kind)) for queue in others)}
        cards = {out.card for out in self._out.values() if out.card}
        self._shared_cards = {card for card in cards if self._dispatcher.queue_length(card_queue(card))}
        for out in list(self._out.values()):
            if out.id in in_hand or (not out.has_started and waiting[out.queue] and self._workers.slots(out.kind)):
                out.last_seen = now
            elif now - out.last_seen > LOST_AFTER_S:
                self._handle_loss(out)
        for session in self._sessions.values():
            if session.request is not None and session.settings is not None and not self._workers.slots(session.kind):
                if self._workers.best_kind(session.request) is not None:
                    self._withdraw_messages(session)
                    session.restart()
                    continue
                self._set_message(session, self._workers.unavailable_reason(session.request))
            own = [out for out in self._out.values() if out.session is session]
            has_begun = session.has_picture or any(out.has_started for out in own)
            if own and not has_begun and now - session.begun > WAIT_STATED_S:
                self._set_message(
                    session,
                    Sentence("view-waits-for-slot", "Starts soon: the workers finish other work first."),
                    self._workers.slots(session.kind),
                )

    def _fail_session(self, session: ViewSession, error: str) -> None:
        self._withdraw_messages(session)
        session.passes = None
        session.error = error
        session.wake()

    def _set_message(self, session: ViewSession, message: str | None, slots: int = 0) -> None:
        if (session.message, session.slots) != (message, slots):
            session.message, session.slots = message, slots
            session.wake()
