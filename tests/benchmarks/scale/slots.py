"""Simulated slots: they use the real protocol and Redis, and answer with real sums after the time that rendering would take.

The sums of one tile of a rendered picture represent one sample; those of n samples are n times these. So the packed bytes have a
realistic size, cost almost no processor time, and the final content of a film is known exactly.
"""

from __future__ import annotations

import argparse
import base64
import heapq
import json
import signal
import time
from collections import deque
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import redis

from protocol.contract import (
    HEARTBEAT_TTL_S,
    RESULTS,
    RenderBatch,
    Result,
    WorkerReport,
    prepare_queue,
    render_queue,
    worker_key,
)
from protocol.joint import JointBatch, Piece, Run
from protocol.lifeline import lifeline
from protocol.site import SITE
from protocol.sums import pack_sums
from protocol.terms import Offer, Terms, offer_key, terms_key
from renderer import film
from renderer.film import Sums
from tests.service.peer_worker import PeerWorker
from worker.exchange.results import MAX_ENTRIES
from worker.site.link import SiteLink

__all__ = ["SAMPLES", "Slots", "main", "of_one_sample"]

PER_WORKER = 32
LOOK_EVERY_S = 0.005
BEAT_EVERY_S = 1.0
AT_ONCE = 64  # messages or results between two readings of the clock
SAMPLES = 16  # samples per pixel of the rendered tile
PACKED_KEPT = 64


def of_one_sample(sums: Sums) -> Sums:
    """Returns the sums with sample counts of at most one per pixel.

    A service rejects a result that has more samples per pixel than were requested.
    """
    one = sums.copy()
    counts = [film.SAMPLES, film.SAMPLES_HALF]
    one[counts] = np.minimum(one[counts], 1)
    return one


@dataclass
class _Joint:
    """A message with several batches of one tile, rendered by the slots of one machine.

    The machine adds up the sums of finished batches (`done`), and sends them together; `left` counts unfinished batches.
    """

    message: str
    hold_s: float
    left: int
    run: Run | None
    done: list[tuple[RenderBatch, float]] = field(default_factory=list)
    since: float = 0.0


@dataclass
class _Machine:
    """A simulated worker: its idle slots, and the batches that wait for one of them."""

    name: str
    free: list[int]
    waiting: deque[tuple[str, list[RenderBatch], _Joint | None]] = field(default_factory=deque)  # with their messages
    joints: dict[str, _Joint] = field(default_factory=dict)


@dataclass
class _Batches:
    """The batches of one message which a slot renders one after the other."""

    message: str
    machine: _Machine
    slot: int
    batches: list[RenderBatch]
    seconds: list[float] = field(default_factory=list)
    joint: _Joint | None = None


