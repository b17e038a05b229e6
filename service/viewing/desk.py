"""The desk that serves everybody who looks at scenes: one thread that hands out pieces of views, and takes in what comes back.

Views bypass jobs, films and the database: their pieces wait in a queue of their own that slots check first; their sums are
added in memory; when somebody leaves, everything goes. What is lost on the way is asked for again. A view that is already whole
shares the slots with other waiting work, which may include preparing the next light to look at.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import redis

from renderer.errors import SettingsError
from renderer.film import SAMPLES
from service.scheduling.faults.redis_says import trouble_of
from service.scheduling.fleet.workers import Roster
from service.scheduling.handing_out.dispatch import Dispatcher, QueueError
from service.settings import Settings
from service.viewing.asked_frames import PATIENCE_S, AskedFrames
from service.viewing.bell import Bell
from service.viewing.costs import Costs
from service.viewing.handed import Handed
from service.viewing.hands import Hands
from service.viewing.look import Look
from service.viewing.moments import Moments
from service.viewing.picking import answered, picking
from service.viewing.room import FULL, has_room
from service.viewing.watch import Watch
from worker.protocol.contract import FrameInfo, prepare_queue, render_queue
from worker.protocol.sums import unpack_sums
from worker.protocol.view_parts import VIEW_ANSWERS, Part, ViewAnswer, ViewFrame, ViewParts, view_key, view_queue

__all__ = ["Desk"]

IDLE_S = 0.2  # between two looks at watchers who wait for something
KEY_TTL_S = 15
LINGER_S = 1.0  # though nobody looks: for what slots were at; and for frames that are still prepared
REVIEW_EVERY_S = 0.5
LOST_S = 3.0  # without a sign of a message in any slot
FAILURES_ALLOWED = 3

log = logging.getLogger(__name__)


class Desk:
    """Runs from `start` to `stop`. All else may be called from any thread."""

    def __init__(
        self,
        settings: Settings,
        roster: Callable[[], Roster],
        prepare: Callable[[str, str], None],
        let_go: Callable[[Counter[str]], None],
    ) -> None:
        """prepare: told of a scene and a kind that it is not compiled for. let_go: of blobs that were made for views."""
        self._redis = redis.Redis.from_url(settings.redis_url, socket_timeout=5, socket_connect_timeout=2)
        self._dispatcher = Dispatcher(settings.redis_url, self._redis)
        self._roster = roster
        self._hands = Hands(roster, prepare)
        self._moments = Moments(let_go)
        self._watches: dict[str, Watch] = {}
        self._out: dict[str, Handed] = {}
        self._costs = Costs()
        self._losses: Counter[str] = Counter()  # of watches, since their view began
        self._orders: deque[Callable[[], None]] = deque()
        self._frames = AskedFrames()
        self._shared: set[str] = set()  # kinds of workers for which other work waits
        self._lingers_until = 0.0
        self._views = 0
        self._messages = 0
        self._reviewed = 0.0
        self._ordered = threading.Event()
        self._bell = Bell(self._redis)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="viewing", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._bell.start()
        self._thread.start()

    def stop(self) -> None:
        """End, and let go of everything."""
        self._stop.set()
        self._wake()
        if self._thread.is_alive():
            self._thread.join(10)
        self._bell.stop()
        self._dispatcher.close()
        self._redis.close()

    @property
    def is_watched(self) -> bool:
        """Whether anybody looks and is not done."""
        return any(watch.look is not None and not watch.is_paused and not watch.is_done for watch in list(self._watches.values()))

    def show(self, watch: Watch, look: Look) -> None:
        """Somebody wants to see this."""

        def order() -> None:
            if not watch.is_closed:
                self._watches[watch.id] = watch
                if watch.look is not None and (look.id, look.request) == (watch.look.id, watch.look.request):
                    watch.look = look  # it may be compiled for other workers by now
                else:
                    watch.wanted = look

        self._order(order)

    def pick(self, watch: Watch, x: int, y: int) -> None:
        """Somebody wants to know what lies under a pixel of the view."""

        def order() -> None:
            watch.pick = (x, y)

        self._order(order)

    def pause(self, watch: Watch, is_paused: bool) -> None:
        """Nobody sees the page, or somebody does again."""

        def order() -> None:
            watch.is_paused = is_paused
            if is_paused:
                self._withdraw(watch)
            elif watch.view:  # the key may have expired, without which slots take it for a view that nobody looks at
                self._redis.set(view_key(watch.id), watch.view, ex=KEY_TTL_S)

        self._order(order)

    def leave(self, watch: Watch) -> None:
        """Somebody has left."""
        watch.is_closed = True

        def order() -> None:
            self._watches.pop(watch.id, None)
            self._withdraw(watch)
            watch.forget()
            self._lingers_until = time.monotonic() + (PATIENCE_S if self._frames else LINGER_S)
            self._losses.pop(watch.id, None)
            self._redis.delete(view_key(watch.id))
            self._moments.keep({each.look.scene for each in self._watches.values() if each.look is not None})

        self._order(order)

    @property
    def _is_awake(self) -> bool:
        return bool(self._watches) or time.monotonic() < self._lingers_until

    def _order(self, order: Callable[[], None]) -> None:
        self._orders.append(order)
        self._wake()

    def _wake(self) -> None:
        if not self._ordered.is_set() and self._watches:
            self._bell.ring()
        self._ordered.set()

    def _run(self) -> None:
        while not self._stop.is_set():
            if not self._is_awake:
                self._ordered.wait()
            try:
                self._step()
            except (redis.RedisError, QueueError) as error:
                for watch in self._watches.values():
                    self._tell(watch, trouble_of(error)[0])
                self._stop.wait(IDLE_S)
            except Exception:
                log.exception("a fault at the desk of views")
                self._stop.wait(IDLE_S)
        self._moments.keep(set())

    def _step(self) -> None:
        self._ordered.clear()
        while self._orders:
            self._orders.popleft()()
        for watch in list(self._watches.values()):
            self._turn(watch)
        self._fill()
        if self._is_awake:
            self._take_in()
        if time.monotonic() - self._reviewed >= REVIEW_EVERY_S:
            self._reviewed = time.monotonic()
            self._review()

    def _turn(self, watch: Watch) -> None:
        """Go on to the view that is wanted, and find out what is to be rendered for it."""
        if watch.is_ready_for_next and watch.wanted is not None:
            self._withdraw(watch)
            self._views += 1
            self._losses.pop(watch.id, None)
            watch.turn_to(watch.wanted, self._views)
            self._redis.set(view_key(watch.id), watch.view, ex=KEY_TTL_S)
        if watch.look is None or watch.settings is not None or watch.error is not None or watch.is_paused:
            return
        kind = self._hands.kind(watch.look)
        if kind is None:
            self._tell(watch, self._hands.nobody(watch.look))
            return
        moment, base = watch.look.moment, watch.look.compiled[kind]
        settings, compiled = watch.look.settings, base
        if moment is not None:
            info = self._moments.get(moment.name(watch.look.scene, base))
            if info is None:
                self._send_frame(watch, kind)
                return
            try:
                settings = watch.look.at(info)
            except SettingsError as error:
                self._fail(watch, f"{error}.")
                return
            compiled = info.compiled.sha256 if info.compiled else base
        if not has_room(settings.width * settings.height, self._watches.values()):
            self._tell(watch, FULL)
            return
        slots = self._hands.slots(kind)
        watch.begin(settings, compiled, kind, self._costs.of(watch.look, kind, self._roster()), slots)
        self._tell(watch, None, slots)

    def _fill(self) -> None:
        """Hand out what is to be rendered, so that every slot has something in hand and something to go on with."""
        for watch in list(self._watches.values()):
            is_asked = any(out.pick is not None and out.watch is watch for out in self._out.values())
            if watch.pick is not None and watch.passes is not None and not is_asked:
                self._send_pick(watch)
        hungry = {watch.id: watch for watch in self._watches.values() if watch.passes is not None and not watch.is_paused}
        while hungry:
            watch = min(hungry.values(), key=lambda each: each.served)
            ahead = 1 if watch.kind in self._shared and watch.samples else 2  # a slot that is done finds other work first
            room = ahead * self._hands.slots(watch.kind) - sum(out.kind == watch.kind for out in self._out.values())
            pieces = watch.passes.next() if room > 0 and watch.passes is not None else []
            if not pieces:
                del hungry[watch.id]
                continue
            self._messages += 1
            watch.served = self._messages
            tiles = watch.passes.levels[pieces[0].level].tiles if watch.passes is not None else []
            parts = [Part(number, tiles[piece.tile], piece.first, piece.count) for number, piece in enumerate(pieces)]
            out = Handed(watch, watch.view, watch.kind, dict(enumerate(pieces)))
            settings = watch.settings_of(pieces[0].level)
            self._send(out, ViewParts(out.id, watch.id, watch.view, watch.compiled, settings, parts))

    def _send(self, out: Handed, work: ViewParts | ViewFrame) -> None:
        try:
            self._dispatcher.send_view(work, out.kind)
        except QueueError:
            out.lose()
            raise
        self._out[out.id] = out

    def _send_frame(self, watch: Watch, kind: str) -> None:
        is_out = any(out.is_frame and out.watch is watch for out in self._out.values())
        if watch.look is None or watch.look.moment is None or is_out:
            return
        out = Handed(watch, watch.view, kind, is_frame=True)
        base = watch.look.compiled[kind]
        work = watch.look.moment.work(watch.look.scene, base, watch.id, out.id)
        self._frames.add(out.id, watch.look.moment.name(watch.look.scene, base), watch.look.scene)
        self._send(out, ViewFrame(out.id, watch.id, watch.view, work))

    def _send_pick(self, watch: Watch) -> None:
        assert watch.pick is not None
        assert watch.settings is not None
        x, y = watch.pick
        watch.pick = None
        if not (0 <= x < watch.settings.width and 0 <= y < watch.settings.height):
            return
        out = Handed(watch, watch.view, watch.kind, pick=(x, y))
        self._send(out, picking(watch, out.id, x, y))

    def _withdraw(self, watch: Watch) -> None:
        """Take back what is handed out for a watcher; what a slot is at comes to nothing."""
        gone = [out for out in self._out.values() if out.watch is watch]
        for out in gone:
            del self._out[out.id]
            out.lose()
        for kind in {out.kind for out in gone}:
            self._frames.forget(self._dispatcher.take_back(view_queue(kind), {out.id for out in gone}))

    def _take_in(self) -> None:
        found: Any = None if self._ordered.is_set() else self._redis.blpop([VIEW_ANSWERS], timeout=IDLE_S)
        data: Any = found[1] if found else self._redis.lpop(VIEW_ANSWERS)  # one at least: orders may come without end
        while data is not None:
            if data:
                try:
                    self._hear(ViewAnswer.from_bytes(data))
                except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
                    log.warning("an answer about a view is left out: %.300s", error)
            if self._ordered.is_set():
                return
            data = self._redis.lpop(VIEW_ANSWERS)

    def _hear(self, answer: ViewAnswer) -> None:
        out = self._out.get(answer.message)
        if answer.type == "frame":
            self._hear_frame(answer)
        elif answer.type in ("over", "failed", "returned"):
            self._frames.forget([answer.message])
        if out is None or out.view != answer.view:
            return
        watch = out.watch
        out.heard, out.has_begun = time.monotonic(), True
        match answer.type:
            case "begun":
                self._tell(watch, None, self._hands.slots(out.kind))
            case "compiling":
                self._tell(watch, "The kernel for this scene is made ready: a minute or two, once.")
            case "part":
                self._hear_part(out, answer)
            case "over":
                self._end(out)
            case "failed":
                self._end(out)
                self._fail(watch, str(answer.more.get("error", ""))[:2000])
            case "returned":
                log.info("%s", answer.more.get("error"))
                self._lost(out, str(answer.more.get("error", ""))[:2000])

    def _hear_part(self, out: Handed, answer: ViewAnswer) -> None:
        watch, seconds = out.watch, answer.seconds
        if out.pick is not None:
            answered(out, out.pick, answer)
            return
        piece = out.pieces.pop(int(answer.more["number"]), None)
        if piece is None or watch.passes is None or watch.look is None:
            return
        tile = watch.passes.levels[piece.level].tiles[piece.tile]
        watch.add(piece, unpack_sums(answer.sums, tile, planes=[0, 1, 2, SAMPLES]))
        self._costs.learn(watch.look, seconds / (tile.w * tile.h * piece.count))
        if watch.message is not None:
            self._tell(watch, None, self._hands.slots(out.kind))
        if watch.is_due():
            watch.wake()

    def _hear_frame(self, answer: ViewAnswer) -> None:
        """Kept also where the hand is at another frame by now: it may come back."""
        info = FrameInfo.from_json(answer.more["info"])
        name, scene = self._frames.about(answer.message)
        if any(each.look is not None and each.look.scene == scene for each in self._watches.values()):
            self._moments.put(name, scene, info)
        else:
            self._moments.let_go(info)

    def _end(self, out: Handed) -> None:
        """A message is over; pieces of it that were not answered are asked for again."""
        self._out.pop(out.id, None)
        out.lose()

    def _lost(self, out: Handed, error: str = "") -> None:
        self._end(out)
        self._losses[out.watch.id] += bool(error)
        if self._losses[out.watch.id] >= FAILURES_ALLOWED:
            if out.watch.look is not None and out.watch.look.moment is not None:
                self._moments.forget()  # what was compiled for a moment may be gone
            self._fail(out.watch, error)

    def _review(self) -> None:
        """Renew the watchers' keys, ask again for what is lost, and say why nothing comes."""
        now = time.monotonic()
        in_hand = {str(doing["message"]) for doing in self._roster().current() if "view" in doing and "message" in doing}
        self._frames.review(self._out, in_hand)
        with self._redis.pipeline(transaction=False) as keys:
            for watch in self._watches.values():
                if watch.view and not watch.is_paused:
                    keys.set(view_key(watch.id), watch.view, ex=KEY_TTL_S)
            keys.execute()
        waiting = {kind: bool(self._redis.llen(view_queue(kind))) for kind in {out.kind for out in self._out.values()}}
        self._shared = {kind for kind in waiting if any(map(self._redis.llen, (prepare_queue(kind), render_queue(kind))))}
        for out in list(self._out.values()):
            if out.id in in_hand or (not out.has_begun and waiting[out.kind] and self._hands.slots(out.kind)):
                out.heard = now
            elif now - out.heard > LOST_S:
                self._lost(out)
        for watch in self._watches.values():
            if watch.look is not None and watch.settings is not None and not self._hands.slots(watch.kind):
                if self._hands.kind(watch.look) is not None:
                    self._withdraw(watch)
                    watch.begin_again()
                    continue
                self._tell(watch, self._hands.nobody(watch.look))
            own = [out for out in self._out.values() if out.watch is watch]
            if own and not watch.has_picture and now - watch.begun > 1.0 and not any(out.has_begun for out in own):
                self._tell(watch, "Waits for a free slot.", self._hands.slots(watch.kind))

    def _fail(self, watch: Watch, error: str) -> None:
        self._withdraw(watch)
        watch.passes = None
        watch.error = error
        watch.wake()

    def _tell(self, watch: Watch, message: str | None, slots: int = 0) -> None:
        if (watch.message, watch.slots) != (message, slots):
            watch.message, watch.slots = message, slots
            watch.wake()
