"""/api/jobs/{id}/notes, /api/jobs/{id}/review and the same below /api/shared: notes on pictures, and the verdict on them."""

from __future__ import annotations

from fastapi import Response

from service.access.keys import Share
from service.access.visit import Visit
from service.farm import Farm
from service.http.farm import FarmDependency
from service.http.pagination import Page, PageDependency
from service.http.routers import api_router
from service.http.share_links import ShareDependency, check_comments
from service.http.visit import VisitDependency
from service.jobs.lookup import find_job
from service.jobs.notes import Writer, add_note, delete_note, note_out, resolve_note, select_notes, set_verdict
from service.models.notes import NoteIn, NoteOut, NotePatch, ReviewIn, ReviewOut

__all__ = ["router"]

router = api_router(prefix="/api", tags=["jobs"])


@router.get("/jobs/{id}/notes", response_model=list[NoteOut])
def list_notes(id: str, farm: FarmDependency, page: PageDependency) -> list[NoteOut]:
    """Lists the notes on a job's pictures with their replies, oldest first. The header X-Total-Count contains their number."""
    find_job(id, farm)
    return _listed(id, farm, page)


@router.post("/jobs/{id}/notes", status_code=201, response_model=NoteOut)
def make_note(id: str, body: NoteIn, visit: VisitDependency, farm: FarmDependency, response: Response) -> NoteOut:
    """Adds a note on a frame of a job, or a reply. 409 if the job has too many, 429 if there were too many within a minute."""
    added = add_note(id, body, _user(visit, body.author), farm)
    response.headers["Location"] = f"/api/jobs/{id}/notes/{added.id}"
    return added


@router.patch("/jobs/{id}/notes/{note}", response_model=NoteOut)
def change_note(id: str, note: str, body: NotePatch, visit: VisitDependency, farm: FarmDependency) -> NoteOut:
    """Resolves a note, or opens it again."""
    return resolve_note(id, note, body.resolved, _user(visit, body.author), farm)


@router.delete("/jobs/{id}/notes/{note}", status_code=204)
def remove_note(id: str, note: str, visit: VisitDependency, farm: FarmDependency) -> None:
    """Deletes a note with its replies."""
    delete_note(id, note, _user(visit, None), farm)


@router.put("/jobs/{id}/review", response_model=ReviewOut)
def review_job(id: str, body: ReviewIn, visit: VisitDependency, farm: FarmDependency) -> ReviewOut:
    """Approves a job's pictures, asks for changes, or takes the verdict back."""
    return set_verdict(id, body.state, _user(visit, body.author), farm)


@router.get("/shared/notes", response_model=list[NoteOut])
def list_shared_notes(share: ShareDependency, farm: FarmDependency, page: PageDependency) -> list[NoteOut]:
    """Lists the notes on the job of a link that allows notes. The link's secret is sent as the bearer token."""
    check_comments(share, farm)
    return _listed(share.job, farm, page)


@router.post("/shared/notes", status_code=201, response_model=NoteOut)
def make_shared_note(body: NoteIn, share: ShareDependency, visit: VisitDependency, farm: FarmDependency) -> NoteOut:
    """Adds a note or a reply as a guest of a link that allows notes."""
    added = add_note(share.job, body, _guest(share, visit, body.author, farm), farm)
    _record(share, visit, farm, "POST /api/shared/notes", f"notes/{added.id}", 201)
    return added


@router.patch("/shared/notes/{note}", response_model=NoteOut)
def change_shared_note(
    note: str, body: NotePatch, share: ShareDependency, visit: VisitDependency, farm: FarmDependency
) -> NoteOut:
    """Resolves a note, or opens it again, as a guest of a link that allows notes."""
    changed = resolve_note(share.job, note, body.resolved, _guest(share, visit, body.author, farm), farm)
    _record(share, visit, farm, "PATCH /api/shared/notes/{note}", f"notes/{note}", 200)
    return changed


@router.put("/shared/review", response_model=ReviewOut)
def review_shared_job(body: ReviewIn, share: ShareDependency, visit: VisitDependency, farm: FarmDependency) -> ReviewOut:
    """Approves the pictures of a link that allows notes, asks for changes, or takes the verdict back."""
    review = set_verdict(share.job, body.state, _guest(share, visit, body.author, farm), farm)
    _record(share, visit, farm, "PUT /api/shared/review", "review", 200)
    return review


def _listed(job: str, farm: Farm, page: Page) -> list[NoteOut]:
    with farm.sessions() as session:
        _, rows = page.rows(select_notes(job), session)
    return [note_out(row) for row in rows]


def _user(visit: Visit, author: str | None) -> Writer:
    return Writer(visit.user, author, None, visit.address)


def _guest(share: Share, visit: Visit, author: str | None, farm: Farm) -> Writer:
    check_comments(share, farm)
    return Writer(None, author, share.id, visit.address)


def _record(share: Share, visit: Visit, farm: Farm, what: str, about: str, status: int) -> None:
    """Adds a guest's change to the audit log, under the link's id, since the guest's name is unverified."""
    place = f"/api/jobs/{share.job}/{about}"
    farm.access.audit.add(f"link {share.id}", what, kind="share", address=visit.address, about=place, status=status)
