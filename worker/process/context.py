"""State shared by all processes of a worker, created by the parent before it forks."""

from __future__ import annotations

import os
import platform
import socket
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from protocol.blends import blender_queue
from protocol.card import card_queue
from protocol.channel import HTTPS
from protocol.contract import WorkerReport, denoise_queue, own_prepare_queue, prepare_queue, render_queue
from protocol.joint import help_queue
from protocol.view_parts import card_view_queue, view_queue
from renderer import denoise
from renderer.blender.program import Blender
from renderer.cuda.driver import Card
from renderer.cuda.verdicts import failure_of
from renderer.sentences import to_text
from worker.exchange.cache import BlobCache
from worker.exchange.link import Link
from worker.exchange.results import PIECE_TIMEOUT_S, RELAYED_PIECE_TIMEOUT_S, ResultStream
from worker.machine.cards_worker import CardsWorker
from worker.machine.joint_pieces import Pieces
from worker.machine.status import SlotBoard
from worker.process.apply_terms import TermsKeeper
from worker.site.link import SiteLink
from worker.telemetry.log_tail import LogTail

__all__ = ["WorkerContext", "cpu_name", "current", "set_current"]


@dataclass
class WorkerContext:
    """The state of a worker that all its processes share: its name, its kind, its connections, and its slots' current work.

    kind: `renderer.jit.kind()`; only workers of the same kind add samples to the same film.
    """

    name: str
    slots: int
    kind: str
    redis_url: str
    link: Link
    cache: BlobCache
    board: SlotBoard
    pid: int = field(default_factory=os.getpid)
    host: str = field(default_factory=socket.gethostname)
    started: float = field(default_factory=time.time)
    tail: LogTail | None = None  # of the log
    keeping: TermsKeeper | None = None  # applies the service's terms; in the parent process only
    blender: Blender | None = None  # to open .blend files; None without Blender
    cards: tuple[Card, ...] = ()  # graphics cards, one for each slot; none: all slots render with the CPU
    cards_unused: tuple[str, ...] = ()  # a sentence for each card that is not used
    is_beside_cpu: bool = False  # whether another worker of this machine renders with the CPU; this one only with its cards
    cards_worker: CardsWorker | None = None  # the other one, if this worker starts it
    is_refused: bool = False  # whether the worker ends because requested cards cannot be used
    pieces: Pieces | None = None  # none where this machine has no folder for them
    is_over_https: bool = False  # whether `redis_url` is that of a relay (worker/exchange/relay.py)
    _results: ResultStream | None = None
    _sites: SiteLink | None = None

    @property
    def queues(self) -> list[str]:
        """Returns the queues that this worker serves."""
        if self.cards:
            return [card_view_queue(self.name), card_queue(self.name), *self._queues_beside_cards()]
        return [render_queue(self.kind), *self._other_queues()]

    def _queues_beside_cards(self) -> list[str]:
        return [own_prepare_queue(self.kind, self.name)] if self.is_beside_cpu else self._other_queues()

    def _other_queues(self) -> list[str]:
        queues = [view_queue(self.kind), help_queue(self.name), prepare_queue(self.kind)]
        queues.append(own_prepare_queue(self.kind, self.name))
        queues += [blender_queue(self.kind)] if self.blender is not None else []
        return [*queues, denoise_queue(self.kind)] if denoise.is_available() else queues

    def queue_of_returned(self, queue: str) -> str:
        """Returns the queue for work that this worker gives back: `queue`, from which it came, or its own.

        A worker over HTTPS may put messages only into its own queue. If it ends, their leases do too.
        """
        return help_queue(self.name) if self.is_over_https else queue

    @property
    def results(self) -> ResultStream:
        """The stream of results; each process opens its own connection."""
        if self._results is None:
            timeout_s = RELAYED_PIECE_TIMEOUT_S if self.is_over_https else PIECE_TIMEOUT_S
            self._results = ResultStream(self.redis_url, piece_timeout_s=timeout_s)
        return self._results

    @property
    def sites(self) -> SiteLink:
        """The connection to the reducer that adds up the results of this site; each process opens its own."""
        if self._sites is None:
            self._sites = SiteLink(self.redis_url)
        return self._sites

    def report(self, is_paused: bool = False) -> WorkerReport:
        """Returns the worker's report, with the current work of its slots. is_paused: report it as paused rather than ready."""
        doing, speed = self.board.read()
        slots = self.keeping.slots_now if self.keeping else self.slots
        failed = {card: reason for card in self.cards if (reason := failure_of(card))}  # with a kernel that came later
        beside = self.cards_worker.unused() if self.cards_worker is not None else []
        if slots < self.slots:  # busy slots are shown in any case
            doing = sorted(doing, key=bool, reverse=True)[: max(slots, sum(map(bool, doing)))]
        return WorkerReport(
            name=self.name,
            host=self.host,
            pid=self.pid,
            slots=slots,
            cpu=cpu_name(),
            kind=self.kind,
            state="paused" if is_paused else "ready",
            started=self.started,
            samples_per_s=speed,
            current=doing,
            denoises=denoise.is_available(),
            frames=True,
            blurs=True,
            vectors=True,
            several=True,
            recalls=True,
            trains_guides=True,
            views=view_queue(self.kind) in self.queues,
            explains=True,
            denoises_views=denoise.is_available(),
            adds=self.pieces is not None,
            in_hand=self._messages_in_hand(),
            has_card_queue=bool(self.cards),
            views_on_cards=bool(self.cards),
            drafts_views=bool(self.cards),
            cards=[self._card(card, slot) for slot, card in enumerate(self.cards) if card not in failed],
            cards_unused=[to_text(each) for each in (*self.cards_unused, *failed.values(), *beside)],
            transport=HTTPS if self.is_over_https else "",
        )

    def _card(self, card: Card, slot: int) -> dict[str, Any]:
        return {
            "number": card.number,
            "name": card.name,
            "memory": card.memory,
            "capability": ".".join(map(str, card.capability)),
            "slot": slot,
            "samples_per_s": self.board.speed(slot),
        }

    def _messages_in_hand(self) -> list[str]:
        try:
            return self.pieces.messages() if self.pieces is not None else []
        except OSError:
            return []

    def after_fork(self) -> None:
        """Closes the connections inherited from the parent process."""
        self.link.forget_connections()
        self._results = self._sites = None


_current: WorkerContext | None = None


def set_current(context: WorkerContext) -> None:
    """Sets the worker of this process. Called by the parent before Celery starts."""
    global _current
    _current = context


def current() -> WorkerContext:
    """Returns the worker that this process belongs to."""
    if _current is None:
        raise RuntimeError("no worker is running in this process; start one with `python -m worker`")
    return _current


def cpu_name() -> str:
    """Returns the model name of the processor."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
