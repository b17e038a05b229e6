"""Changes of many frames of a shot, applied in several transactions.

One transaction over a hundred thousand rows would lock the database for seconds. So a long change is recorded as a whole in the
transaction that accepts it, and then applied to AT_A_TIME frames at a time. After a restart, the service continues unfinished
changes. The job is not rendered while its change is pending.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from sqlalchemy import BigInteger, Float, case, cast, delete, func, insert, literal, null, select, update
from sqlalchemy.orm import Session

from renderer.frames import frame_key, frame_number, frames_text, parse_frames
from service.errors import FarmError
from service.events import Events, RowWritten
from service.store.database import Sessions
from service.store.models import Frame, FrameChange, Job, Spent

__all__ = ["FrameChanges", "Step", "apply_short_steps", "fits_one_transaction", "record_steps"]

AT_A_TIME = 2000  # frames per transaction
MAX_PAUSE_S = 0.1
RETRY_AFTER_S = 5.0  # delay in seconds after an error of the database or the disk
NO_SYNCHRONIZE = {"synchronize_session": False}
NEARLY_COMPLETE = 0.9999

FrameValues = Mapping[int, Mapping[str, Any]]  # by frame key: columns with values that differ from those of the other frames

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Step:
    """One operation (`do`) on some frames of a job.

    add: inserts the frames, each with `target` samples over all pixels.
    unplan: clears the samples per pixel that were set for each frame.
    again: discards the frames' samples; with `unplan`, also does what unplan does.
    aim: applies the job's samples per pixel. Those set for a frame are cleared, unless they are higher or `keep` is set.
    more: sets each frame to `spp` samples per pixel, or to `more` above its present number.
    heal: queues failed frames again.
    drop: marks the job as being deleted with all its frames.

    frames: the frame numbers, in the notation of `renderer.frames.frames_text`.
    """

    do: Literal["add", "unplan", "again", "aim", "more", "heal", "drop"]
    frames: str = ""
    target: int = 0
    unplan: bool = False
    keep: bool = False
    spp: int | None = None
    more: int | None = None

    @classmethod
    def for_keys(cls, action: Any, keys: Sequence[int], **fields: Any) -> Step:
        """Creates a step that applies `action` (an operation listed at Step) to the frames with these keys.

        fields: other fields of the step.
        """
        return cls(action, frames_text([frame_number(key) for key in keys]), **fields)

    @property
    def keys(self) -> list[int]:
        """The keys of the frames to which the step applies."""
        return [frame_key(number) for number in parse_frames(self.frames)] if self.frames else []


def fits_one_transaction(steps: Sequence[Step]) -> bool:
    """Returns True if the steps are small enough for one transaction."""
    return sum(len(step.keys) for step in steps) <= AT_A_TIME and all(step.do != "drop" for step in steps)


def record_steps(job: str, steps: Sequence[Step], session: Session) -> None:
    """Records steps that will be applied to a job's frames. They replace a pending change of the job."""
    session.execute(delete(FrameChange).where(FrameChange.job == job))
    samples = sum(len(step.keys) * step.target for step in steps if step.do == "add")
    session.add(FrameChange(job=job, steps=[asdict(step) for step in steps], done=0, samples=samples))


def apply_short_steps(job: Job, steps: Sequence[Step], session: Session, frame_values: FrameValues | None = None) -> None:
    """Applies steps that fit into one transaction, inside the transaction of the caller.

    frame_values: column values, by frame key, of added frames whose values differ from the defaults.
    """
    for step in steps:
        _apply(job, step, step.keys, session, frame_values or {})


