"""Reuse of samples: a new job starts with the samples that earlier jobs rendered of the same picture.

A film contains exact sums of numbered samples, so a job of 256 samples that starts with another's 64 yields the same bits as one
that renders all of them. The film is copied, so later changes of the earlier job do not affect the new one. A shot is copied
frame by frame, each from the job with most samples of it; a complete frame needs no preparation.

Samples that would change the bits are not reused: those of another kind of workers than the connected ones (other kernels,
another processor), more samples than requested, and, for a job with a target noise, tiles that would have ended earlier. A job
with a target time reuses nothing; nor does a shot that distributes its samples by the noise of its frames.
"""

from __future__ import annotations

import json
import logging
import time
from collections import defaultdict
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import select

from renderer.frames import frame_number, frames_text
from renderer.settings import MAX_SPP, RenderSettings
from service.errors import FarmError
from service.scheduling.jobs.history import History
from service.scheduling.jobs.plan import FIRST_CHECK_SAMPLES
from service.scheduling.jobs.shot_changes import NOISIEST_FIRST
from service.scheduling.snapshot import SnapshotHolder
from service.shot import Shot
from service.store.database import Sessions
from service.store.disk_space import check_free_space
from service.store.film_store import FilmStore
from service.store.models import Frame, Job

__all__ = ["InitialValues", "SampleReuse"]

MAX_EXAMINED_JOBS = 32  # latest jobs of a picture to examine
ENDED_STATES = ("finished", "cancelled")
PATIENCE_S = 20.0  # seconds for copying during a request; the remaining frames are rendered

InitialValues = Mapping[int, Mapping[str, Any]]  # by frame key: initial values of the frame's columns

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _ReusableJob:
    """An earlier job whose samples can be reused. samples: number of samples by frame key, over all pixels, if not 0."""

    job: Job
    samples: Mapping[int, int]

    @property
    def end_fields(self) -> tuple[str, int | None, float | None, float | None, str, str]:
        """The job's state, goals, shot and distrusted workers. If these change while samples are copied, the copy is unusable."""
        job = self.job
        return job.state, job.spp, job.noise, job.seconds, json.dumps(job.shot, sort_keys=True), json.dumps(job.doubted)


