"""Totals over the frames of shots, computed by the engine for running shots and by the database for others.

Every list of jobs needs them, and a shot may have very many frames, so frames are not loaded one by one.
"""

from __future__ import annotations

import json
import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from renderer.frames import frame_number, frames_text
from service.scheduling.jobs.active_frame import FrameNumbers
from service.scheduling.snapshot import JobNumbers
from service.shot import Shot
from service.store.models import ACTIVE_STATES, Frame, FrameChange, Job

__all__ = ["ShotSums", "live_numbers", "sums_of"]

MAX_IDS_PER_QUERY = 500  # jobs in one query
MAX_CACHED = 20_000  # ended jobs in the cache
MIN_CACHED_FRAMES = 500  # number of frames above which sums are cached


@dataclass(frozen=True)
class ShotSums:
    """Totals over all frames of a shot.

    frames: the frame range as text. first: key and numbers of the first frame. failed: sorted keys of the failed frames.
    progress: sum over the frames. noise: maximum over the frames; None while it is unknown for a frame that has not failed.
    """

    frames: str = ""
    count: int = 0
    first: tuple[int, FrameNumbers] | None = None
    states: Mapping[str, int] = field(default_factory=dict)
    failed: Sequence[int] = ()
    samples: int = 0
    bad_samples: int = 0
    progress: float = 0.0
    noise: float | None = None


class _SumsCache:
    """Cache of the totals of ended shots with more than MIN_CACHED_FRAMES frames.

    An entry is valid while the job's row is unchanged.
    """

    def __init__(self) -> None:
        self._known: OrderedDict[str, tuple[str, ShotSums]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, job: Job) -> ShotSums | None:
        with self._lock:
            state, sums = self._known.get(job.id, ("", None))
        return sums if state == _state_text(job) else None

    def put(self, job: Job, sums: ShotSums) -> None:
        with self._lock:
            self._known[job.id] = _state_text(job), sums
            while len(self._known) > MAX_CACHED:
                self._known.popitem(last=False)


_memory = _SumsCache()


def sums_of(jobs: Sequence[Job], live: Mapping[str, JobNumbers], session: Session) -> dict[str, ShotSums]:
    """Returns the totals of shots, by job id. live: the engine's latest numbers, used for jobs that have not ended."""
    found: dict[str, ShotSums] = {}
    asked: list[Job] = []
    changing = set(session.scalars(select(FrameChange.job))) if jobs else set()
    for job in jobs:
        known = None if job.id in changing else live_numbers(job, live.get(job.id))
        remembered = (
            _memory.get(job) if job.state not in ACTIVE_STATES and job.id not in live and job.id not in changing else None
        )
        if known is not None:
            found[job.id] = _engine_sums(job, known)
        elif remembered is not None:
            found[job.id] = remembered
        else:
            asked.append(job)
    for at in range(0, len(asked), MAX_IDS_PER_QUERY):
        some = asked[at : at + MAX_IDS_PER_QUERY]
        found |= _sums_from_database(some, session)
        for job in some:
            known = live.get(job.id) if job.state not in ACTIVE_STATES else None
            if known is not None and known.frames and known.samples > found[job.id].samples:
                found[job.id] = _engine_sums(job, known)  # the engine's numbers are newer than the stored ones
            is_at_rest = job.state not in ACTIVE_STATES and job.id not in live and job.id not in changing
            if is_at_rest and found[job.id].count > MIN_CACHED_FRAMES:
                _memory.put(job, found[job.id])
    return found


def live_numbers(job: Job, live: JobNumbers | None) -> JobNumbers | None:
    """Returns the engine's numbers of a shot, if it is rendering the current revision of the request; else None."""
    shot = Shot.parse(job.shot)
    is_as_asked = live is not None and shot is not None and live.revision == shot.revision
    return live if is_as_asked and live is not None and live.frames and job.state in ACTIVE_STATES else None