class FrameChanges:
    """Applies changes of many frames that were recorded by `record_steps`, in portions. Thread-safe.

    A background thread continues unfinished changes.
    """

    def __init__(self, sessions: Sessions, events: Events, on_deleted: Callable[[str], None]) -> None:
        """Stores the parameters.

        on_deleted: called with the id of a job that is being deleted, after its frames were deleted.
        """
        self._sessions = sessions
        self._events = events
        self._on_deleted = on_deleted
        self._later: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="frame changes", daemon=True)

    def start(self) -> None:
        """Starts the background thread, which first continues changes left by an earlier process."""
        self._thread.start()

    def stop(self) -> None:
        """Stops the background thread after its current transaction. Waits up to 10 seconds."""
        self._stop.set()
        self._later.put(None)
        if self._thread.is_alive():
            self._thread.join(10)

    def is_under_way(self, job: str) -> bool:
        """Returns True if a job has a pending change of its frames."""
        return self._pending_change(job) is not None

    def is_dropped(self, job: str) -> bool:
        """Returns True if a job is being deleted."""
        change = self._pending_change(job)
        return change is not None and _is_drop(change)

    def carry_out(self, job: str, frame_values: FrameValues | None = None) -> None:
        """Applies the pending changes of a job. If this raises FarmError, the background thread continues later.

        frame_values: column values, by frame key, of added frames whose values differ from the defaults.
        """
        try:
            self._carry_out(job, frame_values or {})
        except FarmError:
            self._later.put(job)
            raise

    def drop_frames(self, job: str) -> None:
        """Deletes the frames of a job that is being deleted, except frames that refer to blobs.

        If this raises FarmError, the background thread retries later.
        """
        try:
            self._drop_in_portions(job)
        except FarmError:
            self._later.put(job)
            raise

    def _carry_out(self, job: str, frame_values: FrameValues) -> None:
        while (change := self._pending_change(job)) is not None and not _is_drop(change):
            plan = [(step, keys) for step in map(_parse_step, change.steps) for keys in _key_portions(step.keys)]
            while self._apply_next(change, plan, frame_values):
                pass

    def _drop_in_portions(self, job: str) -> None:
        while True:
            began = time.monotonic()
            with self._sessions.begin() as session:
                some = select(Frame.number).where(Frame.job == job, Frame.compiled.is_(None)).limit(AT_A_TIME)
                keys = list(session.scalars(some))
                session.execute(delete(Frame).where(Frame.job == job, Frame.number.in_(keys)), execution_options=NO_SYNCHRONIZE)
            if len(keys) < AT_A_TIME:
                return
            self._pause(began)

    def _pending_change(self, job: str) -> FrameChange | None:
        with self._sessions() as session:
            return session.get(FrameChange, job)

    def _apply_next(self, pending: FrameChange, plan: list[tuple[Step, list[int]]], frame_values: FrameValues) -> bool:
        """Applies the next portion of a change. Returns whether another portion is left.

        plan: (step, frame keys) of each portion. frame_values: as for `carry_out`.
        """
        began = time.monotonic()
        with self._sessions.begin() as session:
            change = session.get(FrameChange, pending.job, with_for_update=True)
            job = session.get(Job, pending.job)
            if change is None or job is None or change.steps != pending.steps:
                return False
            before = 0
            for step, keys in plan:
                before += len(keys)
                if change.done < before:
                    _apply(job, step, keys, session, frame_values)
                    change.done = before
                    change.samples -= step.target * len(keys) if step.do == "add" else 0
                    break
            is_left = change.done < sum(len(keys) for _, keys in plan)
            if not is_left:
                session.delete(change)
        if is_left:
            self._pause(began)
        return is_left

    def _pause(self, began: float) -> None:
        """Waits as long as the last transaction took, at most MAX_PAUSE_S seconds. Meanwhile other writers get SQLite's lock.

        began: monotonic time at which the transaction began.
        """
        self._stop.wait(min(time.monotonic() - began, MAX_PAUSE_S))

    def _run(self) -> None:
        try:
            self._queue_pending()
        except FarmError as error:
            log.warning("pending changes of frames are read later: %s", error)
            self._later.put("")
        while not self._stop.is_set():
            job = self._later.get()
            if job is None:
                return
            try:
                self._resume(job)
            except FarmError as error:
                log.warning("not all frames of job %s are stored yet: %s", job, error)
                self._stop.wait(RETRY_AFTER_S)
                self._later.put(job)
            except Exception:
                log.exception("the frames of job %s cannot be changed", job)

    def _resume(self, job: str) -> None:
        if not job:
            self._queue_pending()
            return
        change = self._pending_change(job)
        if change is not None and _is_drop(change):
            self._drop_in_portions(job)
            self._on_deleted(job)
            return
        self._carry_out(job, {})
        self._events.publish(RowWritten("job", job))

    def _queue_pending(self) -> None:
        with self._sessions() as session:
            for job in session.scalars(select(FrameChange.job)):
                self._later.put(job)


