"""/api/projects: groups of resources visible to their members only. Administrators create them and choose the members."""

from __future__ import annotations

from dataclasses import asdict

from pydantic import BaseModel, ConfigDict, Field

from service.access.projects import Kind, MemberRole, Summary
from service.http.farm import FarmDependency
from service.http.pagination import PageDependency
from service.http.routers import api_router
from service.http.visit import VisitDependency

__all__ = ["router"]

router = api_router(prefix="/api/projects", tags=["access"])


class ProjectIn(BaseModel):
    """A new project."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(min_length=1, max_length=64)


class MemberIn(BaseModel):
    """What a member may do in a project, of what the user may do at all. view: look at it; submit: add and change too."""

    model_config = ConfigDict(extra="forbid")

    role: MemberRole = "submit"


class ProjectOut(BaseModel):
    """A project that you see. roles: of its members. counts: how many scenes, jobs, environments and references are in it."""

    name: str
    created: float
    members: list[str]
    roles: dict[str, str]
    counts: dict[Kind, int]


@router.get("", response_model=list[ProjectOut])
def list_projects(farm: FarmDependency, visit: VisitDependency, page: PageDependency) -> list[ProjectOut]:
    """Your projects, by name; administrators see all. The header X-Total-Count has their number."""
    projects = farm.access.projects
    return [_out(found) for found in projects.described(page.slice_of(projects.named(visit.sight)))]


@router.post("", status_code=201, response_model=ProjectOut)
def add_project(asked: ProjectIn, farm: FarmDependency) -> ProjectOut:
    """Make one. Nobody but administrators sees what is in it until it has members."""
    return _out(farm.access.projects.add(asked.name))


@router.delete("/{name}", status_code=204)
def remove_project(name: str, farm: FarmDependency) -> None:
    """Remove one that is empty."""
    farm.access.projects.remove(name)


@router.put("/{name}/members/{user}", response_model=ProjectOut)
def let_in(name: str, user: str, farm: FarmDependency, asked: MemberIn | None = None) -> ProjectOut:
    """Let a user see what is in it, and unless the role is view add to it; of a member it is the role from now on."""
    return _out(farm.access.projects.add_member(name, user, (asked or MemberIn()).role))


@router.delete("/{name}/members/{user}", response_model=ProjectOut)
def put_out(name: str, user: str, farm: FarmDependency) -> ProjectOut:
    """Let a user see it no more. It holds at once, also for what is open."""
    return _out(farm.access.projects.remove_member(name, user))


def _out(found: Summary) -> ProjectOut:
    return ProjectOut(**asdict(found))