class Slots(PeerWorker):
    """Many simulated slots in one thread, all equally fast."""

    def __init__(
        self,
        redis_url: str,
        service: str,
        token: str,
        slots: int,
        sums: Sums,
        tile_sample_s: float,
        adds: bool = True,
        site: str = "",
        per_worker: int = PER_WORKER,
        name: str = "peer",
    ) -> None:
        """sums: (CHANNELS, side, side) of one sample of a tile. tile_sample_s: seconds that a slot takes for it.

        adds: whether the slots of a machine add up their sums of a tile. site: name of the machines' site.
        """
        super().__init__(redis_url, service, token, name, slots=slots)
        self.site = site
        self.direct_bytes = 0  # sums sent to the service without the site's reducer
        self._per_worker = per_worker
        self._links = SiteLink(redis_url)
        self._keeps: dict[str, Terms] = {}
        self._queues = [render_queue(self.kind)]
        self.tile_sample_s = tile_sample_s
        self.adds = adds
        self._turn = 0
        self.rendered = 0  # number of batches
        self.samples = 0  # tile samples, including repeated ones
        self.waited = 0  # results that found the stream full
        self._sums = sums
        self._packed: dict[int, bytes] = {}
        firsts = range(0, slots, per_worker)
        self._machines = [
            _Machine(f"{self.name}-{first // per_worker}", list(range(first, min(first + per_worker, slots)))) for first in firsts
        ]
        self._lives = [redis.Redis.from_url(redis_url, client_name=lifeline(machine.name)) for machine in self._machines]
        for life in self._lives:
            life.ping()
        self._next = 0  # the machine that takes work next
        self._hands: list[tuple[float, int, _Batches]] = []  # (time at which the next batch is done, number, batches)
        self._doing: dict[int, dict[str, Any]] = {}
        self._full_until = 0.0
        self._asked_at = time.monotonic()  # when work was last requested, and whether there was none
        self._found_none = True
        self._unfed_s = 0.0  # idle slot time while no work was waiting
        self._held_up_s = 0.0  # slot time lost because this process was late to assign or finish work
        self.spent: list[tuple[float, float, float]] = []  # (time, unfed, held up), by a clock that all processes share

    def run(self, seconds: float) -> None:
        """Runs for some seconds, or until the process receives a signal."""
        end = time.monotonic() + seconds
        beat = 0.0
        while (now := time.monotonic()) < end and not self._stop.is_set():
            if now - beat >= BEAT_EVERY_S:
                beat = now
                self.report()
                while (found := self.redis.rpop(prepare_queue(self.kind))) is not None:
                    self._prepare(_arguments(found)["scene"])
            idle = not self._take() and not self._answer(now)
            if idle:
                time.sleep(LOOK_EVERY_S)

    def stop_running(self) -> None:
        """Makes `run` return."""
        self._stop.set()

    def stop(self) -> None:
        """Deletes the workers' reports, after `run` has returned."""
        self.redis.delete(*(worker_key(machine.name) for machine in self._machines))
        for life in self._lives:
            life.close()
        self.redis.close()
        self.http.close()

    def report(self) -> None:
        """Writes every worker's report."""
        self.spent.append((time.monotonic(), self._unfed_s, self._held_up_s))
        self._serve_site()
        with self.redis.pipeline(transaction=False) as all_at_once:
            for number, machine in enumerate(self._machines):
                first = number * self._per_worker
                many = min(self._per_worker, self.slots - first)
                doing = [self._doing.get(slot, {}) for slot in range(first, first + many)]
                about = (machine.name, "host", 1, many, "simulated", self.kind, "ready", 0.0, 1e6, doing)
                knows = {"frames": True, "blurs": True, "vectors": True, "several": True, "adds": self.adds}
                in_hand = [*machine.joints, *(message for message, _, joint in machine.waiting if joint is None)]
                report = WorkerReport(*about, **knows, in_hand=in_hand)
                all_at_once.set(worker_key(machine.name), report.to_bytes(), ex=HEARTBEAT_TTL_S)
                if self.site:
                    terms = self._keeps.get(machine.name, Terms())
                    offer = Offer((f"{SITE}{self.site}",), 8 << 30, many, terms.digest, queues=terms.queues)
                    all_at_once.set(offer_key(machine.name), offer.to_bytes(), ex=HEARTBEAT_TTL_S)
            all_at_once.execute()

    def _serve_site(self) -> None:
        """Reads the terms that the service has set for the workers of the site, and consumes the queues that these terms name."""
        if self.site:
            names = [machine.name for machine in self._machines]
            said: Any = self.redis.mget([terms_key(name) for name in names])
            self._keeps = {name: Terms.from_bytes(one) for name, one in zip(names, said, strict=True) if one is not None}
            asked = {queue for terms in self._keeps.values() for queue in terms.queues}
            self._queues = [*sorted(asked), render_queue(self.kind)]

    def _take(self) -> bool:
        """Assigns waiting batches to idle slots of their machine, then reads new messages for the other idle slots.

        Returns whether there were new messages.
        """
        now = time.monotonic()
        many = 0
        for machine in self._machines:
            while machine.free and machine.waiting:
                self._help(now, machine)
            many += len(machine.free)
        waited_s, self._asked_at = (now - self._asked_at) * many, now
        self._unfed_s += waited_s if self._found_none else 0.0
        self._held_up_s += 0.0 if self._found_none else waited_s
        found: Any = None
        for queue in self._queues if many else ():
            if found := self.redis.rpop(queue, min(many, AT_ONCE)):
                break
        self._found_none = not found
        for message in found or []:
            machine = self._machine_with_free_slot()
            id, arguments = json.loads(message)["headers"]["id"], _arguments(message)
            if "joint" in arguments:
                work = JointBatch.from_json(arguments["joint"])
                if rest := work.pieces[max(2, self._per_worker) :]:
                    work = replace(work, pieces=work.pieces[: -len(rest)])
                    self.redis.rpush(queue, _with_pieces(message, rest))
                joint = machine.joints[id] = _Joint(id, work.hold_s, len(work.pieces), work.run)
                machine.waiting.extend((id, [work.batch(number)], joint) for number in range(joint.left))
            else:
                works = [RenderBatch.from_json(each) for each in arguments.get("batches") or [arguments["batch"]]]
                machine.waiting.append((id, works, None))
            while machine.free and machine.waiting:
                self._help(now, machine)
        return bool(found)

    def _machine_with_free_slot(self) -> _Machine:
        while True:  # machines take turns, as if they consumed one queue
            self._next = (self._next + 1) % len(self._machines)
            if self._machines[self._next].free:
                return self._machines[self._next]
            if not any(machine.free for machine in self._machines):
                return self._machines[self._next]

    def _help(self, now: float, machine: _Machine) -> None:
        message, works, joint = machine.waiting.popleft()
        self._begin(now, _Batches(message, machine, machine.free.pop(), works, joint=joint))

    def _begin(self, now: float, hand: _Batches) -> None:
        work = hand.batches[0]
        seconds = self.tile_sample_s * work.count
        hand.seconds.append(seconds)
        self._doing[hand.slot] = {**self._words(work), "message": hand.message}
        self._turn += 1
        heapq.heappush(self._hands, (now + seconds, self._turn, hand))

    def _answer(self, now: float) -> bool:
        """Sends finished results as workers do, waiting while the stream is full; returns whether it sent any."""
        due = []
        while self._hands and self._hands[0][0] <= now and len(due) < AT_ONCE:
            due.append(heapq.heappop(self._hands))
        if not due:
            return False
        if now < self._full_until or int(self.redis.xlen(RESULTS)) >= MAX_ENTRIES:
            self.waited += len(due)
            self._full_until = max(self._full_until, now + 0.05)
            for _, turn, hand in due:
                heapq.heappush(self._hands, (self._full_until, turn, hand))
            return False
        for at, _, hand in due:
            work, seconds = hand.batches.pop(0), hand.seconds.pop()
            self._held_up_s += 0.0 if hand.batches else now - at
            if hand.joint is None:
                self._send_sums(hand.machine, [(work, seconds)])
            else:
                self._add(now, hand.machine, hand.joint, work, seconds)
            if hand.batches:
                self._begin(max(at, now - 1.0), hand)
            else:
                del self._doing[hand.slot]
                hand.machine.free.append(hand.slot)
        return True

    def _add(self, now: float, machine: _Machine, joint: _Joint, work: RenderBatch, seconds: float) -> None:
        """Adds a finished batch to its joint message.

        The sums are sent once all batches of the message are finished, or the hold time has passed since the first unsent one.
        """
        joint.since = joint.since if joint.done else now
        joint.done.append((work, seconds))
        joint.left -= 1
        if joint.left and now - joint.since < joint.hold_s:
            return
        run: list[tuple[RenderBatch, float]] = []
        for each in sorted(joint.done, key=lambda each: each[0].first):
            if run and run[-1][0].first + run[-1][0].count != each[0].first:
                self._send_sums(machine, run, joint.run)
                run = []
            run.append(each)
        self._send_sums(machine, run, joint.run)
        joint.done.clear()
        if not joint.left:
            machine.joints.pop(joint.message, None)

    def _send_sums(self, machine: _Machine, run: list[tuple[RenderBatch, float]], of: Run | None = None) -> None:
        """Sends the sums of successive batches of a machine as one result.

        of: the run of the joint message, if the batches have one.
        """
        work, seconds = run[0]
        event = {"type": "batch", **self._words(work), "worker": machine.name, "seconds": seconds, "bad": [], "bad_count": 0}
        if len(run) > 1:
            parts = [(work.batch, work.first, work.count, seconds) for work, seconds in run]
            event |= {"type": "batches", "count": sum(work.count for work, _ in run), "parts": parts}
            del event["batch"]
        if of is not None:
            event["run"] = list(of)
        result = Result(event, self._pack(event["count"]))
        if not self._links.send(result):
            self._send_one(result)
            self.direct_bytes += len(result.sums or b"")
        self.rendered += len(run)
        self.samples += event["count"]

    def _send_one(self, result: Result) -> None:
        while not self._stop.is_set():
            try:
                self.redis.xadd(RESULTS, result.to_fields())  # type: ignore[arg-type]
                return
            except redis.RedisError:  # Redis is full until the service removes entries
                self.waited += 1
                time.sleep(0.05)

    def _pack(self, count: int) -> bytes:
        if count not in self._packed:
            if len(self._packed) >= PACKED_KEPT:
                self._packed.pop(next(iter(self._packed)))
            self._packed[count] = pack_sums(self._sums * count)
        return self._packed[count]

    def _words(self, work: RenderBatch) -> dict[str, Any]:
        words = {key: getattr(work, key) for key in ("batch", "job", "frame", "first", "count")}
        return {**words, "tile": list(work.tile)}


