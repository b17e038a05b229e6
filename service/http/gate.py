"""Authorizes every request and WebSocket before its route is called.

Direct connections over loopback need no credentials. Other clients send a session cookie or a token (Authorization: Bearer
TOKEN). Long-lived connections are checked again every few seconds, so logging out, revoking a token or changing a role ends them.
"""

from __future__ import annotations

import logging
import math
import time
from functools import cache

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection, cookie_parser
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from renderer.sentences import Sentence
from service.access.access import Access
from service.access.projects import EVERYTHING, Kind, ProjectVisibility, read_only_project
from service.access.roles import OPEN, Caller, Role
from service.access.visit import Visit
from service.errors import FarmError, Unavailable
from service.http.access_requirements import Need, need_of, resource_of
from service.http.client_address import is_from_proxy
from service.http.hosts import LOOPBACK_NAMES, is_local_address, name_of
from service.http.problems import Problem
from service.http.security import SAFE_METHODS, send_error
from service.http.visit import VISIT, address_of, bearer_token
from service.jobs.lookup import resource_not_found

__all__ = ["LOG_IN", "AuthorizationMiddleware", "cookie_name"]

LOG_IN = Sentence(
    "login-required",
    "Log in first: on the page, or with the link that `rayfarm up` or `rayfarm user link` "
    "prints; programs send a token: Authorization: Bearer TOKEN.",
)
OWNERS = Sentence(
    "owner-token-required",
    "This needs an administrator: send the token from the file owner-token in the data folder "
    "(Authorization: Bearer TOKEN). `rayfarm user` and `rayfarm token` do so if RAYFARM_DATA "
    "names that folder.",
)
WORKERS = Sentence(
    "worker-token-required",
    "Workers need the farm's token or one of their own: Authorization: Bearer TOKEN. `rayfarm up` prints it.",
)
log = logging.getLogger(__name__)

LONG_RESPONSES = ("/api/events", "/api/jobs/{id}/frames.zip")
UPLOADS = ("/api/scenes", "/api/environments", "/api/references")  # routes whose bodies may take hours to arrive
REAUTHORIZE_EVERY_S = 5.0
LOG_IN_AGAIN = 4401  # a WebSocket's close codes
NOT_THERE = 4404
MAX_REASON_BYTES = 120
NO_LONGER_MEMBER = Sentence(
    "project-membership-ended", "You can no longer see this: you are not a member of its project any more."
)


