"""Errors as application/problem+json (RFC 9457): a title, and a detail that says what is wrong and what to do."""

from __future__ import annotations

import http
import logging
import math
from collections.abc import Mapping, Sequence
from functools import reduce
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from renderer.sentences import Sentence, joined_faults, with_full_stop
from service.errors import (
    AnswerTimeout,
    Conflict,
    Failed,
    FarmError,
    FilmDamaged,
    FilmLost,
    FilmUnavailable,
    Invalid,
    NotAllowed,
    NotFound,
    OutOfSpace,
    OverQuota,
    TooLarge,
    Unavailable,
    UnknownFormat,
)
from service.events import FilmSuspected
from service.http.methods import methods_of
from service.http.validation_messages import coded_validation_message

__all__ = ["Problem", "ProblemBody", "ProblemResponse", "install", "response", "validation_message"]

log = logging.getLogger(__name__)

STATUS: dict[type[FarmError], int] = {
    NotFound: 404,
    NotAllowed: 403,
    Conflict: 409,
    Invalid: 422,
    TooLarge: 413,
    UnknownFormat: 415,
    OutOfSpace: 507,
    OverQuota: 429,
    Unavailable: 503,
    Failed: 502,
    AnswerTimeout: 504,
    FilmUnavailable: 503,
    FilmLost: 409,
}
RETRY_AFTER_S = 2
MAX_ERRORS = 50  # errors of a body in an answer, which would otherwise echo all of it
MAX_TEXT_LENGTH = 300  # characters echoed per error
STANDARD = (400, 404, 405)  # statuses that Starlette and FastAPI answer with their own words
FASTAPI_BAD_BODY = "There was an error parsing the body"


def _standard_sentence(status: int, path: str, method: str) -> Sentence:
    match status:
        case 400:
            return Sentence(
                "request-body-unreadable",
                "The body cannot be read. Send JSON in UTF-8, nested a few levels deep, with numbers of a few digits.",
            )
        case 405:
            return Sentence(
                "method-not-allowed",
                "{method} is not possible at {path}. The API is described at /docs.",
                method=method,
                path=path,
            )
        case _:
            return Sentence("path-not-found", "There is nothing at {path}. The API is described at /docs.", path=path)


class ProblemResponse(JSONResponse):
    """A JSON response with the media type application/problem+json."""

    media_type = "application/problem+json"  # type: ignore[assignment,unused-ignore]


class Problem(Exception):  # noqa: N818 - it is what the caller gets, and named as the RFC names it
    """An error that becomes a problem response. `detail`: one sentence with the fault and its remedy; `more`: further fields."""

    def __init__(self, status: int, detail: str, headers: Mapping[str, str] | None = None, **more: Any) -> None:
        super().__init__(detail)
        self.status = status
        self.detail = detail
        self.headers = headers
        self.more = more


ProblemBody: dict[str, Any] = {
    "description": "A problem, with a sentence a person can act on",
    "content": {
        "application/problem+json": {
            "schema": {
                "type": "object",
                "required": ["title", "status", "detail"],
                "properties": {
                    "type": {"type": "string"},
                    "title": {"type": "string"},
                    "status": {"type": "integer"},
                    "detail": {"type": "string"},
                    "code": {"type": "string"},
                    "params": {"type": "object"},
                    "errors": {
                        "type": "array",
                        "items": {
                            "type": "object",
                            "properties": {
                                "field": {"type": "string"},
                                "message": {"type": "string"},
                                "code": {"type": "string"},
                                "params": {"type": "object"},
                            },
                        },
                    },
                },
            }
        }
    },
}


def response(status: int, detail: str, headers: Mapping[str, str] | None = None, **more: Any) -> ProblemResponse:
    """Returns the problem response with a status and a detail sentence."""
    if status == 503:
        headers = {"Retry-After": str(RETRY_AFTER_S), **(headers or {})}
    body = {"type": "about:blank", "title": http.HTTPStatus(status).phrase, "status": status, "detail": detail}
    body |= {**_code_fields(detail), **more}
    return ProblemResponse(body, status, headers=dict(headers or {}))


def _field_error(field: str, message: str) -> dict[str, Any]:
    return {"field": field, "message": message, **_code_fields(message)}


def _code_fields(text: str) -> dict[str, Any]:
    return text.coded if isinstance(text, Sentence) and text.code else {}


