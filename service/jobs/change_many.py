"""Changes to many jobs in one request."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.access.projects import read_only_project
from service.access.visit import Visit
from service.errors import FarmError
from service.events import RowWritten
from service.farm import Farm
from service.jobs.lookup import find_job, job_not_found
from service.models.changes import ChangesIn, ChangesOut, RefusedOut, WasOut
from service.scheduling.jobs.job_changes import begins_anew, drop_failed_dependencies, set_state
from service.store.models import FINAL_STATES, Job

__all__ = ["change_many", "may_begin_anew"]

AT_A_TIME = 100  # jobs in one transaction; a longer one would stall the engine and with it all jobs


def change_many(changes: ChangesIn, farm: Farm, visit: Visit) -> ChangesOut:
    """Applies each change to the jobs that allow it. The result lists jobs hidden from the caller as missing."""
    ids = list(dict.fromkeys(changes.jobs))
    answer = ChangesOut(changed=[], refused=[])
    with farm.sessions() as session:
        chosen = select(Job.id).where(Job.id.in_(ids), visit.sight.clause(Job.project))
        seen = set(session.scalars(chosen))
        of = seen if changes.of is None else set(session.scalars(chosen.where(Job.state.in_(changes.of))))
        where = select(Job.id, Job.project).where(Job.id.in_(ids), Job.project.in_(visit.sight.looks))
        closed = {row.id: row.project for row in session.execute(where)}
    unseen = [id for id in ids if id not in seen and changes.of is None]
    answer.refused += [RefusedOut(id=id, why=str(read_only_project(closed[id]))) for id in ids if id in of and id in closed]
    ids = [id for id in ids if id in of and id not in closed]
    for at in range(0, len(ids), AT_A_TIME):
        some = ids[at : at + AT_A_TIME]
        if changes.state == "deleted":
            answer.changed += [WasOut(**each._asdict()) for each in farm.deleting.delete(some)]
        else:
            _change_jobs(some, changes, farm, visit, answer)
    known = {each.id for each in answer.changed} | {each.id for each in answer.refused}
    answer.refused += [RefusedOut(id=id, why=str(job_not_found(id))) for id in (*ids, *unseen) if id not in known]
    return answer


def _change_jobs(ids: list[str], changes: ChangesIn, farm: Farm, visit: Visit, answer: ChangesOut) -> None:
    anew: dict[str, bool] = {}
    if changes.state == "running":
        for id in ids:
            try:
                anew[id] = may_begin_anew(id, farm)
                farm.lighting.restore(id)
            except FarmError as error:
                answer.refused.append(RefusedOut(id=id, why=str(error)))
    refused = {each.id for each in answer.refused}
    changed: list[WasOut] = []
    with farm.sessions.begin() as session:
        for job in _rows([id for id in ids if id not in refused], session):
            was = WasOut(id=job.id, state=job.state, priority=job.priority)
            try:
                if changes.state == "running" and job.state in FINAL_STATES:
                    session.flush()
                    farm.quotas.check_job(visit.caller, session)
                if changes.state is not None and changes.state != "deleted":
                    set_state(job, changes.state, anew.get(job.id, False))
                job.priority = job.priority if changes.priority is None else changes.priority
            except FarmError as error:
                answer.refused.append(RefusedOut(id=job.id, why=str(error)))
                continue
            changed.append(was)
        if changes.state == "running":
            drop_failed_dependencies([each.id for each in changed], session)
    for each in changed:
        farm.events.publish(RowWritten("job", each.id))
    answer.changed += changed


def may_begin_anew(id: str, farm: Farm) -> bool:
    """Returns True if setting a job to running would start it again with an empty film.

    Reads the film of a job that has ended.
    """
    return id not in farm.engine.snapshot.jobs and begins_anew(find_job(id, farm), farm.films)


def _rows(ids: list[str], session: Session) -> list[Job]:
    return list(session.scalars(select(Job).where(Job.id.in_(ids)).with_for_update()))