class AuthorizationMiddleware:
    """ASGI middleware that authorizes requests, between `SecurityMiddleware` and the routes."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Identifies the caller, and calls the application if the caller is authorized; otherwise responds with an error."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        method = "WS" if scope["type"] == "websocket" else scope["method"]
        path = _path(scope)
        pattern, need = need_of(method, path)
        access: Access = scope["app"].state.farm.access
        connection = HTTPConnection(scope)
        shown = _secret_of(connection.headers, cookie_name(access, scope))
        needs_login = _needs_login(access, connection)
        try:
            caller = await _caller_of(access, shown) if shown else None
        except Unavailable as error:
            await send_error(Problem(503, str(error)), scope, receive, send)
            return
        if not needs_login and (caller is None or not need.is_met(caller)):
            caller = OPEN
        address = address_of(connection)
        thing = resource_of(pattern, path)
        try:
            sight = await _visible_projects(access, caller, needs_login)
        except Unavailable as error:
            await send_error(Problem(503, str(error)), scope, receive, send)
            return
        visit = scope[VISIT] = Visit(caller, needs_login, address, sight)
        if method != "OPTIONS" and (refusal := _access_problem(need, caller)) is not None:
            if caller is not None and caller.is_known and not caller.is_worker:
                await _record_action(access, caller, address, f"{method} {pattern}", path, refusal.status)
            await send_error(refusal, scope, receive, send)
            return
        if thing is not None and not await _may_see(access, sight, thing):
            if caller is not None and caller.is_known and method != "WS" and method not in SAFE_METHODS:
                await _record_action(access, caller, address, f"{method} {pattern}", path, 404)
            await _not_found(thing, scope, receive, send)
            return
        project = access.projects.cached_project(*thing) if thing is not None else None  # cached by the lookup above
        if need.role is not None and need.role > Role.VIEW and project is not None and not sight.changes(project):
            await send_error(Problem(403, str(read_only_project(project)), {"Connection": "close"}), scope, receive, send)
            return
        if method == "WS" or pattern in LONG_RESPONSES:
            lasting = _ReauthorizedConnection(access, shown, need, visit, thing, receive, send)
            await self._app(scope, lasting.receive, lasting.send)
        elif method in SAFE_METHODS or caller is None or not caller.is_known or caller.is_worker or not need.role:
            await self._app(scope, receive, _private_send(send) if needs_login else send)
        else:
            if pattern in UPLOADS:
                receive = _ReauthorizedConnection(access, shown, need, visit, thing, receive, send).next_upload_message
            await self._app(scope, receive, _recording_send(access, caller, address, f"{method} {pattern}", path, send))


def cookie_name(access: Access, scope: Scope) -> str:
    """Returns the name of the session cookie. Over TLS it has a prefix that prevents other hosts from setting it."""
    return f"__Host-{access.cookie}" if scope["scheme"] in ("https", "wss") else access.cookie


def _path(scope: Scope) -> str:
    """Returns the request's path as routes see it, without the application's root path."""
    path: str = scope["path"]
    root: str = scope.get("app_root_path", scope.get("root_path", ""))
    return path.removeprefix(root) if root and path.startswith(f"{root}/") else path


def _secret_of(headers: Headers, cookie: str) -> str:
    """Returns the secret in a request: its bearer token, or else its session cookie."""
    if token := bearer_token(headers):
        return token
    return cookie_parser(headers["cookie"]).get(cookie, "") if "cookie" in headers else ""


def _needs_login(access: Access, connection: HTTPConnection) -> bool:
    """Returns True if a request needs a login.

    On a service that needs no login on its own machine, these requests still do: from other machines, through a proxy, or by a
    host name other than loopback's. In a container every client has a foreign address, so only the proxy is checked there.
    """
    if access.needs_login or access.is_open:
        return access.needs_login
    if is_from_proxy(connection.scope):
        _warn_of_proxy()
        return True
    is_local = is_local_address(address_of(connection)) and name_of(connection.headers.get("host", "")) in LOOPBACK_NAMES
    return not (is_local or access.is_published)


@cache
def _warn_of_proxy() -> None:
    """Logs a warning, once, that a proxy forwards to a service that needs no login on its own machine."""
    log.warning(
        "A proxy forwards requests to this farm, which needs no login on its own machine. Forwarded requests need a login. Set "
        "RAYFARM_TRUSTED_PROXIES to the proxy's address, or RAYFARM_LOGIN=always: requests of a proxy that adds no header look "
        "like those of a person on this machine."
    )


async def _caller_of(access: Access, token: str) -> Caller | None:
    return access.cached_caller(token) or await run_in_threadpool(access.find, token)


async def _visible_projects(access: Access, caller: Caller | None, needs_login: bool) -> ProjectVisibility:
    """Returns the projects visible to a caller: all of them if the caller is local and needs no login."""
    if not needs_login and caller is not None and not caller.is_worker:
        return EVERYTHING
    known = access.projects.cached_visibility(caller)
    return await run_in_threadpool(access.projects.visibility, caller) if known is None else known


async def _may_see(access: Access, sight: ProjectVisibility, thing: tuple[Kind, str]) -> bool:
    """Returns True if an object is visible to a caller.

    Returns False also if the object does not exist, so that hidden and missing objects get the same response.
    """
    if sight.everything:
        return True
    project = access.projects.cached_project(*thing)
    if project is None:
        try:
            project = await run_in_threadpool(access.projects.project_of, *thing)
        except FarmError:
            return False  # the database is away, so its project is unknown
    return sight.is_visible(project) if project is not None else thing[0] == "environment"  # presets have no row


async def _not_found(thing: tuple[Kind, str], scope: Scope, receive: Receive, send: Send) -> None:
    """Sends the "not found" response of the object's kind, for a missing object or one in a hidden project."""
    sentence = str(resource_not_found(*thing))
    if scope["type"] == "http":
        await send_error(Problem(404, sentence), scope, receive, send)
        return
    await receive()
    await send({"type": "websocket.accept"})
    await send({"type": "websocket.close", "code": NOT_THERE, "reason": sentence[:MAX_REASON_BYTES]})