def _engine_sums(job: Job, live: JobNumbers) -> ShotSums:
    first = next(iter(live.frames))
    shot = Shot.parse(job.shot)
    text = shot.frames if shot is not None and shot.frames is not None else frames_text(map(frame_number, live.frames))
    about = (text, len(live.frames), (first, live.frames[first]), live.states, live.failed)
    return ShotSums(*about, live.samples, live.bad_samples, live.progress * len(live.frames), live.noise)


def _sums_from_database(jobs: Sequence[Job], session: Session) -> dict[str, ShotSums]:
    """Returns totals over the frames of shots, computed from the numbers stored in the database, by job id."""
    ids = [job.id for job in jobs]
    counts = func.count(), func.count(Frame.noise), func.min(Frame.number)
    sums = (func.coalesce(func.sum(each), 0) for each in (Frame.samples, Frame.bad_samples, Frame.progress))
    columns = (Frame.job, Frame.state, *counts, *sums, func.max(Frame.noise))
    rows: dict[str, list[Any]] = {}
    for job_id, *row in session.execute(select(*columns).where(Frame.job.in_(ids)).group_by(Frame.job, Frame.state)):
        rows.setdefault(str(job_id), []).append(row)
    first_of = select(Frame.job, func.min(Frame.number).label("first")).where(Frame.job.in_(ids)).group_by(Frame.job).subquery()
    names = [getattr(Frame, name) for name in ("job", "number", *FrameNumbers._fields)]
    firsts = select(*names).join(first_of, (Frame.job == first_of.c.job) & (Frame.number == first_of.c.first))
    first = {job_id: (number, FrameNumbers._make(numbers)) for job_id, number, *numbers in session.execute(firsts)}
    failed: dict[str, list[int]] = {}
    where = (Frame.job.in_([id for id, found in rows.items() if any(state == "failed" for state, *_ in found)]),)
    named = select(Frame.job, Frame.number).where(*where, Frame.state == "failed").order_by(Frame.number)
    for job_id, number in session.execute(named):
        failed.setdefault(str(job_id), []).append(number)
    texts = _frame_range_texts(jobs, session)
    return {id: _sums_of_rows(texts[id], rows.get(id, []), first.get(id), failed.get(id, [])) for id in ids}


def _sums_of_rows(frames: str, rows: list[Any], first: tuple[int, FrameNumbers] | None, failed: list[int]) -> ShotSums:
    if not rows:
        return ShotSums()
    able = [row for row in rows if row[0] != "failed"]
    is_known = able and all(known == count for _, count, known, *_ in able)
    count = sum(row[1] for row in rows)
    return ShotSums(
        frames=frames,
        count=count,
        first=first,
        states={row[0]: row[1] for row in rows},
        failed=failed,
        samples=int(sum(row[4] for row in rows)),
        bad_samples=int(sum(row[5] for row in rows)),
        progress=float(sum(row[6] for row in rows)),
        noise=max(row[7] for row in able) if is_known else None,
    )


def _frame_range_texts(jobs: Sequence[Job], session: Session) -> dict[str, str]:
    """Returns the frame ranges of shots as text, by job id.

    Earlier releases did not store it: then it is derived from the frames.
    """
    shots = {job.id: Shot.parse(job.shot) for job in jobs}
    texts = {id: shot.frames for id, shot in shots.items() if shot is not None and shot.frames is not None}
    numbers: dict[str, list[int]] = {id: [] for id in shots if id not in texts}
    if numbers:
        rows = select(Frame.job, Frame.number).where(Frame.job.in_(numbers)).order_by(Frame.job, Frame.number)
        for job_id, number in session.execute(rows):
            numbers[job_id].append(number)
    return texts | {id: frames_text(map(frame_number, each)) for id, each in numbers.items()}


def _state_text(job: Job) -> str:
    """Returns a text that differs whenever a job's request or progress has changed."""
    return json.dumps(
        [job.state, job.started, job.finished, job.active_s, job.spp, job.noise, job.seconds, job.shot, job.doubted]
    )
