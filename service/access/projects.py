"""Projects: groups of scenes, jobs, environments and reference pictures that only their members can see.

Visibility is checked in two places: the authorization middleware checks the object in a request's path; lists, events and
requests that refer to further objects check the rows. Content outside any project is visible to all users; administrators see
everything. A member's role in a project can restrict the user's own role, but not extend it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import ColumnElement, delete, func, select, true
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from renderer.sentences import Sentence
from service.access.roles import Caller
from service.access.users import NAME
from service.errors import Conflict, Invalid, NotAllowed, NotFound
from service.store.database import Sessions
from service.store.models import Environment, Job, Member, Project, Reference, Scene, ShareTerms, User

__all__ = [
    "EVERYTHING",
    "NOTHING",
    "Kind",
    "MemberRole",
    "ProjectVisibility",
    "Projects",
    "Summary",
    "lock_project",
    "read_only_project",
]

Kind = Literal["scene", "job", "environment", "reference"]
MemberRole = Literal["view", "submit"]
ROWS: dict[Kind, Any] = {"scene": Scene, "job": Job, "environment": Environment, "reference": Reference}
CACHE_TTL_S = 3.0  # seconds for which a user's projects are cached: another process may change them
MAX_CACHED = 65536


@dataclass(frozen=True)
class ProjectVisibility:
    """The projects that are visible to a caller. Content outside any project is visible too.

    everything: whether all projects are visible. projects: names of the visible projects. looks: names of those visible projects
    whose content the caller may only read.
    """

    everything: bool
    projects: frozenset[str] = frozenset()
    looks: frozenset[str] = frozenset()

    def is_visible(self, project: str | None) -> bool:
        """Returns True if content of this project is visible to the caller.

        project: "" for content outside any project, and None for content that does not exist; both return True.
        """
        return self.everything or not project or project in self.projects

    def changes(self, project: str | None) -> bool:
        """Returns False if the caller may only read this project.

        True does not suffice for a change: the caller's own role must permit it too.
        """
        return self.everything or project not in self.looks

    def clause(self, column: Any) -> ColumnElement[bool]:
        """Returns the SQL condition equivalent to `is_visible`, for a table's `project` column."""
        if self.everything:
            return true()
        found: ColumnElement[bool] = column.in_(["", *sorted(self.projects)])
        return found


EVERYTHING = ProjectVisibility(True)
NOTHING = ProjectVisibility(False)


@dataclass(frozen=True)
class Summary:
    """A project with its members' names and roles, and the number of its objects of each kind."""

    name: str
    created: float
    members: list[str]
    roles: dict[str, str]
    counts: dict[Kind, int]