class SampleReuse:
    """Copies films of earlier jobs to new ones. Thread-safe."""

    def __init__(self, sessions: Sessions, films: FilmStore, board: SnapshotHolder, data: Path, min_free_bytes: int) -> None:
        """Stores the parameters. data: folder of the films; `min_free_bytes` of its disk remain free."""
        self._sessions = sessions
        self._films = films
        self._board = board
        self._data = data
        self._min_free_bytes = min_free_bytes

    def begin(self, job: Job, keys: Collection[int] = (0,)) -> InitialValues:
        """Creates the film of a new job from films of earlier jobs, and updates the job's row, which is not stored yet.

        keys: frame keys of the new job. Returns the initial columns of the frames with reused samples, by frame key; empty if
        there are none or the job's settings are not known yet. The caller deletes the film if it does not store the job.
        """
        shot = Shot.parse(job.shot)
        is_laid_out = shot is not None and shot.order == NOISIEST_FIRST
        if job.picture is None or job.settings is None or job.tile_size is None or job.seconds is not None or is_laid_out:
            return {}
        sources = self._sources(job, set(keys))
        while sources:
            try:
                taken = self._copy_best_samples(job, sources)
            except FarmError as error:
                log.info("job %s reuses no samples: %s", job.id, error)
                return {}
            if not taken:
                return {}
            changed = [id for id in {id for id, _ in taken.values()} if not self._is_unchanged(sources[id])]
            if not changed:
                return self._initial_values(job, sources, taken)
            self._films.delete(job.id)  # those jobs continued meanwhile, perhaps with another goal
            sources = {id: source for id, source in sources.items() if id not in changed}
        return {}

    def _copy_best_samples(self, job: Job, sources: Mapping[str, _ReusableJob]) -> dict[int, tuple[str, int]]:
        """Copies each frame from the job with most samples of it. Returns job id and sample count by frame key.

        Raises FarmError.
        """
        assert job.settings is not None and job.tile_size is not None
        found: dict[int, tuple[str, int]] = {}
        refused: set[str] = set()
        fitting: set[str] = set()  # jobs whose films fit on the disk
        until = time.monotonic() + PATIENCE_S
        with self._films.copy(job.id, RenderSettings.from_json(job.settings), job.tile_size) as take:
            for key in sorted({key for source in sources.values() for key in source.samples}):
                if found and time.monotonic() > until:
                    log.info("job %s reuses no samples from frame %g on, since copying takes too long", job.id, frame_number(key))
                    break
                having = [id for id in sources if key in sources[id].samples and id not in refused]
                for id in sorted(having, key=lambda id: -sources[id].samples[key]):
                    try:
                        if id not in fitting:
                            check_free_space(self._data, self._min_free_bytes + self._films.size(id))
                            fitting.add(id)
                        had = take(id, [key], job.spp or MAX_SPP)
                    except FarmError as error:
                        log.info("no further samples of job %s are reused: %s", id, error)
                        refused.add(id)
                        continue
                    if key in had:
                        found[key] = id, had[key]
                        break
        return found

    def _sources(self, job: Job, keys: set[int]) -> dict[str, _ReusableJob]:
        """Returns the jobs whose samples can be reused, by id, those with most samples first. All are of one kind of workers."""
        kinds = {report.kind for report in self._board.roster.reports.values()}
        with self._sessions() as session:
            jobs = session.scalars(
                select(Job)
                .where(Job.picture == job.picture, Job.state.in_(ENDED_STATES))
                .order_by(Job.created.desc())
                .limit(MAX_EXAMINED_JOBS)
            )
            able = [
                each
                for each in jobs
                if each.kind and not each.doubted and (not kinds or each.kind in kinds) and _is_subset(each, job)
            ]
            samples: dict[str, dict[int, int]] = {each.id: {} for each in able}
            # Only these columns, since the full rows of a long shot take megabytes.
            query = select(Frame.job, Frame.number, Frame.samples).where(Frame.job.in_(list(samples)), Frame.samples > 0)
            for id, number, count in session.execute(query.where(Frame.number.between(min(keys), max(keys)))):
                if number in keys:
                    samples[id][number] = count
        found = [_ReusableJob(each, samples[each.id]) for each in able if samples[each.id]]
        found.sort(key=lambda each: -sum(each.samples.values()))
        return {each.job.id: each for each in found if each.job.kind == found[0].job.kind}

    def _is_unchanged(self, source: _ReusableJob) -> bool:
        """Returns True if an earlier job still exists and none of its `end_fields` has changed."""
        with self._sessions() as session:
            job = session.get(Job, source.job.id)
        return job is not None and _ReusableJob(job, {}).end_fields == source.end_fields

    def _initial_values(
        self, job: Job, sources: Mapping[str, _ReusableJob], reused: Mapping[int, tuple[str, int]]
    ) -> InitialValues:
        settings = job.settings or {}
        samples_of: dict[str, int] = defaultdict(int)
        for id, samples in reused.values():
            samples_of[id] += samples
        main = sources[max(samples_of, key=lambda id: samples_of[id])].job
        samples = sum(samples_of.values())
        pixels = settings["width"] * settings["height"]
        spp = samples / (pixels * len(reused))
        job.kind = main.kind
        taken: dict[str, Any] = {"job": main.id, "spp": round(spp, 3), "samples": samples}
        if job.shot is not None:
            taken["frames"] = frames_text([frame_number(key) for key in sorted(reused)])
        job.taken = taken
        history = History(events=[[round(time.time(), 2), "taken", main.id]])
        with self._sessions() as session:
            of_source = History.parse(session.scalar(select(Job.history).where(Job.id == main.id)))
        last: list[Any] = of_source.points[-1] if of_source.points else []
        noise: float | None = last[2] if last and last[1] == samples else None
        if noise is not None:
            history.points.append([0.0, float(samples), noise])
        job.history = history.to_json()
        log.info("job %s reuses %g samples per pixel of %d frame(s) of job %s", job.id, spp, len(reused), main.id)
        if job.shot is None:
            return {key: {"samples": samples, "noise": noise} for key, (_, samples) in reused.items()}
        rows = self._rows(reused)
        return {key: _frame(job, sources[id].job, rows.get(key), samples, pixels) for key, (id, samples) in reused.items()}

    def _rows(self, reused: Mapping[int, tuple[str, int]]) -> dict[int, Frame]:
        """Returns the rows of the reused frames in the earlier jobs, by frame key.

        reused: id of the earlier job and sample count, by frame key.
        """
        found: dict[int, Frame] = {}
        with self._sessions() as session:
            for id in {id for id, _ in reused.values()}:
                keys = [key for key, (source, _) in reused.items() if source == id]
                query = select(Frame).where(Frame.job == id, Frame.number.between(min(keys), max(keys)), Frame.samples > 0)
                found |= {row.number: row for row in session.scalars(query) if reused.get(row.number, ("",))[0] == id}
        return found


def _is_subset(source: Job, job: Job) -> bool:
    """Returns True if the samples that job `source` has rendered are a subset of those that `job` requires."""
    if source.noise is None and source.seconds is None and (source.spp or 0) > (job.spp or MAX_SPP):
        return False  # decided without reading its film
    if job.noise is None or (source.spp or MAX_SPP) <= FIRST_CHECK_SAMPLES:
        return True
    # Both check the noise at the same sample counts, so a tile that continues at a coarser target also continues at a finer one.
    return source.seconds is None and source.noise is not None and source.noise >= job.noise


def _frame(job: Job, source: Job, frame: Frame | None, samples: int, pixels: int) -> dict[str, Any]:
    """Returns the initial columns of a shot's frame with reused samples. If no samples are missing, the frame is finished.

    samples: number of reused samples, over all pixels. pixels: number of the frame's pixels.
    """
    if job.noise is None:
        is_whole = samples == (job.spp or 0) * pixels
    else:
        alike = (source.noise, source.spp, source.seconds, frame and frame.spp) == (job.noise, job.spp, None, None)
        is_whole = alike and frame is not None and frame.state == "finished" and samples == frame.samples
    if is_whole and frame is not None and frame.settings is not None:
        had = {"bad_samples": frame.bad_samples, "noise": frame.noise, "settings": frame.settings}
        return {"samples": samples, "target": samples, "progress": 1.0, "state": "finished", **had}
    target = max((job.spp or 0) * pixels, samples)
    return {"samples": samples, "target": target, "progress": min(samples / target, 0.9999)}
