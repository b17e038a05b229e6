"""Machine-readable logs: each line of standard error is one JSON object, with the ids of the work in progress.

Used by the service, the workers and their libraries if RAYFARM_LOG_FORMAT is json.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import sys
import threading
import traceback
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from datetime import UTC, datetime
from types import MappingProxyType, TracebackType
from typing import Any

from renderer.printable import printable

__all__ = [
    "FORMATS",
    "FORMAT_VARIABLE",
    "LEVELS",
    "LEVEL_VARIABLE",
    "JsonLines",
    "about",
    "as_json",
    "current_ids",
    "ids",
    "level",
    "uses_json",
]

FORMAT_VARIABLE, LEVEL_VARIABLE = "RAYFARM_LOG_FORMAT", "RAYFARM_LOG_LEVEL"
FORMATS, LEVELS = ("text", "json"), ("debug", "info", "warning", "error")
MAX_TEXT_LENGTH = 20_000  # characters of a message or a trace
QUIET_LOGGERS = ("httpx", "httpcore", "alembic", "multipart", "asyncio", "opentelemetry", "urllib3", "PIL", "botocore", "boto3")

_about: ContextVar[Mapping[str, Any]] = ContextVar("about", default=MappingProxyType({}))


@contextlib.contextmanager
def about(**names: Any) -> Iterator[None]:
    """Context manager that adds ids, such as job, batch, frame, scene or worker, to this thread's log lines.

    Ids that are None are omitted.
    """
    before = _about.set({**_about.get(), **_without_none(names)})
    try:
        yield
    finally:
        _about.reset(before)


def current_ids() -> Mapping[str, Any]:
    """Returns the ids that `about` adds to this thread's log lines."""
    return _about.get()


def ids(**names: Any) -> dict[str, Any]:
    """Returns the `extra` argument that adds ids to one log line, for instance log.warning("...", extra=ids(job=job.id))."""
    return {"about": _without_none(names)}


def uses_json() -> bool:
    """Returns True if RAYFARM_LOG_FORMAT requests log lines as JSON objects."""
    return os.environ.get(FORMAT_VARIABLE, "text").strip().lower() == "json"


def level() -> int:
    """Returns the log level from the environment; INFO if it is invalid or not set."""
    name = os.environ.get(LEVEL_VARIABLE, "info").strip().lower()
    return getattr(logging, name.upper()) if name in LEVELS else logging.INFO


class JsonLines(logging.Formatter):
    """Formats log records as JSON: time (UTC), level, logger, message, process, pid, ids, and exception.

    process: `service` or `worker`.
    """

    def __init__(self, process: str) -> None:
        super().__init__()
        self.always: dict[str, Any] = {"process": process}  # added to once more is known, as the worker's name

    def format(self, record: logging.LogRecord) -> str:
        """Returns the record as a single line."""
        when = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        line: dict[str, Any] = {
            "time": when,
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": _message(record),
        }
        line |= self.always | {"pid": record.process}
        line |= {**_about.get(), **getattr(record, "about", {}), **_access_fields(record)}
        if record.exc_info and record.exc_info[1] is not None:
            line["exception"] = _exception(*record.exc_info)
        elif record.exc_text:
            line["exception"] = {"trace": record.exc_text[-MAX_TEXT_LENGTH:]}
        return printable(json.dumps(line, default=str, ensure_ascii=False))


def as_json(process: str) -> JsonLines:
    """Makes all log lines of this process JSON objects on standard error. Returns the formatter.

    Includes the lines of libraries, warnings, and uncaught exceptions. process: `service` or `worker`.
    """
    lines = JsonLines(process)
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(lines)
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level())
    for name in ("uvicorn", "uvicorn.error", "uvicorn.access"):
        each = logging.getLogger(name)
        each.handlers.clear()
        each.propagate = True
    for name in QUIET_LOGGERS:
        logging.getLogger(name).setLevel(max(level(), logging.WARNING))
    logging.captureWarnings(True)
    log = logging.getLogger(process)

    def log_fatal(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if issubclass(kind, KeyboardInterrupt):
            sys.__excepthook__(kind, error, trace)
        else:
            log.critical("ended by a fault: %s", error, exc_info=(kind, error, trace))

    def thread_ended(end: threading.ExceptHookArgs) -> None:
        if end.exc_type is not SystemExit and end.exc_value is not None:
            name = end.thread.name if end.thread else "a thread"
            log.critical(
                "%s ended by a fault: %s", name, end.exc_value, exc_info=(end.exc_type, end.exc_value, end.exc_traceback)
            )

    sys.excepthook = log_fatal
    threading.excepthook = thread_ended
    return lines


def _without_none(names: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in names.items() if value is not None}


def _message(record: logging.LogRecord) -> str:
    try:
        return record.getMessage().strip()[:MAX_TEXT_LENGTH]
    except Exception:  # its arguments do not go with its words: that must not lose the line
        return f"{record.msg} {record.args}"[:MAX_TEXT_LENGTH]


def _exception(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> dict[str, str]:
    lines = "".join(traceback.format_exception(kind, error, trace))
    return {"type": kind.__name__, "message": str(error)[:MAX_TEXT_LENGTH], "trace": lines[-MAX_TEXT_LENGTH:]}


def _access_fields(record: logging.LogRecord) -> dict[str, Any]:
    """Returns the fields of a uvicorn access log record; empty for other records."""
    if record.name != "uvicorn.access" or not isinstance(record.args, tuple) or len(record.args) != 5:
        return {}
    client, method, path, _, status = record.args
    return {"client": client, "method": method, "path": str(path).partition("?")[0], "status": status}
