"""The access requirement of every route, in one table. A test compares the table with the existing routes.

Paths below /api/ that are missing from the table require an authenticated caller.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

from starlette.routing import compile_path

from service.access.projects import Kind
from service.access.roles import Caller, Role

__all__ = ["NEEDS", "Need", "need_of", "resource_of"]


@dataclass(frozen=True)
class Need:
    """The access requirement of a route.

    role: minimum role of a user or program; None: only workers may call it. workers: whether a worker token suffices. known:
    whether the caller must have authenticated even if the service needs no login on its own machine.
    """

    role: Role | None
    workers: bool = False
    known: bool = False

    def is_met(self, caller: Caller | None) -> bool:
        """Returns True if this caller meets the requirement."""
        if self.role is Role.NOBODY:
            return True
        if caller is None or (self.known and not caller.is_known):
            return False
        return self.workers if caller.is_worker else self.role is not None and caller.role >= self.role

    @property
    def weight(self) -> tuple[bool, int, bool]:
        """Sort key of the requirement: a stricter requirement has a larger key."""
        return self.role is None, self.role or 0, self.known


ANYONE = Need(Role.NOBODY)
WORKER = Need(None, workers=True)
VIEW = Need(Role.VIEW)
SUBMIT = Need(Role.SUBMIT)
ADMIN = Need(Role.ADMIN)
IDENTIFIED = Need(Role.VIEW, known=True)
IDENTIFIED_ADMIN = Need(Role.ADMIN, known=True)  # for managing users and tokens
UNKNOWN = Need(Role.VIEW, workers=True)  # unknown path: authenticated callers get 404

NEEDS: dict[tuple[str, str], Need] = {
    ("GET", "/healthz"): ANYONE,
    ("GET", "/readyz"): ANYONE,
    ("GET", "/metrics"): Need(Role.VIEW, workers=True),
    ("GET", "/openapi.json"): VIEW,
    ("GET", "/docs"): ANYONE,
    ("GET", "/docs/guides"): ANYONE,
    ("GET", "/shared"): ANYONE,
    ("GET", "/"): ANYONE,
    ("GET", "/api/session"): ANYONE,
    ("POST", "/api/login"): ANYONE,
    ("GET", "/api/login/openid"): ANYONE,
    ("GET", "/api/login/openid/answer"): ANYONE,
    ("POST", "/api/logout"): ANYONE,
    ("PUT", "/api/session/password"): IDENTIFIED,
    ("GET", "/api/tokens"): IDENTIFIED,
    ("POST", "/api/tokens"): IDENTIFIED,
    ("DELETE", "/api/tokens/{id}"): IDENTIFIED,
    ("GET", "/api/users"): IDENTIFIED_ADMIN,
    ("POST", "/api/users"): IDENTIFIED_ADMIN,
    ("PATCH", "/api/users/{name}"): IDENTIFIED_ADMIN,
    ("DELETE", "/api/users/{name}"): IDENTIFIED_ADMIN,
    ("POST", "/api/links"): IDENTIFIED_ADMIN,
    ("GET", "/api/audit"): IDENTIFIED_ADMIN,
    ("GET", "/api/quota"): IDENTIFIED,
    ("GET", "/api/quotas"): IDENTIFIED_ADMIN,
    ("PUT", "/api/quotas/{of}/{name}"): IDENTIFIED_ADMIN,
    ("DELETE", "/api/quotas/{of}/{name}"): IDENTIFIED_ADMIN,
    ("GET", "/api/projects"): VIEW,
    ("POST", "/api/projects"): IDENTIFIED_ADMIN,
    ("DELETE", "/api/projects/{name}"): IDENTIFIED_ADMIN,
    ("PUT", "/api/projects/{name}/members/{user}"): IDENTIFIED_ADMIN,
    ("DELETE", "/api/projects/{name}/members/{user}"): IDENTIFIED_ADMIN,
    ("GET", "/api/scenes"): VIEW,
    ("POST", "/api/scenes"): SUBMIT,
    ("GET", "/api/scenes/{id}"): VIEW,
    ("DELETE", "/api/scenes/{id}"): SUBMIT,
    ("GET", "/api/scenes/{id}/thumbnail.png"): VIEW,
    ("GET", "/api/scenes/{id}/poster.jpg"): VIEW,
    ("GET", "/api/scenes/{id}/preview"): VIEW,
    ("GET", "/api/scenes/{id}/preview-light"): VIEW,
    ("GET", "/api/scenes/{id}/takes"): VIEW,
    ("POST", "/api/scenes/{id}/takes"): SUBMIT,
    ("PATCH", "/api/scenes/{id}/takes/{take}"): SUBMIT,
    ("DELETE", "/api/scenes/{id}/takes/{take}"): SUBMIT,
    ("GET", "/api/scenes/{id}/takes/{take}/picture.webp"): VIEW,
    ("WS", "/api/scenes/{id}/viewport"): VIEW,
    ("GET", "/api/environments"): VIEW,
    ("POST", "/api/environments"): SUBMIT,
    ("GET", "/api/environments/{id}/thumbnail.jpg"): VIEW,
    ("DELETE", "/api/environments/{id}"): SUBMIT,
    ("GET", "/api/references"): VIEW,
    ("POST", "/api/references"): SUBMIT,
    ("GET", "/api/references/{id}"): VIEW,
    ("GET", "/api/references/{id}/film"): VIEW,
    ("GET", "/api/references/{id}/file"): VIEW,
    ("GET", "/api/references/{id}/image.{extension}"): VIEW,
    ("DELETE", "/api/references/{id}"): SUBMIT,
    ("GET", "/api/examples"): VIEW,
    ("POST", "/api/examples/{name}"): SUBMIT,
    ("GET", "/api/jobs"): VIEW,
    ("POST", "/api/jobs"): SUBMIT,
    ("GET", "/api/jobs/ids"): VIEW,
    ("GET", "/api/jobs/tallies"): VIEW,
    ("POST", "/api/jobs/changes"): SUBMIT,
    ("POST", "/api/jobs/openjd"): SUBMIT,
    ("GET", "/api/jobs/{id}"): VIEW,
    ("PATCH", "/api/jobs/{id}"): SUBMIT,
    ("POST", "/api/jobs/{id}/anew"): SUBMIT,
    ("DELETE", "/api/jobs/{id}"): SUBMIT,
    ("GET", "/api/jobs/{id}/links"): SUBMIT,
    ("POST", "/api/jobs/{id}/links"): SUBMIT,
    ("DELETE", "/api/jobs/{id}/links/{link}"): SUBMIT,
    ("GET", "/api/shared"): ANYONE,  # needs a share link's secret
    ("GET", "/api/shared/image.{extension}"): ANYONE,
    ("GET", "/api/shared/notes"): ANYONE,  # these need the secret of a link that allows notes
    ("POST", "/api/shared/notes"): ANYONE,
    ("PATCH", "/api/shared/notes/{note}"): ANYONE,
    ("PUT", "/api/shared/review"): ANYONE,
    ("GET", "/api/jobs/{id}/notes"): VIEW,
    ("POST", "/api/jobs/{id}/notes"): SUBMIT,
    ("PATCH", "/api/jobs/{id}/notes/{note}"): SUBMIT,
    ("DELETE", "/api/jobs/{id}/notes/{note}"): SUBMIT,
    ("PUT", "/api/jobs/{id}/review"): SUBMIT,
    ("GET", "/api/jobs/{id}/history"): VIEW,
    ("GET", "/api/jobs/{id}/explain"): VIEW,
    ("GET", "/api/jobs/{id}/log"): VIEW,
    ("GET", "/api/jobs/{id}/snapshots"): VIEW,
    ("GET", "/api/jobs/{id}/snapshots/{spp}/film"): VIEW,
    ("GET", "/api/jobs/{id}/snapshots/{spp}/image.{extension}"): VIEW,
    ("WS", "/api/jobs/{id}/live"): VIEW,
    ("GET", "/api/jobs/{id}/frames"): VIEW,
    ("GET", "/api/jobs/{id}/frames/{n}"): VIEW,
    ("GET", "/api/jobs/{id}/frames/{n}/image.{extension}"): VIEW,
    ("GET", "/api/jobs/{id}/frames/{n}/film"): VIEW,
    ("GET", "/api/jobs/{id}/frames/{n}/deep.exr"): VIEW,
    ("GET", "/api/jobs/{id}/frames/{n}/pixel"): VIEW,
    ("GET", "/api/jobs/{id}/frames/{n}/digest"): VIEW,
    ("GET", "/api/jobs/{id}/frames/{n}/log"): VIEW,
    ("GET", "/api/jobs/{id}/frames/{n}/workers"): VIEW,
    ("GET", "/api/jobs/{id}/frames.zip"): VIEW,
    ("GET", "/api/jobs/{id}/movie.{extension}"): VIEW,
    ("GET", "/api/workers"): Need(Role.VIEW, workers=True),
    ("PATCH", "/api/workers/{name:path}"): ADMIN,
    ("GET", "/api/workers/{name:path}/log"): ADMIN,
    ("GET", "/api/joining"): ADMIN,
    ("GET", "/api/sites"): VIEW,
    ("GET", "/api/shares"): VIEW,
    ("PUT", "/api/shares/{share}"): ADMIN,
    ("DELETE", "/api/shares/{share}"): ADMIN,
    ("GET", "/api/retention"): ADMIN,
    ("POST", "/api/retention"): ADMIN,
    ("GET", "/api/hooks"): ADMIN,
    ("POST", "/api/hooks/{number}/test"): ADMIN,
    ("GET", "/api/events"): VIEW,
    ("GET", "/api/info"): VIEW,
    ("GET", "/api/view-table"): VIEW,
    ("GET", "/api/blender-addon.zip"): VIEW,
    ("GET", "/api/farm/join"): WORKER,
    ("WS", "/api/farm/channel"): WORKER,
    ("GET", "/api/farm/scenes/{id}/manifest"): WORKER,
    ("GET", "/api/farm/blobs/{sha256}"): WORKER,
    ("POST", "/api/farm/blobs/{sha256}/keep"): WORKER,
    ("PUT", "/api/farm/blobs/{sha256}"): WORKER,
    ("GET", "/api/farm/films/{job}/{frame}"): WORKER,
    ("GET", "/api/farm/views/{message}"): WORKER,
    ("GET", "/api/farm/kernels/{name}"): WORKER,
    ("PUT", "/api/farm/kernels/{name}"): WORKER,
}


# Collections whose items may belong to a project that the caller may not see.
PROJECT_RESOURCES: dict[str, Kind] = {"scenes": "scene", "jobs": "job", "environments": "environment", "references": "reference"}


def resource_of(pattern: str, path: str) -> tuple[Kind, str] | None:
    """Returns kind and id of the object that a path addresses, if projects can hide it; otherwise None.

    pattern: the table's pattern of this path, as `need_of` returns it.
    """
    _, _, collection, name, *_ = [*pattern.split("/"), "", "", ""]
    if collection not in PROJECT_RESOURCES or name != "{id}":
        return None
    return PROJECT_RESOURCES[collection], path.split("/")[3]


def need_of(method: str, path: str) -> tuple[str, Need]:
    """Returns the table's pattern that matches a path, and its requirement. If several match, the strictest applies.

    method: "WS" for a WebSocket. HEAD is treated as GET. For an unsupported method, the least strict requirement of the path
    applies.
    """
    method = "GET" if method == "HEAD" else method
    fitting = [(known, pattern) for known, pattern, compiled in _compile_patterns() if compiled.match(path)]
    of_method = [pattern for known, pattern in fitting if known == method]
    if of_method:
        return max(((pattern, NEEDS[method, pattern]) for pattern in of_method), key=lambda found: found[1].weight)
    if fitting:
        known, pattern = min(fitting, key=lambda found: NEEDS[found].weight)
        return pattern, NEEDS[known, pattern]
    return "", UNKNOWN if path.startswith("/api") else ANYONE  # the page's files are public


@cache
def _compile_patterns() -> tuple[tuple[str, str, re.Pattern[str]], ...]:
    return tuple((method, pattern, compile_path(pattern)[0]) for method, pattern in NEEDS)
