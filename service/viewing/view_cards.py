"""Graphics cards that render live views: which of them accept a view, how fast they are, and which are busy with batches."""

from __future__ import annotations

import json
import time
from collections.abc import Collection

from protocol.contract import WorkerReport
from renderer.settings import RenderSettings
from service.scheduling.snapshot import SnapshotHolder
from service.viewing.pending import PendingMessage
from service.viewing.sample_costs import SMOOTHING, SampleCosts
from service.viewing.session import ViewSession
from service.viewing.view_request import ViewRequest

__all__ = ["ViewCards"]

AHEAD = 2  # messages per slot: one in progress, and one that waits
START_TIMEOUT_S = 0.15  # without an answer, after which a waiting message is taken back: the slot renders a batch
BUSY_S = 1.0  # after that, for which a card gets pieces only of views that show a picture
REFUSAL_S = 60.0  # until a card that could not render a scene gets it again
MAX_REFUSALS, MAX_WORKERS = 1000, 256
FREE = ("width", "height", "view", "views", "seed", "film_exponent", "background")  # settings that no card refuses
DRAFT_SMOOTHING = 0.7  # of the costs of drafts, whose launches cost more than their samples while they are small
LEFT_OUT = ("light_groups", "light_paths", "cryptomatte", "deep")  # and those that views do not have


class ViewCards:
    """Selects the graphics cards to which pieces of views are sent. Used in the scheduler's thread only."""

    def __init__(self, board: SnapshotHolder) -> None:
        self._board = board
        self._costs: dict[str, SampleCosts] = {}  # by worker
        self._draft_costs: dict[str, SampleCosts] = {}  # likewise of drafts, whose sums are not copied from the card
        self._refusals: dict[tuple[str, str], float] = {}  # (worker, `_name`) -> time until which it counts
        self._answered: dict[str, float] = {}  # by worker, the time of its latest answer
        self._busy_until: dict[str, float] = {}  # by worker

    def accepting(self, kind: str, compiled: str = "", settings: RenderSettings | None = None) -> list[WorkerReport]:
        """Returns the reports of the ready workers of this kind whose cards render views.

        settings: leaves out workers that have refused the scene `compiled` with these settings.
        """
        ready = [report for report in self._board.roster.with_cards(kind) if report.views_on_cards]
        if not self._refusals or settings is None:
            return ready
        now, name = time.monotonic(), _name(compiled, settings)
        return [report for report in ready if self._refusals.get((report.name, name), 0.0) < now]

    def free(
        self,
        session: ViewSession,
        out: Collection[PendingMessage],
        shared: Collection[str],
        has_cpu: bool,
        drafts: bool = False,
    ) -> WorkerReport | None:
        """Returns the report of a worker with a card that takes another message of the session's view; None if there is none.

        out: all messages that are not answered. shared: names of workers that have batches queued. has_cpu: whether CPU slots
        render the view, too. drafts: whether the message is for a draft.
        """
        if session.settings is None or session.request is None:
            return None
        for report in self.accepting(session.kind, session.compiled, session.settings):
            is_busy = has_cpu and self.is_busy(report.name)
            if (is_busy and not session.has_picture) or (drafts and not report.drafts_views):
                continue
            is_unknown = self.cost_s(session.request, report.name) is None
            ahead = 1 if is_busy or is_unknown or (report.name in shared and session.samples) else AHEAD
            if sum(AHEAD if each.is_declined else 1 for each in out if each.card == report.name) < ahead * report.slots:
                return report
        return None

    def is_busy(self, worker: str) -> bool:
        """Returns True if a worker's cards did not begin a message in time."""
        return time.monotonic() < self._busy_until.get(worker, 0.0)

    def is_late(self, out: PendingMessage) -> bool:
        """Returns True if a card should have begun this message: its slot probably renders a batch."""
        since = max(out.last_seen, self._answered.get(out.card, 0.0))
        return bool(out.card) and not out.has_started and time.monotonic() - since > START_TIMEOUT_S

    def set_busy(self, worker: str) -> None:
        """Records that a worker's cards did not begin a message in time."""
        self._busy_until[worker] = time.monotonic() + BUSY_S

    def record_answer(self, worker: str, has_begun: bool) -> None:
        """Records an answer of a worker's card. has_begun: whether it has just begun a message."""
        self._answered[worker] = time.monotonic()
        if has_begun:
            self._busy_until.pop(worker, None)

    def refuse(self, worker: str, session: ViewSession) -> None:
        """Records that a worker's cards cannot render a session's view."""
        if len(self._refusals) >= MAX_REFUSALS:
            self._refusals.clear()
        if session.settings is not None:
            self._refusals[worker, _name(session.compiled, session.settings)] = time.monotonic() + REFUSAL_S

    def cost_s(self, request: ViewRequest, worker: str) -> float | None:
        """Returns the measured seconds per sample of a pixel on one of a worker's cards; None if unknown."""
        return self._costs[worker].known(request) if worker in self._costs else None

    def update(self, request: ViewRequest, worker: str, cost_s: float) -> None:
        """Adds a measurement of the seconds per sample of a pixel, `cost_s`, on a worker's card."""
        _update(self._costs, request, worker, cost_s)

    def draft_cost_s(self, request: ViewRequest, kind: str, compiled: str, settings: RenderSettings) -> float | None:
        """Returns the expected seconds per sample of a pixel of a draft; None without an idle card that makes one.

        It is that of the slowest of the cards that have rendered the scene: any may render the draft. Arguments as for `rate`.
        """
        able = [report.name for report in self.accepting(kind, compiled, settings) if report.drafts_views]
        costs = [self._draft_cost_s(request, name) for name in able if not self.is_busy(name)]
        return max((cost for cost in costs if cost is not None), default=None)

    def _draft_cost_s(self, request: ViewRequest, worker: str) -> float | None:
        known = self._draft_costs[worker].known(request) if worker in self._draft_costs else None
        return known or self.cost_s(request, worker)

    def update_draft(self, request: ViewRequest, worker: str, cost_s: float) -> None:
        """Adds a measurement of the seconds per sample of a pixel of a draft, `cost_s`, on a worker's card."""
        _update(self._draft_costs, request, worker, cost_s, DRAFT_SMOOTHING)

    def rate(self, request: ViewRequest, kind: str, compiled: str, settings: RenderSettings) -> float:
        """Returns the samples of a pixel per second of all cards of this worker kind that render a view and are not busy.

        Cards are left out that have not rendered the scene yet.
        """
        idle = [report for report in self.accepting(kind, compiled, settings) if not self.is_busy(report.name)]
        return sum(report.slots / cost for report in idle if (cost := self.cost_s(request, report.name)))


def _update(
    costs: dict[str, SampleCosts], request: ViewRequest, worker: str, cost_s: float, smoothing: float = SMOOTHING
) -> None:
    if worker not in costs and len(costs) >= MAX_WORKERS:
        costs.clear()
    costs.setdefault(worker, SampleCosts(smoothing)).update(request, cost_s)


def _name(compiled: str, settings: RenderSettings) -> str:
    """Returns what a card refuses as text: the compiled scene, and those of the settings on which it may depend."""
    seen = {name: value for name, value in settings.to_json().items() if name not in (*FREE, *LEFT_OUT)}
    return f"{compiled} {json.dumps(seen, sort_keys=True)}"