def install(app: FastAPI) -> None:
    """Installs exception handlers that convert every error of the application to a problem response."""

    @app.exception_handler(Problem)
    async def _problem(request: Request, error: Problem) -> ProblemResponse:
        return response(error.status, error.detail, error.headers, **error.more)

    @app.exception_handler(FarmError)
    async def _farm(request: Request, error: FarmError) -> ProblemResponse:
        if isinstance(error, FilmDamaged) and "id" in request.path_params:
            request.app.state.farm.events.publish(FilmSuspected(request.path_params["id"]))
        seconds = error.retry_after_s if isinstance(error, Unavailable | OverQuota) else None
        headers = {} if seconds is None else {"Retry-After": str(math.ceil(seconds))}
        more: dict[str, Any] = {}
        if isinstance(error, Invalid) and error.field is not None:
            more["errors"] = [_field_error(error.field, str(error).removesuffix("."))]
        return response(next(STATUS[kind] for kind in type(error).__mro__ if kind in STATUS), str(error), headers, **more)

    @app.exception_handler(HTTPException)
    async def _http(request: Request, error: HTTPException) -> Response:
        status, detail, headers = error.status_code, str(error.detail), error.headers
        methods = methods_of(app, request.scope) if status in (404, 405) else []
        if methods and (request.method not in methods or request.method == "OPTIONS"):
            headers = {"Allow": ", ".join(methods)}
            if request.method == "OPTIONS":
                return Response(status_code=204, headers=headers)
            status, detail = 405, http.HTTPStatus.METHOD_NOT_ALLOWED.phrase
        elif status == 405:
            status, detail = 404, http.HTTPStatus.NOT_FOUND.phrase
        if status in STANDARD and detail in (http.HTTPStatus(status).phrase, FASTAPI_BAD_BODY):
            detail = _standard_sentence(status, _shorten(request.url.path), request.method)
        return response(status, detail, headers)

    @app.exception_handler(RequestValidationError)
    async def _invalid(request: Request, error: RequestValidationError) -> ProblemResponse:
        faults = [("" if e["type"] == "json_invalid" else _field(e["loc"]), _message(e)) for e in error.errors()[:MAX_ERRORS]]
        detail = reduce(joined_faults, (_with_field(*each) for each in faults[:5]))
        return response(422, with_full_stop(detail), errors=[_field_error(*each) for each in faults])

    @app.exception_handler(ClientDisconnect)
    async def handle_disconnect(request: Request, error: ClientDisconnect) -> Response:
        return Response(status_code=400)  # never read: the client aborted the upload, which is not an error of the service

    @app.exception_handler(Exception)
    async def _fault(request: Request, error: Exception) -> ProblemResponse:
        log.exception("fault in %s %s", request.method, request.url.path, exc_info=error)
        sentence = Sentence("service-fault", "The service failed; its log has details. Try again; if it stays, report it.")
        return response(500, sentence, {"Connection": "close"})  # uvicorn closes the connection, so the client must know


JSON_OBJECT = Sentence(
    "request-body-not-object", "the body is not a JSON object; send one, with the header Content-Type: application/json"
)


def validation_message(error: Mapping[str, Any]) -> str:
    """Returns the text of a request's validation error: the name of the field and what is wrong with it."""
    field, message = _field(error["loc"]), _message(error)
    return _with_field(field, message)


def _with_field(field: str, message: str) -> str:
    return Sentence("request-field-invalid", "{field}: {fault}", field=field, fault=message) if field else message


def _field(location: Sequence[Any]) -> str:
    """Returns the name of a field from its location: `("body", "view", "eye", 0)` becomes `view.eye[0]`."""
    text = ""
    for part in location[1:] if location and location[0] in ("body", "query", "path", "header") else location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return _shorten(text)


def _message(error: Mapping[str, Any]) -> str:
    if error["type"] == "json_invalid":
        if (why := error.get("ctx", {}).get("error")) is None:
            return Sentence("request-body-malformed", "the body is not JSON; send a JSON object")
        return Sentence("request-body-not-json", "the body is not JSON ({error})", error=why)
    if error["type"] == "extra_forbidden":
        return Sentence("request-field-unknown", "there is no such field")
    if error["type"] == "model_attributes_type" or (error["type"] == "missing" and tuple(error["loc"]) == ("body",)):
        return (
            JSON_OBJECT if tuple(error["loc"]) == ("body",) else Sentence("request-value-not-object", "input should be an object")
        )
    cause = error.get("ctx", {}).get("error")
    if isinstance(cause, ValueError) and isinstance(sentence := str(cause).removesuffix("."), Sentence):
        return sentence
    if (coded := coded_validation_message(error)) is not None:
        return coded
    message = str(error["msg"]).removeprefix("Value error, ").rstrip(".")
    short = _shorten(message[:1].lower() + message[1:])
    return Sentence("request-value-invalid", "{message}", message=short, type=error["type"])


def _shorten(text: str) -> str:
    return text if len(text) <= MAX_TEXT_LENGTH else f"{text[: MAX_TEXT_LENGTH // 2]} ... {text[-MAX_TEXT_LENGTH // 2 :]}"