def _is_drop(change: FrameChange) -> bool:
    return any(_parse_step(data).do == "drop" for data in change.steps)


def _key_portions(keys: list[int]) -> Iterator[list[int]]:
    for at in range(0, len(keys), AT_A_TIME):
        yield keys[at : at + AT_A_TIME]


def _parse_step(data: Mapping[str, Any]) -> Step:
    return Step(**{name: data[name] for name in Step.__dataclass_fields__ if name in data})


def _apply(job: Job, step: Step, keys: list[int], session: Session, frame_values: FrameValues) -> None:
    if not keys:
        return
    if step.do == "add":
        rows = [
            {"job": job.id, "number": key, "samples": 0, "target": step.target, "bad_samples": 0, "progress": 0.0}
            | {"state": "queued", "noise": None, "settings": None, **frame_values.get(key, {})}
            for key in keys
        ]
        session.execute(insert(Frame), rows)
        return
    frames = update(Frame).where(Frame.job == job.id, Frame.number.in_(keys))
    opened = {"state": "queued", "error": None}
    match step.do:
        case "unplan":
            frames = frames.values(spp=None)
        case "again":
            _record_spent(job, keys, session)
            nothing: dict[str, Any] = dict.fromkeys(("samples", "target", "bad_samples"), 0)
            nothing |= {"progress": 0.0, "noise": None, "settings": null(), "compiled": null(), **opened}
            frames = frames.values(nothing | ({"spp": None} if step.unplan else {}))
        case "aim":
            if not step.keep:
                lower = update(Frame).where(Frame.job == job.id, Frame.number.in_(keys), Frame.spp <= (job.spp or 0))
                session.execute(lower.values(spp=None), execution_options=NO_SYNCHRONIZE)
            frames = frames.where(Frame.state != "failed").values(_changed_goals(job) | opened)
        case "more":
            wanted = literal(step.spp) if step.spp is not None else func.coalesce(Frame.spp, job.spp or 0) + (step.more or 0)
            session.execute(frames.values(spp=wanted), execution_options=NO_SYNCHRONIZE)
            frames = frames.where(Frame.state != "failed").values(_changed_goals(job) | opened)
        case "heal":
            frames = frames.where(Frame.state == "failed").values(opened)
    session.execute(frames, execution_options=NO_SYNCHRONIZE)


def _record_spent(job: Job, keys: list[int], session: Session) -> None:
    """Records the samples of frames that are rendered again, so that they still count towards their owner's quota."""
    rendered = select(func.sum(Frame.samples)).where(Frame.job == job.id, Frame.number.in_(keys))
    if job.user is None or not (samples := int(session.scalar(rendered) or 0)):
        return
    row = session.get(Spent, f"{job.id}/again")
    if row is None:
        session.add(Spent(job=f"{job.id}/again", user=job.user, key=job.key, created=job.created, samples=samples))
    else:
        row.samples += samples


def _changed_goals(job: Job) -> dict[str, Any]:
    """Returns SQL expressions for the new `target` and `progress` of frames after a change of the job's spp."""
    size = job.settings or {}
    pixels = literal(int(size.get("width", 0)) * int(size.get("height", 0)), BigInteger)
    wanted = cast(func.coalesce(Frame.spp, job.spp or 0), BigInteger) * pixels
    target = case((wanted > Frame.samples, wanted), else_=Frame.samples)
    share = cast(Frame.samples, Float) / cast(target, Float)
    progress = case((target <= 0, 0.0), (share > NEARLY_COMPLETE, NEARLY_COMPLETE), else_=share)
    return {"target": target, "progress": progress}
