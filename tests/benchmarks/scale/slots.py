"""Simulated slots: they speak the real contract over the real Redis, and answer with a real renderer's sums after the time that
rendering them would take.

Of a tile of a real picture the sums are kept and said to be one sample's; the sums of n samples are n times those. So the packed
bytes are as many as a renderer's, cost the machine next to nothing to make, and what a film must hold at the end is known to the
bit.
"""

from __future__ import annotations

import argparse
import base64
import heapq
import json
import signal
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import redis

from renderer.film import Sums
from tests.service.peer_worker import PeerWorker
from worker.contract import HEARTBEAT_TTL_S, RESULTS, RenderBatch, Result, WorkerReport, prepare_queue, render_queue, worker_key
from worker.results import MAX_ENTRIES
from worker.sums import pack_sums

__all__ = ["Slots", "main"]

PER_WORKER = 32
LOOK_EVERY_S = 0.005
BEAT_EVERY_S = 1.0
AT_ONCE = 64  # messages or answers, between two looks at the clock
SAMPLES = 16  # of the rendered tile
PACKED_KEPT = 64


@dataclass
class _Batches:
    """What a slot has in hand: the batches of one message, in turn."""

    message: str
    slot: int
    batches: list[RenderBatch]
    seconds: list[float] = field(default_factory=list)


class Slots(PeerWorker):
    """Many slots in one thread. A sample of a pixel takes each of them the same time."""

    def __init__(self, redis_url: str, service: str, token: str, slots: int, sums: Sums, tile_sample_s: float) -> None:
        """sums: (CHANNELS, side, side) of one sample of a tile. tile_sample_s: how long a slot takes for that."""
        super().__init__(redis_url, service, token, slots=slots)
        self.tile_sample_s = tile_sample_s
        self.rendered = 0  # batches
        self.samples = 0  # samples of tiles, those that were rendered again included
        self.waited = 0  # answers that found the stream full
        self._sums = sums
        self._packed: dict[int, bytes] = {}
        self._free = list(range(slots))
        self._hands: list[tuple[float, int, _Batches]] = []  # by when the next of its batches is rendered
        self._doing: dict[int, dict[str, Any]] = {}
        self._full_until = 0.0

    def run(self, seconds: float) -> None:
        """Work for so long, or until the process is told to end."""
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
        """Let `run` return."""
        self._stop.set()

    def stop(self) -> None:
        """Vanish, once `run` has returned."""
        self.redis.delete(*(worker_key(f"{self.name}-{first // PER_WORKER}") for first in range(0, self.slots, PER_WORKER)))
        self.redis.close()
        self.http.close()

    def report(self) -> None:
        """Every worker's report."""
        with self.redis.pipeline(transaction=False) as all_at_once:
            for first in range(0, self.slots, PER_WORKER):
                name, many = f"{self.name}-{first // PER_WORKER}", min(PER_WORKER, self.slots - first)
                doing = [self._doing.get(slot, {}) for slot in range(first, first + many)]
                about = (name, "host", 1, many, "simulated", self.kind, "ready", 0.0, 1e6, doing)
                report = WorkerReport(*about, frames=True, blurs=True, vectors=True, several=True)
                all_at_once.set(worker_key(name), report.to_bytes(), ex=HEARTBEAT_TTL_S)
            all_at_once.execute()

    def _take(self) -> bool:
        """Let free slots take what waits."""
        many = min(len(self._free), AT_ONCE)
        found: Any = self.redis.rpop(render_queue(self.kind), many) if many else None
        for message in found or []:
            arguments = _arguments(message)
            works = [RenderBatch.from_json(each) for each in arguments.get("batches") or [arguments["batch"]]]
            hand = _Batches(json.loads(message)["headers"]["id"], self._free.pop(), works)
            self._begin(time.monotonic(), hand)
        return bool(found)

    def _begin(self, now: float, hand: _Batches) -> None:
        work = hand.batches[0]
        seconds = self.tile_sample_s * work.count
        hand.seconds.append(seconds)
        self._doing[hand.slot] = {**self._words(work), "message": hand.message}
        heapq.heappush(self._hands, (now + seconds, hand.slot, hand))

    def _answer(self, now: float) -> bool:
        """Send what is rendered by now, as workers do: while the stream is full, they wait."""
        due = []
        while self._hands and self._hands[0][0] <= now and len(due) < AT_ONCE:
            due.append(heapq.heappop(self._hands))
        if not due:
            return False
        if now < self._full_until or int(self.redis.xlen(RESULTS)) >= MAX_ENTRIES:
            self.waited += len(due)
            self._full_until = max(self._full_until, now + 0.05)
            for _, slot, hand in due:
                heapq.heappush(self._hands, (self._full_until, slot, hand))
            return False
        for at, _, hand in due:
            work, seconds = hand.batches.pop(0), hand.seconds.pop()
            event = {"type": "batch", **self._words(work), "worker": f"{self.name}-{hand.slot // PER_WORKER}"}
            event |= {"seconds": seconds, "bad": [], "bad_count": 0}
            self._send_one(Result(event, self._pack(work.count)))
            self.rendered += 1
            self.samples += work.count
            if hand.batches:
                self._begin(max(at, now - 1.0), hand)
            else:
                del self._doing[hand.slot]
                self._free.append(hand.slot)
        return True

    def _send_one(self, result: Result) -> None:
        while not self._stop.is_set():
            try:
                self.redis.xadd(RESULTS, result.to_fields())  # type: ignore[arg-type]
                return
            except redis.RedisError:  # its memory is full: the service makes room
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


def _arguments(message: bytes) -> dict[str, Any]:
    _, arguments, _ = json.loads(base64.b64decode(json.loads(message)["body"]))
    return dict(arguments)


def main() -> None:
    """A process of simulated slots; its counts are its last line."""
    parser = argparse.ArgumentParser()
    for name in ("redis", "service", "token", "sums"):
        parser.add_argument(f"--{name}", required=True)
    parser.add_argument("--slots", type=int, required=True)
    parser.add_argument("--tile-sample-s", type=float, required=True)
    parser.add_argument("--seconds", type=float, default=600.0)
    o = parser.parse_args()
    slots = Slots(o.redis, o.service, o.token, o.slots, np.load(Path(o.sums)), o.tile_sample_s)
    signal.signal(signal.SIGTERM, lambda *_: slots.stop_running())
    print("ready", flush=True)
    slots.run(o.seconds)
    print(json.dumps({"rendered": slots.rendered, "samples": slots.samples, "waited": slots.waited}), flush=True)


if __name__ == "__main__":
    main()