class Projects:
    """The projects in the database, with a short-lived cache."""

    def __init__(self, sessions: Sessions) -> None:
        self._sessions = sessions
        self._lock = threading.Lock()
        self._sights: dict[str, tuple[float, ProjectVisibility]] = {}
        self._where: dict[tuple[Kind, str], str] = {}  # an object never changes its project

    def cached_visibility(self, caller: Caller | None) -> ProjectVisibility | None:
        """Returns the projects visible to a caller, from the cache only; None if they are not cached."""
        if caller is None or caller.is_worker:
            return NOTHING
        if caller.sees_everything:
            return EVERYTHING
        read, sight = self._sights.get(caller.name, (0.0, NOTHING))
        return sight if read and time.monotonic() - read < CACHE_TTL_S else None

    def visibility(self, caller: Caller | None) -> ProjectVisibility:
        """Returns the projects visible to a caller."""
        if (known := self.cached_visibility(caller)) is not None:
            return known
        assert caller is not None
        read = time.monotonic()
        with self._sessions() as session:
            roles = {row.project: row.role for row in session.scalars(select(Member).where(Member.user == caller.name))}
        sight = ProjectVisibility(False, frozenset(roles), frozenset(name for name, role in roles.items() if role == "view"))
        with self._lock:
            if len(self._sights) >= MAX_CACHED:
                self._sights.clear()
            self._sights[caller.name] = read, sight
        return sight

    def cached_project(self, kind: Kind, id: str) -> str | None:
        """Returns the name of the project that contains an object, from the cache only; None if it is not cached."""
        return self._where.get((kind, id))

    def project_of(self, kind: Kind, id: str) -> str | None:
        """Returns the name of the project that contains an object; "" if it is in no project, None if it does not exist."""
        if (known := self.cached_project(kind, id)) is not None:
            return known
        with self._sessions() as session:
            row = ROWS[kind]
            found = session.scalar(select(row.project).where(row.id == id)) if "\0" not in id else None
        if found is not None:
            self.cache_project(kind, id, found)
        return found

    def cache_project(self, kind: Kind, id: str, project: str) -> None:
        """Caches which project an object belongs to."""
        with self._lock:
            if len(self._where) >= MAX_CACHED:
                self._where.clear()
            self._where[kind, id] = project

    def add(self, name: str) -> Summary:
        """Creates a project without members. Raises Invalid if the name is invalid, Conflict if it is taken."""
        if not NAME.fullmatch(name):
            raise Invalid(
                Sentence(
                    "project-name-invalid",
                    "{name} cannot be a project's name. Use small letters, digits and . _ @ - (at most 63).",
                    name=repr(name[:64]),
                )
            )
        try:
            with self._sessions.begin() as session:
                session.add(Project(name=name, created=time.time()))
        except IntegrityError:
            raise Conflict(
                Sentence("project-exists", "There is a project {name} already. Choose another name.", name=repr(name))
            ) from None
        return self.find(name)

    def visible_names(self, sight: ProjectVisibility) -> list[str]:
        """Returns the names of the projects visible to a caller, in alphabetical order.

        sight: the projects that the caller may see.
        """
        with self._sessions() as session:
            return list(session.scalars(select(Project.name).where(sight.clause(Project.name)).order_by(Project.name)))

    def summaries(self, names: Collection[str]) -> list[Summary]:
        """Returns the summaries of the named projects, ordered by name. Skips projects that no longer exist."""
        with self._sessions() as session:
            rows = session.scalars(select(Project).where(Project.name.in_(names)).order_by(Project.name)).all()
            roles: dict[str, dict[str, str]] = {row.name: {} for row in rows}
            for each in session.scalars(select(Member).where(Member.project.in_(names)).order_by(Member.user)):
                roles.get(each.project, {})[each.user] = each.role
            counts: dict[str, dict[Kind, int]] = {row.name: {} for row in rows}
            for kind, table in ROWS.items():
                query = select(table.project, func.count()).where(table.project.in_(names)).group_by(table.project)
                query = query.where(Scene.of.is_(None)) if table is Scene else query
                for project, count in session.execute(query):
                    counts.get(project, {})[kind] = count
        return [Summary(row.name, row.created, list(roles[row.name]), roles[row.name], counts[row.name]) for row in rows]

    def find(self, name: str) -> Summary:
        """Returns the summary of a project. Raises NotFound."""
        found = self.summaries([name]) if "\0" not in name else []
        if not found:
            raise project_not_found(name)
        return found[0]

    def check(self, name: str, sight: ProjectVisibility) -> str:
        """Returns `name` if the caller may add content to this project; "" (no project) is always accepted.

        sight: the caller's visibility. Raises NotFound if the project is not visible, NotAllowed if the caller may only read it.
        """
        if not name:
            return name
        with self._sessions() as session:
            is_there = "\0" not in name and session.get(Project, name) is not None
        if not (is_there and sight.is_visible(name)):
            raise project_not_found(name)
        if not sight.changes(name):
            raise read_only_project(name)
        return name

    def recheck(self, name: str, caller: Caller | None, sight: ProjectVisibility) -> None:
        """Repeats `check` after an upload, which may have taken hours. sight: the visibility at the upload's start.

        Raises as `check` does.
        """
        self.check(name, sight if sight.everything else self.visibility(caller))

    def add_member(self, name: str, user: str, role: MemberRole = "submit") -> Summary:
        """Adds a member to a project, or changes a member's role. Takes effect at once. Raises NotFound."""
        with self._sessions.begin() as session:
            if session.get(Project, name) is None:
                raise project_not_found(name)
            if session.get(User, user) is None:
                raise NotFound(
                    Sentence("user-not-found", "There is no user {name}. GET /api/users lists them.", name=repr(user[:64]))
                )
            session.merge(Member(project=name, user=user, role=role))
        self.clear_cache()
        return self.find(name)

    def remove_member(self, name: str, user: str) -> Summary:
        """Removes a member from a project. Takes effect at once, also on open connections. Raises NotFound."""
        with self._sessions.begin() as session:
            session.execute(delete(Member).where(Member.project == name, Member.user == user))
        self.clear_cache()
        return self.find(name)

    def remove(self, name: str) -> None:
        """Deletes a project. Raises NotFound, or Conflict if it still has content."""
        with self._sessions.begin() as session:
            if session.get(Project, name, with_for_update=True) is None:
                raise project_not_found(name)
            counts = {kind: _count_content(row, name, session) for kind, row in ROWS.items()}
            left = [_amount(kind, count) for kind, count in counts.items() if count]
            if left:
                raise Conflict(
                    Sentence(
                        "project-not-empty",
                        "The project {name} still has {contents}. Delete them first.",
                        name=repr(name),
                        contents=left,
                    )
                )
            session.execute(delete(Member).where(Member.project == name))
            session.execute(delete(ShareTerms).where(ShareTerms.name == f"project:{name}"))
            session.execute(delete(Project).where(Project.name == name))
        self.clear_cache()

    def clear_cache(self) -> None:
        """Clears the cache of visible projects."""
        with self._lock:
            self._sights = {}


def lock_project(name: str, session: Session) -> None:
    """Locks a project's row in a transaction that adds content, so that it is not deleted concurrently. Raises NotFound."""
    if name and session.get(Project, name, with_for_update={"read": True, "key_share": True}) is None:
        raise project_not_found(name)


def _count_content(row: Any, project: str, session: Session) -> int:
    query = select(func.count()).select_from(row).where(row.project == project)
    return session.scalar(query.where(Scene.of.is_(None)) if row is Scene else query) or 0


def project_not_found(name: str) -> NotFound:
    """Returns the error for a project that does not exist or is not visible."""
    return NotFound(
        Sentence(
            "project-not-found",
            "There is no project {name}, or you are not a member of it. GET /api/projects lists yours.",
            name=repr(name[:64]),
        )
    )


def read_only_project(name: str) -> NotAllowed:
    """Returns the error for a change in a read-only project."""
    return NotAllowed(
        Sentence(
            "project-read-only",
            "You may view the project {name} but not change it. Ask the administrator of this farm.",
            name=repr(name),
        )
    )


def _amount(kind: Kind, count: int) -> str:
    """Returns a count with its noun, such as `3 jobs`, to insert into a message."""
    match kind:
        case "scene":
            return Sentence("amount-scene", "1 scene") if count == 1 else Sentence("amount-scenes", "{count} scenes", count=count)
        case "job":
            return Sentence("amount-job", "1 job") if count == 1 else Sentence("amount-jobs", "{count} jobs", count=count)
        case "environment":
            if count == 1:
                return Sentence("amount-environment", "1 environment")
            return Sentence("amount-environments", "{count} environments", count=count)
        case "reference":
            if count == 1:
                return Sentence("amount-reference", "1 reference")
            return Sentence("amount-references", "{count} references", count=count)
