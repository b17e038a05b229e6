"""Immutable snapshots of the engine's state. The engine's thread replaces the latest one, which all threads can read."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from renderer.sentences import Sentence
from service.events import Events, ItemChanged, ItemKind
from service.scheduling.artifacts.scene_preparation import Progress
from service.scheduling.fleet.workers import WorkerSnapshot
from service.scheduling.jobs.active_frame import FrameNumbers
from service.scheduling.jobs.active_job import ActiveJob

__all__ = ["JobNumbers", "Snapshot", "SnapshotHolder"]

STUCK_TIMEOUT_S = 4.0
NUMBERS_EVERY_S = 0.1


@dataclass(frozen=True)
class JobNumbers:
    """Progress numbers of an active job and its frames."""

    state: str
    samples: int
    bad_samples: int
    progress: float
    active_s: float
    eta_s: float | None
    samples_per_s: float
    frames: Mapping[int, FrameNumbers] = field(default_factory=dict)
    states: Mapping[str, int] = field(default_factory=dict)  # number of frames in each state
    failed: tuple[int, ...] = ()  # keys of failed frames
    revision: int = 0  # of the rendered shot
    noise: float | None = None  # maximum over the frames
    forecast: float | None = None  # expected final noise
    handed_back: str | None = None  # why a worker returned a batch, if none was rendered since
    slots_wanted: int = 0  # slots that the remaining work can occupy efficiently
    expected: float | None = None  # expected completion as Unix time, if there is a deadline
    unforeseen: str | None = None  # why there is no expected completion

    @classmethod
    def from_job(cls, job: ActiveJob) -> JobNumbers:
        """Returns the current numbers of a job."""
        return cls(
            job.state,
            job.samples,
            job.bad_samples,
            job.progress,
            job.active_s,
            job.eta_s,
            job.samples_per_s,
            job.tally.numbers(),
            *job.tally.states(),
            job.shot.revision if job.shot else 0,
            job.current_noise,
            job.expected_noise if job.shot else None,
            job.handed_back,
            job.slots_wanted,
            job.expected,
            job.unforeseen,
        )


@dataclass(frozen=True)
class Snapshot:
    """State of the engine at one moment: jobs, workers, and the reasons why jobs wait."""

    fault: str | None = Sentence("service-starting", "The service is starting.")  # why the whole engine is stopped
    roster: WorkerSnapshot = field(default_factory=WorkerSnapshot)
    jobs: Mapping[str, JobNumbers] = field(default_factory=dict)
    ahead: Mapping[str, int] = field(default_factory=dict)  # by job: number of higher-priority jobs served first
    waits: Mapping[str, str] = field(default_factory=dict)  # by job or scene: why it waits
    preparing: Mapping[str, Progress] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)  # batches merged, dropped, failed, lost
    batches_out: int = 0
    has_requests: bool = False  # whether clients wait for artifacts, such as denoised pictures
    results_unread: int = 0
    batch_cost_s: float = 0.0  # engine's processor time per batch
    failures: Mapping[str, int] = field(default_factory=dict)  # failed batches by worker, since the service started
    made: float = field(default_factory=time.monotonic)

    @property
    def unready_reason(self) -> str | None:
        """A sentence that explains why the farm cannot work at present; None if it can."""
        age = time.monotonic() - self.made
        if age > STUCK_TIMEOUT_S:
            return Sentence(
                "engine-slow",
                "The scheduler has been busy with one step for {age} s: a disk, the database or Redis is slow.",
                age=f"{age:.0f}",
            )
        if self.fault is not None:
            return self.fault
        paused = {id for id, job in self.jobs.items() if job.state == "paused"}
        waits = [why for id, why in self.waits.items() if id not in paused]
        if waits and self.jobs.keys() - paused <= self.waits.keys():
            return Sentence("engine-stalled", "The scheduler is stalled. {reason}", reason=waits[0])
        return None


class SnapshotHolder:
    """Holds the engine's latest snapshot. Publishes `ItemChanged` once a snapshot contains the change."""

    def __init__(self, events: Events) -> None:
        self._events = events
        self._changed: dict[tuple[ItemKind, str], None] = {}
        self._numbers: dict[str, tuple[float, JobNumbers]] = {}
        self.latest = Snapshot()

    @property
    def roster(self) -> WorkerSnapshot:
        """The workers in the latest snapshot."""
        return self.latest.roster

    def record_change(self, item_kind: ItemKind, id: str) -> None:
        """Records that an item (job, scene, worker ...) has changed. The event is published with the next snapshot."""
        self._changed[item_kind, id] = None

    def publish(self, jobs: Mapping[str, ActiveJob], make: Callable[[Mapping[str, JobNumbers]], Snapshot]) -> None:
        """Replaces the snapshot, and publishes the recorded changes.

        jobs: active jobs by id. make: creates the snapshot from the numbers of these jobs. The numbers of a job that changes
        continuously are updated at most ten times a second.
        """
        now = time.monotonic()
        late: dict[tuple[ItemKind, str], None] = {}
        numbers = {}
        for id, job in jobs.items():
            made, known = self._numbers.get(id, (0.0, None))
            has_changed = ("job", id) in self._changed
            if known is None or (has_changed and (now - made > NUMBERS_EVERY_S or known.state != job.state)):
                numbers[id] = (now, JobNumbers.from_job(job))
            else:
                numbers[id] = (made, known)
                if has_changed:
                    late["job", id] = None
        self._numbers = numbers
        self.latest = make({id: known for id, (_, known) in numbers.items()})
        changed, self._changed = self._changed, late
        for item_kind, id in changed:
            if (item_kind, id) not in late:
                self._events.publish(ItemChanged(item_kind, id))