def _access_problem(need: Need, caller: Caller | None) -> Problem | None:
    if need.is_met(caller):
        return None
    challenge = {"WWW-Authenticate": "Bearer", "Connection": "close"}
    if need.role is None:
        return Problem(401, WORKERS, challenge)
    if caller is None:
        return Problem(401, LOG_IN, challenge)
    if not caller.is_known:
        return Problem(401, OWNERS, challenge)
    has = Sentence("role-worker", "worker") if caller.is_worker else caller.role.label
    return Problem(
        403,
        Sentence(
            "role-insufficient",
            "This needs the role {needed}; {name} has the role {role}. Ask the administrator of this farm.",
            needed=need.role.label,
            name=caller.name,
            role=has,
        ),
        {"Connection": "close"},
    )


async def _record_action(access: Access, caller: Caller, address: str, what: str, path: str, status: int) -> None:
    await run_in_threadpool(access.audit.add, caller.name, what, kind=caller.kind, address=address, about=path, status=status)


def _recording_send(access: Access, caller: Caller, address: str, what: str, path: str, send: Send) -> Send:
    """Wraps `send` so that the request and its status are added to the audit log."""

    async def send_and_record(message: Message) -> None:
        if message["type"] == "http.response.start":
            about = Headers(raw=message.get("headers", [])).get("location", path)
            await _record_action(access, caller, address, what, about, message["status"])
        await send(message)

    return send_and_record


def _private_send(send: Send) -> Send:
    """Wraps `send` so that cacheable responses are marked private: shared proxies then do not store them."""

    async def send_private(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            kept = headers.get("cache-control", "")
            if "max-age" in kept and "public" not in kept and "private" not in kept:
                headers["Cache-Control"] = f"private, {kept}"
        await send(message)

    return send_private


class _ReauthorizedConnection:
    """A WebSocket, streaming response or upload that ends once its caller is no longer authorized."""

    def __init__(
        self,
        access: Access,
        token: str,
        need: Need,
        visit: Visit,
        thing: tuple[Kind, str] | None,
        receive: Receive,
        send: Send,
    ) -> None:
        self._access, self._shown, self._need, self._thing = access, token, need, thing
        self._receive, self._send = receive, send
        self._needs_login, self._saw_everything = visit.needs_login, visit.sight.everything
        self._reauthorizes = visit.caller is not None and visit.caller.is_known
        self._last_authorized = time.monotonic()
        self._is_over = False
        self._why = (
            LOG_IN_AGAIN,
            Sentence("login-expired", "You are logged out. Log in again."),
        )  # close code and reason of a WebSocket

    async def receive(self) -> Message:
        """Returns the next message from the client, or a disconnect message once the caller is no longer authorized."""
        message = await self._receive()
        if message["type"] == "websocket.receive" and not await self._is_still_authorized():
            await self._disconnect("websocket")
        if self._is_over and message["type"] == "websocket.receive":
            return {"type": "websocket.disconnect", "code": self._why[0]}
        return message

    async def next_upload_message(self) -> Message:
        """Returns the next part of an upload. Raises Problem once the caller is no longer authorized."""
        message = await self._receive()
        if message["type"] == "http.request" and not message.get("more_body"):
            self._last_authorized = -math.inf  # checks again before the upload is stored
        if message["type"] == "http.request" and not await self._is_still_authorized():
            raise Problem(401, LOG_IN, {"Connection": "close"})
        return message

    async def send(self, message: Message) -> None:
        """Sends a message to the client; ends the connection instead if the caller is no longer authorized."""
        if message["type"] in ("websocket.send", "http.response.body") and not await self._is_still_authorized():
            await self._disconnect(message["type"].partition(".")[0])
        elif not self._is_over:
            await self._send(message)

    async def _disconnect(self, kind: str) -> None:
        if self._is_over:
            return
        self._is_over = True
        if kind == "websocket":
            code, reason = self._why
            await self._send({"type": "websocket.close", "code": code, "reason": reason})
        else:
            await self._send({"type": "http.response.body", "body": b"", "more_body": False})

    async def _is_still_authorized(self) -> bool:
        if self._is_over:
            return False
        if not self._reauthorizes or time.monotonic() - self._last_authorized < REAUTHORIZE_EVERY_S:
            return True
        self._last_authorized = time.monotonic()
        try:
            caller = await _caller_of(self._access, self._shown)
            if not self._need.is_met(caller):
                return False
            sight = await _visible_projects(self._access, caller, self._needs_login)
            if self._saw_everything and not sight.everything:
                return False
            if self._thing is None or await _may_see(self._access, sight, self._thing):
                return True
            self._why = NOT_THERE, NO_LONGER_MEMBER
            return False
        except FarmError:
            return True  # an unreachable database revokes nothing