def _with_pieces(message: bytes, pieces: tuple[Piece, ...]) -> bytes:
    """Returns a joint message with only these pieces of its work, for other machines."""
    whole = json.loads(message)
    positional, arguments, more = json.loads(base64.b64decode(whole["body"]))
    arguments["joint"]["pieces"] = [list(piece) for piece in pieces]
    whole["body"] = base64.b64encode(json.dumps([positional, arguments, more]).encode()).decode()
    return json.dumps(whole).encode()


def _arguments(message: bytes) -> dict[str, Any]:
    _, arguments, _ = json.loads(base64.b64decode(json.loads(message)["body"]))
    return dict(arguments)


def main() -> None:
    """Runs simulated slots; the last line of output has their counts."""
    parser = argparse.ArgumentParser()
    for name in ("redis", "service", "token", "sums"):
        parser.add_argument(f"--{name}", required=True)
    parser.add_argument("--slots", type=int, required=True)
    parser.add_argument("--tile-sample-s", type=float, required=True)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--alone", action="store_true", help="each slot sends its own sums")
    parser.add_argument("--site", default="", help="where they are")
    parser.add_argument("--per-worker", type=int, default=PER_WORKER, help="slots of a machine")
    parser.add_argument("--name", default="peer", help="of its machines, before their numbers")
    o = parser.parse_args()
    about = (o.slots, np.load(Path(o.sums)), o.tile_sample_s, not o.alone, o.site, o.per_worker, o.name)
    slots = Slots(o.redis, o.service, o.token, *about)
    signal.signal(signal.SIGTERM, lambda *_: slots.stop_running())
    print("ready", flush=True)
    slots.run(o.seconds)
    said = {name: getattr(slots, name) for name in ("rendered", "samples", "waited", "direct_bytes", "spent")}
    print(json.dumps(said), flush=True)


if __name__ == "__main__":
    main()
