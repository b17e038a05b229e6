"""/api/projects: groups of content that only their members can see. Administrators create them and choose the members."""

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
    """A new project, by name."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(min_length=1, max_length=64, description="name of the project")


class MemberIn(BaseModel):
    """A member's role in a project. It can restrict the user's own role, but not extend it.

    view: read only; submit: also add and change content.
    """

    model_config = ConfigDict(extra="forbid")

    role: MemberRole = Field(default="submit", description="role in this project")


class ProjectOut(BaseModel):
    """A project visible to you. roles: by member. counts: number of its scenes, jobs, environments and references."""

    name: str = Field(description="name of the project")
    created: float = Field(description="Unix time in seconds")
    members: list[str] = Field(description="names of the members")
    roles: dict[str, str] = Field(description="role of each member")
    counts: dict[Kind, int] = Field(description="number of scenes, jobs, environments and references")


@router.get("", response_model=list[ProjectOut])
def list_projects(farm: FarmDependency, visit: VisitDependency, page: PageDependency) -> list[ProjectOut]:
    """Lists your projects by name; for administrators all projects. The header X-Total-Count contains their number."""
    projects = farm.access.projects
    return [_project_out(found) for found in projects.summaries(page.slice_of(projects.visible_names(visit.sight)))]


@router.post("", status_code=201, response_model=ProjectOut)
def add_project(body: ProjectIn, farm: FarmDependency) -> ProjectOut:
    """Creates a project. Until it has members, only administrators can see its content."""
    return _project_out(farm.access.projects.add(body.name))


@router.delete("/{name}", status_code=204)
def remove_project(name: str, farm: FarmDependency) -> None:
    """Deletes an empty project."""
    farm.access.projects.remove(name)


@router.put("/{name}/members/{user}", response_model=ProjectOut)
def let_in(name: str, user: str, farm: FarmDependency, body: MemberIn | None = None) -> ProjectOut:
    """Adds a user to a project, or changes a member's role. With role `view`, the user can only read."""
    return _project_out(farm.access.projects.add_member(name, user, (body or MemberIn()).role))


@router.delete("/{name}/members/{user}", response_model=ProjectOut)
def put_out(name: str, user: str, farm: FarmDependency) -> ProjectOut:
    """Removes a member from a project. This takes effect at once, also on open connections."""
    return _project_out(farm.access.projects.remove_member(name, user))


def _project_out(found: Summary) -> ProjectOut:
    return ProjectOut(**asdict(found))
