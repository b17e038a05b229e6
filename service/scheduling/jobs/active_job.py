"""A job that is being rendered: its film, its frames, how fast it goes and what went wrong with its batches."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

from protocol.contract import render_queue
from renderer.settings import MAX_SPP, RenderSettings, Tile
from service.scheduling.fleet.needs import Needs
from service.scheduling.jobs.active_frame import ActiveFrame, FrameRow
from service.scheduling.jobs.agenda import Agenda
from service.scheduling.jobs.batch_failures import Trouble
from service.scheduling.jobs.costs import Costs
from service.scheduling.jobs.frame_progress import Tally
from service.scheduling.jobs.history import History
from service.scheduling.jobs.noise_budget import Looks
from service.scheduling.jobs.plan import Range
from service.scheduling.jobs.shares import share_of
from service.scheduling.jobs.totals import Totals
from service.shot import IN_TURN, Shot
from service.store.films import Film
from service.store.models import Job, blobs_of

__all__ = ["ActiveJob"]

SMALLEST_BATCH_S = 0.04
SMOOTHING = 0.3
WORTH_A_SLOT_S = 30.0  # of work, for another slot to pay
AT_A_TIME = 2000  # frames that are looked at in one step


class ActiveJob:
    """One job in the hands of the scheduler. Only the engine's thread changes it; others read its numbers."""

    def __init__(
        self,
        row: Job,
        film: Film,
        compiled: dict[str, str],
        of_scene: set[str],
        settings_of: Callable[[int], RenderSettings],
    ) -> None:
        """It has no frames yet: `take` gives it some, and `begin` has to be gone through once it has all.

        settings_of: of a frame whose row has its settings.

        compiled: kind of worker -> SHA-256 of the scene compiled for it, as it is at its beginning.

        of_scene: the hashes of all blobs that the scene refers to: they stay, whatever becomes of frames.
        """
        assert row.settings is not None and row.spp is not None
        self.id = row.id
        self.scene = row.stage
        self.created = row.created
        self.request = row.request
        self.film = film
        self._settings_of = settings_of
        self.compiled = compiled
        self.of_scene = of_scene
        self.scene_words: list[str] = []  # options that say what was asked of the scene beside its files
        self.settings = RenderSettings.from_json(row.settings)
        self.state = row.state
        self.priority = row.priority
        self.user, self.project = row.user, row.project or ""
        self.share = share_of(row.user)
        self.max_slots = row.max_slots
        self.needs = Needs.of(row.needs)
        self.deadline = row.deadline
        self.expected: float | None = None  # when it is to be ready, where it has a deadline
        self.unforeseen: str | None = None  # why nobody knows that
        self.urgency = math.inf if row.late is None or row.deadline is None else row.deadline  # which it is expected to miss
        self.foretold_s = 0.0  # of a slot, for a sample of a pixel, by the scene's latest picture; 0: there was none
        self.kind = row.kind
        self.spp, self.noise, self.seconds = row.spp, row.noise, row.seconds
        self.shot = Shot.of(row.shot)
        self.active_s = row.active_s
        self.started = row.started is not None
        self.served = 0  # when it was given a batch last, as a place in the order of all batches
        self.frames: dict[int, ActiveFrame] = {}
        self.focus = row.focus
        self.agenda: Agenda  # from `begin` on
        self._goals: dict[int, int] = {}  # of frames that are to have others than the job
        self._totals: Totals
        self.tally = Tally(self.frames)
        self.history = History()
        self._without_picture: list[ActiveFrame] = []  # those that may not have a sample of every tile yet, at its end
        self.trouble: dict[Range, Trouble] = {}
        self.handed_back: str | None = None  # why a worker gave a batch back, where none was rendered since
        self.rests_until = 0.0
        self.looks = Looks()
        self.verify = 0.0  # the share of its batches that is rendered twice
        self.checks: Mapping[str, int] = {}  # of a job: decisions about its batches that are not made yet; it does not end before
        self._unsettled: list[Range] = []  # batches that came back, and that the plan has not looked at yet
        self.samples_per_s = 0.0  # of the whole farm on this job, over the wall clock
        self.rendered, self.rendered_s = 0, 0.0  # samples in this life of the service, and seconds that slots took for them
        self._costs = Costs()
        self._clock = time.monotonic()
        self._rated = (self._clock, 0)
        self.unwritten: set[int] = set()  # frames that have changed since they were written down

    def take(self, rows: Sequence[FrameRow]) -> None:
        """Some more of its frames, in their order. Raises FilmWaits or FilmLost."""
        for row in rows:
            self.frames[row.number] = frame = self._frame(row)
            self._without_picture.append(frame)
            if row.spp:
                self._goals[row.number] = row.spp

    def begin(self) -> Iterator[None]:
        """Put its frames in order and add them up: some of a long shot in each step, between which the engine looks after others.
        Nothing else may be asked of it before."""
        self.focus_on(self.focus)
        order, every = (self.shot.order, self.shot.every) if self.shot else (IN_TURN, 1)
        assert self.spp is not None
        self.agenda = Agenda(self.frames, order, every, self.spp, self._goals)
        self.agenda.first = self.shot.first if self.shot else None
        self._totals = Totals(self.frames)
        yield
        for frame in self.frames.values():
            frame.on_change = self._note
        for kind in self.compiled:
            self.agenda.turns.expect(kind)
        while not self.agenda.turns.look(AT_A_TIME):
            yield
        while not self._totals.count(AT_A_TIME):
            yield
        self._rated = (self._clock, self.samples)
        yield from self.tally.begin(AT_A_TIME)

    def _frame(self, row: FrameRow) -> ActiveFrame:
        assert self.spp is not None
        if self.shot is None:
            frame = ActiveFrame(row, self.film, self.settings, self.compiled, self.spp, self.noise, True)
            frame.state = "queued"  # the job's state is the frame's
            if self.film.has_file:  # a plan is kilobytes, and thousands of jobs may wait
                frame.plan  # noqa: B018 - a film that cannot be read is found out now
            return frame
        settings = (
            partial(self._settings_of, row.number) if row.has_settings and row.state not in ("finished", "failed") else None
        )
        own = {kind: str(ref["sha256"]) for kind, ref in (row.compiled or {}).items()} if settings is not None else {}
        if row.state == "finished" and self.film.samples(row.number) < row.samples:
            row = row._replace(state="queued")  # a power cut has taken the latest of the film
        if self.shot.order == "noisiest-first":
            most = min(MAX_SPP, max(64 * self.spp, self.spp))
            return ActiveFrame(row, self.film, settings, own, most, self.noise, True, share=min(self.spp, most))
        return ActiveFrame(row, self.film, settings, own, row.spp or self.spp, self.noise, True)

    @property
    def done(self) -> bool:
        """Whether the job has all that was asked for; frames that failed are left out."""
        if self.checks.get(self.id):
            return False
        if self.shot is None:
            (frame,) = self.frames.values()
            if frame.has_all:
                return True
        elif self._totals.renewed().over == len(self.frames):
            return True
        return self.seconds is not None and self.active_s >= self.seconds and self.has_first_wave

    @property
    def has_first_wave(self) -> bool:
        """Whether every tile of every frame has a sample; frames that failed are left out."""
        while (left := self._without_picture) and (left[-1].has_first_wave or left[-1].state == "failed"):
            left.pop()
        return not left

    @property
    def samples(self) -> int:
        """What all frames have together."""
        return self._totals.renewed().samples

    @property
    def target_samples(self) -> int:
        """What all frames are expected to come to."""
        return self._totals.renewed().target

    @property
    def bad_samples(self) -> int:
        """How many samples were left out."""
        return self._totals.renewed().bad_samples

    @property
    def progress(self) -> float:
        """0 ... 1, by samples or by time, whichever is further."""
        by_samples = self.samples / max(self.target_samples, 1)
        by_time = self.active_s / self.seconds if self.seconds else 0.0
        return 1.0 if self.done else min(max(by_samples, by_time), 0.9999)

    @property
    def noise_now(self) -> float | None:
        """The greatest noise of its frames; None while that of one is not known."""
        return self._totals.renewed().noise.value

    @property
    def forecast(self) -> float | None:
        """The greatest noise at which its frames will end; None while that is not known."""
        return self.agenda.forecast if self.agenda.forecast is not None else self._totals.renewed().ends.value

    @property
    def eta_s(self) -> float | None:
        """Seconds that are left, or None where that is not known yet."""
        by_time = max(0.0, self.seconds - self.active_s) if self.seconds is not None else None
        if self.samples_per_s <= 0.0:
            return by_time
        by_samples = max(self.target_samples - self.samples, 0) / self.samples_per_s
        return by_samples if by_time is None else min(by_time, by_samples)

    def queue(self, kind: str) -> str:
        """Where its batches for workers of a kind wait."""
        return render_queue(kind) if self.needs is None else self.needs.queue(kind)

    @property
    def is_late(self) -> bool:
        """Whether it is expected to miss its deadline, or has missed it."""
        return self.urgency < math.inf

    @property
    def sample_s(self) -> float:
        """What a slot takes for a sample of a pixel; 0 where nobody knows."""
        return self._costs.average or self.foretold_s

    @property
    def slots_wanted(self) -> int:
        """How many slots would each have at least half a minute of work with it; one where it is not known how long it takes."""
        if self.done or self.state == "paused":
            return 0
        left_s = max(self.target_samples - self.samples, 0) * self._costs.average
        return max(1, math.ceil(left_s / WORTH_A_SLOT_S))

    def touch(self, frame: ActiveFrame) -> None:
        """A frame has changed."""
        self._note(frame.key)

    def _note(self, key: int) -> None:
        self._totals.note(key)
        self.agenda.turns.note(key)
        self.tally.note(key)
        self.unwritten.add(key)

    def aim_s(self, batch_seconds: float, slots: int) -> float:
        """How long what is handed out at a time is to take.

        Near the end that is at most a third of what is left for each slot, so that all slots end at about the same time.
        """
        left_s = max(self.target_samples - self.samples, 0) * self._costs.average / max(slots, 1)
        return min(batch_seconds, max(SMALLEST_BATCH_S, left_s / 3))

    def next(self, batch_seconds: float, slots: int, kind: str, of_a_tile: int = 1) -> Range | None:
        """The next batch for one of `slots` slots of workers of a kind, to take about `batch_seconds`; less near the end.

        of_a_tile: how many of one tile may follow each other."""
        aim = self.aim_s(batch_seconds, slots)

        def samples_wanted(tile: int) -> int:
            rect = self.film.tiles[tile]
            a_sample = self._costs.of(tile) * rect.w * rect.h
            return int(aim / a_sample) if a_sample > 0.0 else 1

        while (frame := self.agenda.next(kind)) is not None:
            batch = frame.next(samples_wanted, of_a_tile)
            if batch is not None:
                return batch
            if not self.agenda.passed(frame):
                frame.is_idle = True
                self._note(frame.key)
                self._unsettled_frame(frame)  # its film may have had all from the beginning: nothing will come back then
        return None

    def lose(self, batch: Range) -> None:
        """A batch did not come back: it is among the first to be handed out again."""
        if (frame := self.frames.get(batch.frame)) is not None:
            frame.lose(batch)

    def wants(self, batch: Range) -> bool:
        """Whether these samples belong to the job."""
        frame = self.frames.get(batch.frame)
        return frame is not None and (self.shot is None or not frame.is_over) and frame.plan.wants(batch)

    @property
    def knows_cost(self) -> bool:
        """Whether a batch has come back, and so told how long others take."""
        return self._costs.average > 0.0

    def expected_s(self, batch: Range) -> float:
        """How long a batch is expected to take on one slot; 0 where nothing is known."""
        rect = self.film.tiles[batch.tile]
        return self._costs.of(batch.tile) * rect.w * rect.h * batch.count

    def came_back(self, batch: Range, seconds: float) -> None:
        """The film has a batch, or dropped it; `settle` tells the plan."""
        self.handed_back = None
        self._learn(batch, seconds)
        last = self._unsettled[-1] if self._unsettled else None
        if last is not None and (last.frame, last.tile, last.first + last.count) == (batch.frame, batch.tile, batch.first):
            self._unsettled[-1] = last._replace(count=last.count + batch.count)  # the plan looks once at what came together
        else:
            self._unsettled.append(batch)

    def settle(self) -> None:
        """Let the plans look at the film for what came back. Raises FilmWaits or FilmLost; then it is to be called again."""
        while self._unsettled:
            batch = self._unsettled[0]
            frame = self.frames.get(batch.frame)
            if frame is not None:
                frame.settle(batch)
                frame.look(self.looks)
                self._unsettled_frame(frame)
            self._unsettled.pop(0)

    def _unsettled_frame(self, frame: ActiveFrame) -> None:
        if self.shot is not None:
            self.agenda.settled(frame)
        self._note(frame.key)

    def fail(self, frame: ActiveFrame, error: str) -> None:
        """A frame cannot be rendered; the others go on. Raises FilmWaits or FilmLost."""
        frame.fail(error)
        self._unsettled_frame(frame)

    def prepared(self, frame: ActiveFrame, kind: str, settings: RenderSettings, own: dict[str, object] | None) -> None:
        """A frame can be rendered by workers of a kind. own: the BlobRef of what was compiled for it alone."""
        frame.settings = settings
        frame.compiled[kind] = self.compiled[kind] if own is None else str(own["sha256"])
        if own is not None and not frame.is_over:
            frame.own[kind] = own
        self.touch(frame)

    def release(self, all_frames: bool = False) -> Counter[str]:
        """Let go of what was compiled for frames that need it no more; the hashes of those blobs, and how many had each."""
        gone: Counter[str] = Counter()
        for frame in self.agenda.turns.owning():
            for kind in [kind for kind in frame.own if all_frames or frame.is_over or kind not in frame.compiled]:
                gone.update(blobs_of([frame.own.pop(kind)]))
                frame.compiled.pop(kind, None)
                self._note(frame.key)
        return gone

    def compiled_for(self, kind: str, sha256: str) -> None:
        """Its scene is prepared for a kind of workers."""
        self.compiled[kind] = sha256
        if self.shot is None:  # whose frame is rendered from just that
            self.agenda.turns.note(*self.frames)

    def finish_frames(self) -> None:
        """The job is over: so are its frames, but for those that failed."""
        for frame in self.frames.values():
            if self.shot is not None and not frame.is_over:
                frame.finish()

    def asks_for(self, spp: int, noise: float | None, seconds: float | None) -> bool:
        """Whether this is other than what the job is rendered for now."""
        return (spp, noise, seconds) != (self.spp, self.noise, self.seconds)

    def ask(self, spp: int, noise: float | None, seconds: float | None) -> None:
        """Take over what is asked for now of a still. What is out counts as lost. Raises FilmWaits or FilmLost."""
        self.spp, self.noise, self.seconds = spp, noise, seconds
        self._unsettled.clear()
        for frame in self.frames.values():
            frame.ask(spp, noise)
            frame.plan  # noqa: B018

    def focus_on(self, focus: Sequence[int] | None) -> None:
        """Let a rectangle (x, y, w, h) of every frame be rendered first; None: no more."""
        self.focus = None if focus is None else list(focus)
        for frame in self.frames.values():
            frame.focus_on(None if focus is None else Tile(*focus))

    def tick(self, rendering: bool) -> None:
        """Let the wall clock run, where the job is being rendered, and renew its speed about once a second."""
        now = time.monotonic()
        if rendering:
            self.active_s += now - self._clock
        self._clock = now
        since, samples = self._rated
        if now - since >= 1.0:
            rate = (self.samples - samples) / (now - since)
            self.samples_per_s += (rate - self.samples_per_s) * (SMOOTHING if self.samples_per_s else 1.0)
            self._rated = (now, self.samples)

    def _learn(self, batch: Range, seconds: float) -> None:
        rect = self.film.tiles[batch.tile]
        samples = rect.w * rect.h * batch.count
        if self._costs.learn(batch.tile, seconds / samples):
            self.rendered += samples
            self.rendered_s += seconds
