"""An active job: its film, frames, speed, and failed batches."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from protocol.contract import render_queue
from renderer.settings import MAX_SPP, RenderSettings, Tile
from service.scheduling.fleet.needs import Needs
from service.scheduling.jobs.active_frame import ActiveFrame, FrameRow
from service.scheduling.jobs.agenda import FrameOrder
from service.scheduling.jobs.batch_failures import BatchFailures
from service.scheduling.jobs.costs import Costs
from service.scheduling.jobs.frame_progress import FrameProgress
from service.scheduling.jobs.history import History
from service.scheduling.jobs.noise_budget import NoiseBudget
from service.scheduling.jobs.plan import Range
from service.scheduling.jobs.shares import share_of
from service.scheduling.jobs.totals import Totals
from service.shot import IN_TURN_ORDER, Shot
from service.store.films import Film
from service.store.models import Job, blobs_of

__all__ = ["ActiveJob"]

SMALLEST_BATCH_S = 0.04
SMALLEST_CARD_MESSAGE_S = 0.1
SMOOTHING = 0.3
# Time constants, in seconds, of the average number of busy slots; between them it is a quarter of the time so far.
LEAST_BUSY_S, MOST_BUSY_S = 8.0, 60.0
WORK_PER_SLOT_S = 30.0  # seconds of work that justify another slot
FRAMES_PER_STEP = 2000  # frames per step


class ActiveJob:
    """In-memory state of a job that has not ended. Changed only by the engine's thread; other threads read its numbers."""

    def __init__(
        self,
        row: Job,
        film: Film,
        compiled: dict[str, str],
        of_scene: set[str],
        settings_of: Callable[[int], RenderSettings],
    ) -> None:
        """Creates a job without frames. Before any other use, call `add_frames` and exhaust `prepare_in_steps`.

        compiled: SHA-256 of the scene compiled for the job's start time, by worker kind.
        of_scene: hashes of all blobs that the scene refers to. They are not released together with the frames.
        settings_of: returns the stored render settings of the frame with a key.
        """
        assert row.settings is not None and row.spp is not None
        self.id = row.id
        self.scene = row.compiled_scene_id
        self.created = row.created
        self.request = row.request
        self.film = film
        self._settings_of = settings_of
        self.compiled = compiled
        self.of_scene = of_scene
        self.scene_words: list[str] = []  # command line options for the scene's variant and light
        self.settings = RenderSettings.from_json(row.settings)
        self.is_guided = (
            self.settings.guiding != "off" and self.settings.integrator == "path"
        )  # whether frames wait for their path guides
        self.state = row.state
        self.priority = row.priority
        self.user, self.project = row.user, row.project or ""
        self.share = share_of(row.user)
        self.max_slots = row.max_slots
        self.needs = Needs.from_json(row.needs)
        self.deadline = row.deadline
        self.expected: float | None = None  # forecast of the completion time, if there is a deadline
        self.unforeseen: str | None = None  # why there is no forecast
        self.urgency = math.inf if row.late is None or row.deadline is None else row.deadline  # deadline of a late job
        self.foretold_s = 0.0  # slot-seconds per sample of a pixel, from the scene's previous job; 0: none
        self.kind = row.kind
        self.spp, self.noise, self.seconds = row.spp, row.noise, row.seconds
        self.shot = Shot.parse(row.shot)
        self.active_s = row.active_s
        self.started = row.started is not None
        self.served = 0  # sequence number of its latest batch among all batches
        self.frames: dict[int, ActiveFrame] = {}
        self.focus = row.focus
        self.agenda: FrameOrder  # created by `prepare_in_steps`
        self._is_begun = False
        self._goals: dict[int, int] = {}  # frames with their own number of samples
        self._totals: Totals
        self.tally = FrameProgress(self.frames)
        self.history = History()
        self._without_picture: list[ActiveFrame] = []  # frames that may lack a sample of some tile
        self.trouble: dict[Range, BatchFailures] = {}
        self.handed_back: str | None = None  # why a worker returned a batch, if none was rendered since
        self.rests_until = 0.0
        self.looks = NoiseBudget()
        self.verify = 0.0  # fraction of batches rendered twice
        self.checks: Mapping[str, int] = {}  # pending verifications by job, which delay its end
        self._unsettled: list[Range] = []  # returned batches that the plan has not processed yet
        self.samples_per_s = 0.0  # of all workers on this job, by wall time
        self.rendered, self.rendered_s = 0, 0.0  # samples since the service started, and their slot-seconds
        self._costs = Costs()  # of the CPU's slots
        self._card_costs: dict[str, Costs] = {}  # by worker, of its graphics cards' slots
        self.card_refusals: set[str] = set()  # workers whose cards cannot render the job
        self.card_rate = 0.0  # samples per second of all cards that render the job at present, set by the scheduler
        self._clock = time.monotonic()
        self._rated = (self._clock, 0)
        self._busy = (0.0, 0.0)  # slot-seconds of rendering, and the time in which the slots took them; earlier ones count less
        self._rated_slot_s = 0.0
        self._work_s: float | None = None  # slot-seconds that it still needs, by the costs of its tiles; None: unknown
        self.unwritten: set[int] = set()  # frames changed since they were stored

    def add_frames(self, rows: Sequence[FrameRow]) -> None:
        """Adds frames, in rendering order, from their database rows. Raises FilmUnavailable or FilmLost."""
        for row in rows:
            self.frames[row.number] = frame = self._frame(row)
            self._without_picture.append(frame)
            if row.spp:
                self._goals[row.number] = row.spp

    def prepare_in_steps(self) -> Iterator[None]:
        """Computes the order and the totals of the frames; yields after each step.

        A shot with very many frames needs many steps; the engine handles other jobs between them. Call no other method until
        the iterator is exhausted.
        """
        self.focus_on(self.focus)
        order, every = (self.shot.order, self.shot.every) if self.shot else (IN_TURN_ORDER, 1)
        assert self.spp is not None
        self.agenda = FrameOrder(self.frames, order, every, self.spp, self._goals)
        self.agenda.first_key = self.shot.first if self.shot else None
        self._totals = Totals(self.frames)
        yield
        self._is_begun = True
        for kind in self.compiled:
            self.agenda.turns.add_kind(kind)
        while not self.agenda.turns.update(FRAMES_PER_STEP):
            yield
        while not self._totals.count(FRAMES_PER_STEP):
            yield
        self._rated = (self._clock, self.samples)
        for _ in self.tally.begin(FRAMES_PER_STEP):
            yield

    def _frame(self, row: FrameRow) -> ActiveFrame:
        assert self.spp is not None
        more: dict[str, Any] = {"on_change": self._mark_key_changed, "is_guided": self.is_guided}
        if self.shot is None:
            frame = ActiveFrame(row, self.film, self.settings, self.compiled, self.spp, self.noise, True, **more)
            frame.state = "queued"  # the job has the state of a still's frame
            if self.film.has_file:  # a plan takes kilobytes, and thousands of jobs may wait
                frame.plan  # noqa: B018 - a film that cannot be read is found out now
            return frame
        settings = (
            partial(self._settings_of, row.number) if row.has_settings and row.state not in ("finished", "failed") else None
        )
        own = {kind: str(ref["sha256"]) for kind, ref in (row.compiled or {}).items()} if settings is not None else {}
        if row.state == "finished" and self.film.samples(row.number) < row.samples:
            row = row._replace(state="queued")  # the film lost its latest samples in a power failure
        if self.shot.order == "noisiest-first":
            most = min(MAX_SPP, max(64 * self.spp, self.spp))
            return ActiveFrame(row, self.film, settings, own, most, self.noise, True, min(self.spp, most), **more)
        return ActiveFrame(row, self.film, settings, own, row.spp or self.spp, self.noise, True, **more)

    @property
    def is_done(self) -> bool:
        """Returns True if the job has reached its goal and has no open verifications. Failed frames are ignored."""
        if self.checks.get(self.id):
            return False
        if self.shot is None:
            (frame,) = self.frames.values()
            if frame.is_complete:
                return True
        elif self._totals.updated().over == len(self.frames):
            return True
        return self.seconds is not None and self.active_s >= self.seconds and self.has_first_wave

    @property
    def has_first_wave(self) -> bool:
        """Returns True if every tile of every frame has at least one sample. Failed frames are ignored."""
        while (left := self._without_picture) and (left[-1].has_first_wave or left[-1].state == "failed"):
            left.pop()
        return not left

    @property
    def samples(self) -> int:
        """Number of rendered samples, summed over all frames and pixels."""
        return self._totals.updated().samples

    @property
    def target_samples(self) -> int:
        """Expected final number of samples, summed over all frames and pixels."""
        return self._totals.updated().target

    @property
    def bad_samples(self) -> int:
        """Number of samples discarded because they were NaN or infinite."""
        return self._totals.updated().bad_samples

    @property
    def progress(self) -> float:
        """Progress of the job, 0 to 1.

        This is the rendered fraction of its samples, or the elapsed fraction of its time limit if that is larger.
        """
        by_samples = self.samples / max(self.target_samples, 1)
        by_time = self.active_s / self.seconds if self.seconds else 0.0
        return 1.0 if self.is_done else min(max(by_samples, by_time), 0.9999)

    @property
    def current_noise(self) -> float | None:
        """Maximum noise over the frames; None while the noise of any frame is unknown."""
        return self._totals.updated().noise.value

    @property
    def expected_noise(self) -> float | None:
        """Maximum over the frames of the expected final noise; None if unknown."""
        return self.agenda.forecast if self.agenda.forecast is not None else self._totals.updated().ends.value

    @property
    def eta_s(self) -> float | None:
        """Expected remaining time in seconds; None if unknown."""
        by_time = max(0.0, self.seconds - self.active_s) if self.seconds is not None else None
        if self.samples_per_s <= 0.0:
            return by_time
        slot_s, wall_s = self._busy
        if self._work_s is not None and slot_s > 0.0:  # the tiles that are left may cost many times as much as the others
            left = self._work_s * wall_s / slot_s
        else:
            left = max(self.target_samples - self.samples, 0) / self.samples_per_s
        return left if by_time is None else min(by_time, left)

    def queue_name(self, kind: str) -> str:
        """Returns the name of the queue through which workers of this kind get the job's batches."""
        return render_queue(kind) if self.needs is None else self.needs.queue(kind)

    @property
    def is_late(self) -> bool:
        """Returns True if the job has missed its deadline or is expected to."""
        return self.urgency < math.inf

    @property
    def sample_s(self) -> float:
        """Expected slot-seconds per pixel sample; 0 if unknown."""
        return self._costs.average or self.foretold_s

    @property
    def slots_wanted(self) -> int:
        """Number of slots that the remaining work would occupy for at least half a minute each; 1 if the cost is unknown."""
        if self.is_done or self.state == "paused":
            return 0
        left_s = max(self.target_samples - self.samples, 0) * self._costs.average
        return max(1, math.ceil(left_s / WORK_PER_SLOT_S))

    def mark_changed(self, frame: ActiveFrame) -> None:
        """Marks a frame as changed, so that its numbers are computed again."""
        self._mark_key_changed(frame.key)

    def _mark_key_changed(self, key: int) -> None:
        """Marks a frame as changed. Has no effect before `prepare_in_steps` has counted the frames."""
        if not self._is_begun:
            return
        self._totals.mark_changed(key)
        self.agenda.turns.mark_changed(key)
        self.tally.mark_changed(key)
        self.unwritten.add(key)

    def target_s(self, batch_seconds: float, slots: int) -> float:
        """Returns the target duration, in seconds, of the work that is dispatched to a slot at once.

        It is at most `batch_seconds`. Near the end of the job it is at most a third of the remaining work per slot, so that all
        slots end at about the same time. slots: number of slots that render the job.
        """
        return min(batch_seconds, max(SMALLEST_BATCH_S, self._left_s(slots) / 3))

    def _left_s(self, slots: int) -> float:
        """Returns the expected wall time of the job's remaining work, in seconds; 0 if unknown.

        slots: number of CPU slots that render the job. The job's graphics cards are included.
        """
        cost = self._costs.average
        rate = (max(slots, 0 if self.card_rate else 1) / cost if cost else 0.0) + self.card_rate
        return max(self.target_samples - self.samples, 0) / rate if rate else 0.0

    def card_sample_s(self, worker: str) -> float:
        """Returns the expected slot-seconds per pixel sample on a graphics card of this worker; 0 if unknown."""
        return self._card_costs[worker].average if worker in self._card_costs else 0.0

    def card_target_s(self, batch_seconds: float, slots: int, outstanding_s: float) -> float:
        """Returns the target duration, in seconds, of a message for a graphics card; at most `batch_seconds`.

        slots: number of CPU slots that render the job too. outstanding_s: seconds of work that each card already has.
        """
        return min(batch_seconds, max(SMALLEST_CARD_MESSAGE_S, (self._left_s(slots) - outstanding_s) / 3))

    def next_for_card(self, worker: str, seconds: float, kind: str) -> Range | None:
        """Returns the next batch for a graphics card of this worker; None if there is none.

        The batch has samples of one tile and takes about `seconds`. kind: worker kind.
        """

        def samples_wanted(tile: int) -> int:
            rect = self.film.tiles[tile]
            a_sample = self._card_costs[worker].expected_cost(tile) * rect.w * rect.h if worker in self._card_costs else 0.0
            return int(seconds / a_sample) if a_sample > 0.0 else 1

        return self._next(kind, samples_wanted, 1)

    def next_batch(
        self, batch_seconds: float, slots: int, kind: str, max_run: int = 1, whole_seconds: float = 0.0
    ) -> Range | None:
        """Returns the next batch for a CPU slot; None if there is none.

        It takes about `batch_seconds`, or less near the end of the job. slots: number of slots of this worker kind.
        max_run: number of successive calls that may return consecutive batches of the same tile. whole_seconds: in a shot, a
        tile all of whose samples take no longer is one batch.
        """

        def samples_in(seconds: float, tile: int) -> int:
            rect = self.film.tiles[tile]
            a_sample = self._costs.expected_cost(tile) * rect.w * rect.h
            return int(seconds / a_sample) if a_sample > 0.0 else 1

        wanted = partial(samples_in, self.target_s(batch_seconds, slots))
        return self._next(kind, wanted, max_run, partial(samples_in, self.target_s(whole_seconds, slots)))

    def _next(
        self, kind: str, samples_wanted: Callable[[int], int], max_run: int, at_once: Callable[[int], int] | None = None
    ) -> Range | None:
        while (frame := self.agenda.next_frame(kind)) is not None:
            batch = frame.next_batch(samples_wanted, max_run, (at_once or samples_wanted) if self.shot is not None else None)
            if batch is not None:
                return batch
            if not self.agenda.raise_ceiling(frame):
                frame.is_idle = True
                self._mark_key_changed(frame.key)
                self._updating_frame(frame)  # its film may be complete already, in which case no batch will return
        return None

    def requeue(self, batch: Range) -> None:
        """Puts a lost batch back into the plan, which dispatches it first."""
        if (frame := self.frames.get(batch.frame)) is not None:
            frame.requeue(batch)

    def needs_batch(self, batch: Range) -> bool:
        """Returns True if the job still needs the samples of this batch."""
        frame = self.frames.get(batch.frame)
        return frame is not None and (self.shot is None or not frame.is_over) and frame.plan.needs_batch(batch)

    @property
    def knows_cost(self) -> bool:
        """Returns True if a batch has returned, so that the cost of a sample is known."""
        return self._costs.average > 0.0

    def expected_s(self, batch: Range, card: str = "") -> float:
        """Returns the expected rendering time of a batch on one slot, in seconds; 0 if unknown.

        card: name of the worker whose graphics card renders the batch; "" if a CPU does.
        """
        rect = self.film.tiles[batch.tile]
        costs = self._card_costs.get(card) if card else self._costs
        return costs.expected_cost(batch.tile) * rect.w * rect.h * batch.count if costs is not None else 0.0

    def record_result(self, batch: Range, seconds: float, card: str = "") -> None:
        """Records a batch that the film accepted or dropped as a duplicate. Call `update_from_film` to update the plan.

        seconds: rendering time of the batch. card: name of the worker whose graphics card rendered it; "" if a CPU did.
        """
        self.handed_back = None
        self._learn_cost(batch, seconds, card)
        last = self._unsettled[-1] if self._unsettled else None
        if last is not None and (last.frame, last.tile, last.first + last.count) == (batch.frame, batch.tile, batch.first):
            self._unsettled[-1] = last._replace(count=last.count + batch.count)  # one update of the plan for consecutive batches
        else:
            self._unsettled.append(batch)

    def update_from_film(self) -> None:
        """Updates the plans from the film after batches have returned. Raises FilmUnavailable or FilmLost; then call it again."""
        while self._unsettled:
            batch = self._unsettled[0]
            frame = self.frames.get(batch.frame)
            if frame is not None:
                frame.update_from_film(batch)
                frame.estimate_noise(self.looks)
                self._updating_frame(frame)
            self._unsettled.pop(0)

    def _updating_frame(self, frame: ActiveFrame) -> None:
        if self.shot is not None:
            self.agenda.finish_if_complete(frame)
        self._mark_key_changed(frame.key)

    def fail_frame(self, frame: ActiveFrame, error: str) -> None:
        """Marks a frame as failed; the other frames continue. Raises FilmUnavailable or FilmLost."""
        frame.mark_failed(error)
        self._updating_frame(frame)

    def mark_prepared(self, frame: ActiveFrame, kind: str, settings: RenderSettings, own: dict[str, object] | None) -> None:
        """Marks a frame as prepared for a worker kind.

        own: BlobRef, as JSON, of the scene compiled for this frame only; None if the frame uses the job's compiled scene.
        """
        frame.settings = settings
        frame.compiled[kind] = self.compiled[kind] if own is None else str(own["sha256"])
        if own is not None and not frame.is_over:
            frame.own[kind] = own
        self.mark_changed(frame)

    def release_compiled(self, all_frames: bool = False) -> Counter[str]:
        """Removes the compiled scenes that frames no longer need. Returns the number of removed references, by blob hash.

        all_frames: whether to remove the compiled scenes of all frames.
        """
        gone: Counter[str] = Counter()
        for frame in self.agenda.turns.frames_with_own_scene():
            for kind in [kind for kind in frame.own if all_frames or frame.is_over or kind not in frame.compiled]:
                gone.update(blobs_of([frame.own.pop(kind)]))
                frame.compiled.pop(kind, None)
                self._mark_key_changed(frame.key)
        return gone

    def add_compiled_kind(self, kind: str, sha256: str) -> None:
        """Records that the scene was compiled for a worker kind, as the blob with this hash."""
        self.compiled[kind] = sha256
        if self.shot is None:  # a still is rendered from it directly
            self.agenda.turns.mark_changed(*self.frames)

    def finish_frames(self) -> None:
        """Marks all frames of a finished shot as finished, except failed ones."""
        for frame in self.frames.values():
            if self.shot is not None and not frame.is_over:
                frame.finish()

    def differs_from_goal(self, spp: int, noise: float | None, seconds: float | None) -> bool:
        """Returns True if this goal differs from the job's current one.

        spp: samples per pixel. noise: target noise. seconds: time limit.
        """
        return (spp, noise, seconds) != (self.spp, self.noise, self.seconds)

    def set_goal(self, spp: int, noise: float | None, seconds: float | None) -> None:
        """Sets a new goal for a still image: samples per pixel, target noise, and time limit in seconds.

        Outstanding batches are planned again. Raises FilmUnavailable or FilmLost.
        """
        self.spp, self.noise, self.seconds = spp, noise, seconds
        self._unsettled.clear()
        for frame in self.frames.values():
            frame.set_goal(spp, noise)
            frame.plan  # noqa: B018

    def focus_on(self, focus: Sequence[int] | None) -> None:
        """Sets the rectangle (x, y, w, h), in pixels, whose tiles are rendered first in every frame; None removes it."""
        self.focus = None if focus is None else list(focus)
        for frame in self.frames.values():
            frame.focus_on(None if focus is None else Tile(*focus))

    def advance_clock(self, rendering: bool) -> None:
        """Updates the job's speed about once a second.

        rendering: whether to add the elapsed wall time to the job's rendering time.
        """
        now = time.monotonic()
        if rendering:
            self.active_s += now - self._clock
        self._clock = now
        since, samples = self._rated
        if now - since >= 1.0:
            rate = (self.samples - samples) / (now - since)
            self.samples_per_s += (rate - self.samples_per_s) * (SMOOTHING if self.samples_per_s else 1.0)
            self._rated = (now, self.samples)
            if self.state == "running":
                self._rate_slots(now - since)

    def _rate_slots(self, elapsed: float) -> None:
        """Updates how many slot-seconds of rendering the job gets per second, and how many it still needs.

        elapsed: seconds since the previous call.
        """
        done = self.rendered_s - self._rated_slot_s
        if self._rated_slot_s > 0.0:  # before the first batch has come back, workers load the scene
            slot_s, wall_s = self._busy
            fade = math.exp(-elapsed / min(max(self.active_s / 4, LEAST_BUSY_S), MOST_BUSY_S))
            self._busy = slot_s * fade + done, wall_s * fade + elapsed
        self._rated_slot_s = self.rendered_s
        if not self._costs.average or self.card_rate:
            self._work_s = None
        elif self.shot is None:
            (frame,) = self.frames.values()
            self._work_s = sum(samples * self._costs.future_cost(tile) for tile, samples in frame.remaining())
        else:
            self._work_s = max(self.target_samples - self.samples, 0) * self._costs.average

    def _learn_cost(self, batch: Range, seconds: float, card: str) -> None:
        rect = self.film.tiles[batch.tile]
        samples = rect.w * rect.h * batch.count
        if card:
            self._card_costs.setdefault(card, Costs()).record(batch.tile, seconds, samples)
        elif self._costs.record(batch.tile, seconds, samples):
            self.rendered += samples
            self.rendered_s += seconds
