"""The connected workers, according to their reports in Redis, which expire unless renewed."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import redis

from protocol.blends import TAG
from protocol.card import card_queue
from protocol.contract import HEARTBEAT_EVERY_S, HEARTBEAT_TTL_S, WORKER_KEYS, WorkerReport, pause_key, worker_key
from protocol.lifeline import connected
from protocol.site import SITE, SiteReport, site_key
from protocol.terms import Offer, Terms, offer_key, terms_key
from protocol.vitals import LOG_TTL_S, Vitals, log_key, log_wanted_key, vitals_key
from renderer.sentences import Sentence, from_text, to_text
from service.scheduling.fleet.dead_letters import DeadLetters
from service.scheduling.fleet.needs import Needs
from service.scheduling.fleet.reports import report_of
from service.scheduling.fleet.speeds import Speeds

__all__ = ["PAUSED_BY_USER", "WorkerSnapshot", "Workers"]

PAUSED_BY_USER = Sentence("worker-paused-by-user", "Paused by a user.")

POLL_EVERY_S = 1.0
LATE_S = 2.5 * HEARTBEAT_EVERY_S
SILENT_TIMEOUT_S = (
    30.0  # seconds until a silent but connected worker is given up; a host without power leaves its connection open
)
PAUSE_TTL_S = 7 * 86400  # a worker of that name may return, but the reason is outdated some day
FAST_POLL_S = 0.05  # poll interval while no worker is ready or one is starting, so that the first job starts early
MAX_INVALID_KEYS = 1000  # keys
FEW_WORKERS = 100  # polling this many workers takes a hundredth of a core
CLOCK_SET_BACK_S = 2.0  # a clock that differs by this much was set back
LOG_TIMEOUT_S = 3.0
MAX_LINES, MAX_LINE = 500, 2000

Parsed = TypeVar("Parsed")


@dataclass(frozen=True)
class WorkerSnapshot:
    """Immutable snapshot of the workers. Any thread may read it."""

    reports: Mapping[str, WorkerReport] = field(default_factory=dict)
    orders: Mapping[str, str] = field(default_factory=dict)  # reason of each paused worker, by name
    vitals: Mapping[str, Vitals] = field(default_factory=dict)  # of the workers that report them
    speeds: Mapping[str, tuple[float, ...]] = field(default_factory=dict)  # as in Speeds
    offers: Mapping[str, Offer] = field(default_factory=dict)  # of the workers that report them
    sites: Mapping[str, SiteReport] = field(default_factory=dict)  # reducers at the sites of connected workers

    def ready_reports(self) -> list[WorkerReport]:
        """Returns the reports of the workers that accept work at present."""
        return [report for report in self.reports.values() if report.state == "ready" and report.name not in self.orders]

    def slots(self, kind: str) -> int:
        """Returns the number of slots of the ready workers of this kind."""
        return sum(report.slots for report in self.ready_reports() if report.kind == kind)

    def cpu_slots(self, kind: str) -> int:
        """Returns the number of slots of the ready workers of this kind that render with the CPU."""
        return sum(report.slots for report in self.ready_reports() if report.kind == kind and not report.has_card_queue)

    def with_cards(self, kind: str) -> list[WorkerReport]:
        """Returns the reports of the ready workers of this kind whose slots render with graphics cards."""
        return [report for report in self.ready_reports() if report.kind == kind and report.has_card_queue]

    def reads_preparation(self, kind: str) -> bool:
        """Returns True if a ready worker of this kind reads the kind's queue of preparation and path guides.

        Workers with graphics cards beside another worker of their machine do not: that one does, unless it is paused.
        """
        return any(report.kind == kind and (report.views or not report.has_card_queue) for report in self.ready_reports())

    def slots_serving(self, queue: str, of_cpu: bool = False) -> dict[str, int]:
        """Returns the number of slots, by worker kind, of the ready workers that serve a queue.

        queue: queue of batches with certain requirements. Only workers that have confirmed to serve it are counted.
        of_cpu: whether to exclude workers with graphics cards, which confirm too but get such batches from queues of their own.
        """
        found: dict[str, int] = {}
        for report in self.ready_reports():
            offer = self.offers.get(report.name)
            is_own = report.has_card_queue and queue == card_queue(report.name)
            if is_own or (offer is not None and queue in offer.queues and not (of_cpu and report.has_card_queue)):
                found[report.kind] = found.get(report.kind, 0) + report.slots
        return found

    def best_kind(self) -> str | None:
        """Returns the worker kind with the most slots; None if no worker is ready."""
        kinds = {report.kind for report in self.ready_reports()}
        return max(sorted(kinds), key=self.slots, default=None)

    def frame_preparing_kind(self) -> str | None:
        """Returns the kind with the most slots among the workers that can prepare frames of shots; None if none is ready."""
        return self._kind_of([report for report in self.ready_reports() if report.frames])

    def open_shutter_kind(self) -> str | None:
        """Returns the largest worker kind that can prepare frames with an open shutter (motion blur); None if there is none.

        This is the kind with the most slots all of whose ready workers support it: any of them may fetch a message from the
        kind's queue.
        """
        ready = self.ready_reports()
        unable = {report.kind for report in ready if not report.blurs}
        return self._kind_of([report for report in ready if report.blurs and report.kind not in unable])

    def motion_vector_kind(self) -> str | None:
        """Returns the largest worker kind that can compute motion vectors; None if there is none.

        This is the kind with the most slots all of whose ready workers can compute them.
        """
        ready = self.ready_reports()
        unable = {report.kind for report in ready if not report.vectors}
        return self._kind_of([report for report in ready if report.kind not in unable])

    def environment_kind(self) -> str | None:
        """Returns the largest worker kind that can make thumbnails of environment images; None if there is none.

        Only kinds count whose ready workers all report the feature `views`, which came with the same release as these thumbnails;
        the largest is the one with the most slots.
        """
        ready = self.ready_reports()
        unable = {report.kind for report in ready if not report.views}
        return self._kind_of([report for report in ready if report.kind not in unable])

    def blender_kind(self) -> str | None:
        """Returns the kind with the most slots among the workers that can open .blend files; None if none is ready."""
        return self._kind_of([report for report in self.ready_reports() if self.has_blender(report.name)])

    def has_blender(self, name: str) -> bool:
        """Returns True if the worker with this name can open .blend files."""
        return name in self.offers and TAG in self.offers[name].tags

    def accepts_several(self, kind: str) -> bool:
        """Returns True if all workers of this kind accept several batches in one message.

        Any of them may receive the message.
        """
        return all(report.several for report in self.reports.values() if report.kind == kind)

    def accepts_recall(self, kind: str) -> bool:
        """Returns True if all workers of this kind return the unbegun batches of a message that is recalled."""
        return all(report.recalls for report in self.reports.values() if report.kind == kind)

    def accepts_joint(self, kind: str) -> bool:
        """Returns True if all workers of this kind support joint messages.

        The slots of a worker render the batches of such a message in parallel, and the worker adds up their sums of one tile.
        """
        return all(report.adds for report in self.reports.values() if report.kind == kind)

    def denoising_kind(self) -> str | None:
        """Returns the kind with the most slots among the workers that can denoise; None if none is ready."""
        return self._kind_of([report for report in self.ready_reports() if report.denoises])

    def is_about_to_change(self) -> bool:
        """Returns True if workers should be polled more often: none is ready, or there are few and one is starting."""
        if not self.ready_reports():
            return True
        return len(self.reports) <= FEW_WORKERS and any(report.state == "starting" for report in self.reports.values())

    def _kind_of(self, reports: list[WorkerReport]) -> str | None:
        slots: dict[str, int] = {}
        for report in reports:
            slots[report.kind] = slots.get(report.kind, 0) + report.slots
        return max(sorted(slots), key=lambda kind: slots[kind], default=None)

    def current(self) -> list[dict[str, Any]]:
        """Returns the current work of all busy slots, as reported by the workers."""
        return [doing for report in self.reports.values() for doing in report.current if doing]


class Workers:
    """Polls the workers' reports, and pauses workers. Each poll, in the engine's thread, replaces the snapshot `roster`."""

    def __init__(self, connection: redis.Redis, on_change: Callable[[str], None], dead_letters: DeadLetters) -> None:
        """Creates an empty roster.

        on_change: called with the name of each worker that has changed. dead_letters: list to which invalid reports are added.
        """
        self._dead_letters = dead_letters
        self._redis = connection
        self._on_change = on_change
        self._last_polled = -math.inf
        self._strange: set[bytes] = set()  # keys with invalid reports, each logged once
        self._speeds = Speeds()
        self._vanished: dict[str, float] = {}  # workers whose report has expired, and since when
        self._ahead = math.inf  # difference between Redis' clock and this process' monotonic clock at the latest poll
        self.roster = WorkerSnapshot()

    def refresh(self, now: bool = False) -> None:
        """Polls the workers if the poll interval has passed. now: whether to poll in any case. Raises redis.RedisError."""
        age = time.monotonic() - self._last_polled
        if not now and age < (FAST_POLL_S if self.roster.is_about_to_change() else POLL_EVERY_S):
            return
        self._last_polled = time.monotonic()
        keys = sorted(self._redis.scan_iter(WORKER_KEYS, count=1000))
        self._correct_expiries([*keys, *(site_key(name) for name in self.roster.sites)])
        values: Any = self._redis.mget(keys) if keys else []
        found = [self._parse_report(key, value) for key, value in zip(keys, values, strict=True) if value is not None]
        reports = {report.name: report for report in found if report is not None}
        names = sorted(reports)
        whys: Any = self._redis.mget([pause_key(name) for name in names]) if names else []
        orders = {
            name: from_text(reason.decode(errors="replace"))
            for name, reason in zip(names, whys, strict=True)
            if reason is not None
        }
        raw_vitals: Any = self._redis.mget([vitals_key(name) for name in names]) if names else []
        vitals = self._parse_all(Vitals.from_bytes, vitals_key, names, raw_vitals)
        raw_offers: Any = self._redis.mget([offer_key(name) for name in names]) if names else []
        offers = self._parse_all(Offer.from_bytes, offer_key, names, raw_offers)
        self._speeds.add_reports(reports.values())
        self._vanished |= dict.fromkeys(self.roster.reports.keys() - reports.keys(), self._last_polled)
        self._vanished = {name: since for name, since in self._vanished.items() if name not in reports}
        before, self.roster = (
            self.roster,
            WorkerSnapshot(reports, orders, vitals, self._speeds.speeds_by_worker, offers, self._sites(offers)),
        )
        for name in sorted(before.reports.keys() | reports.keys()):
            had, has = ((each.reports.get(name), each.orders.get(name), each.offers.get(name)) for each in (before, self.roster))
            if had != has:
                self._on_change(name)

    def _correct_expiries(self, keys: list[Any]) -> None:
        """Limits the expiry of the workers' keys if the clock of Redis was set back. Raises redis.RedisError.

        Otherwise the reports of departed workers, and the work in them, would persist for as long as the clock was set back.
        """
        seconds, micros = self._redis.time()
        before, self._ahead = self._ahead, seconds + micros / 1e6 - time.monotonic()
        if self._ahead > before - CLOCK_SET_BACK_S:
            return
        with self._redis.pipeline(transaction=False) as all_at_once:
            for key in keys:
                all_at_once.pttl(key)
            for key, left_ms in zip(keys, all_at_once.execute(), strict=True):
                if left_ms > 1000 * HEARTBEAT_TTL_S:
                    all_at_once.expire(key, HEARTBEAT_TTL_S)
            all_at_once.execute()

    def _sites(self, offers: Mapping[str, Offer]) -> dict[str, SiteReport]:
        """Returns the reports of the reducers at the workers' sites, by site. Raises redis.RedisError.

        A reducer adds up the sums of all machines at a site (protocol/site.py).
        """
        tags = {tag for offer in offers.values() for tag in offer.tags if tag.startswith(SITE)}
        names = sorted(tag.removeprefix(SITE) for tag in tags)
        raw_reports: Any = self._redis.mget([site_key(name) for name in names]) if names else []
        return self._parse_all(SiteReport.from_bytes, site_key, names, raw_reports)

    def send_terms(self, terms: Mapping[str, Terms], needs: Iterable[Needs]) -> None:
        """Sends each worker its settings (protocol/terms.py), unless it has confirmed them already. Raises redis.RedisError.

        terms: administrators' settings, by worker name. needs: requirements of the active jobs. A worker must serve the queues
        of all requirements that it meets.
        """
        different = {each.text: each for each in needs}
        for name, offer in self.roster.offers.items():
            kind = self.roster.reports[name].kind
            queues = tuple(sorted(each.queue(kind) for each in different.values() if each.are_met(offer)))
            wanted = replace(terms.get(name, Terms()), queues=queues)
            if wanted.digest != offer.keeps:
                self._redis.set(terms_key(name), wanted.to_bytes())

    def has_late_report(self) -> bool:
        """Returns True if the report of any worker is so old that its current work is unknown. Raises redis.RedisError."""
        with self._redis.pipeline(transaction=False) as all_at_once:
            for name in self.roster.reports:
                all_at_once.pttl(worker_key(name))
            left_ms = [ms for ms in all_at_once.execute() if ms >= 0]
        return min(left_ms, default=math.inf) < 1000 * (HEARTBEAT_TTL_S - LATE_S)

    def silent_workers(self) -> set[str]:
        """Returns the names of the workers that are connected to Redis but have stopped reporting. Raises redis.RedisError."""
        now = time.monotonic()
        lately = {name for name, since in self._vanished.items() if now - since < SILENT_TIMEOUT_S}
        living = connected(self._redis, lately) if lately else set()
        self._vanished = {name: since for name, since in self._vanished.items() if name in living}
        return living

    def pause(self, name: str, reason: str) -> None:
        """Pauses a worker until `resume` is called. reason: shown to users. Thread-safe. Raises redis.RedisError."""
        self._redis.set(pause_key(name), to_text(reason), ex=PAUSE_TTL_S)

    def pause_reasons(self) -> dict[str, str]:
        """Returns the reasons of all paused workers by name, including workers that are not connected.

        Raises redis.RedisError.
        """
        keys = list(self._redis.scan_iter(pause_key("*"), count=1000))
        values: Any = self._redis.mget(keys) if keys else []
        prefix = len(pause_key(""))
        found = ((key.decode(errors="replace")[prefix:], reason) for key, reason in zip(keys, values, strict=True))
        return {name: from_text(reason.decode(errors="replace")) for name, reason in found if reason is not None}

    def resume(self, name: str) -> None:
        """Resumes a paused worker. Thread-safe. Raises redis.RedisError."""
        self._redis.delete(pause_key(name))

    def log(self, name: str) -> list[str] | None:
        """Returns the last lines of a worker's log; None if the worker does not send them in time.

        Blocks for seconds; do not call it in the engine's thread. Raises redis.RedisError.
        """
        self._redis.set(log_wanted_key(name), b"1", ex=LOG_TTL_S)
        deadline = time.monotonic() + LOG_TIMEOUT_S
        while (found := self._redis.get(log_key(name))) is None and time.monotonic() < deadline:
            time.sleep(0.1)
        try:
            lines = json.loads(found) if isinstance(found, bytes) else None
        except (ValueError, RecursionError):
            return None
        return [str(line)[:MAX_LINE] for line in lines[-MAX_LINES:]] if isinstance(lines, list) else None

    def _parse_all(
        self, read: Callable[[bytes], Parsed], key_of: Callable[[str], str], names: list[str], values: list[bytes | None]
    ) -> dict[str, Parsed]:
        """Parses the values of the workers' keys with `read`. Returns them by worker; invalid and missing values are omitted.

        key_of: returns the Redis key of a worker. names, values: the workers, and the value of each one's key.
        """
        found = {}
        for name, value in zip(names, values, strict=True):
            if value is not None and (parsed := self._parse(read, key_of(name).encode(), value)) is not None:
                found[name] = parsed
        return found

    def _parse_report(self, key: bytes, value: bytes) -> WorkerReport | None:
        """Parses a worker's report; None if it is invalid, for instance because the worker has another release."""
        return self._parse(lambda value: report_of(key, value), key, value)

    def _parse(self, read: Callable[[bytes], Parsed], key: bytes, value: bytes) -> Parsed | None:
        """Parses the value of a worker's key with `read`; None if that raises an error.

        An invalid value is added to the dead letters once.
        """
        try:
            parsed = read(value)
        except Exception as error:
            if key not in self._strange:
                if len(self._strange) >= MAX_INVALID_KEYS:
                    self._strange.clear()
                self._strange.add(key)
                self._dead_letters.add(key.decode(errors="backslashreplace")[:200], error, value)
            return None
        self._strange.discard(key)
        return parsed
