"""Tracing, enabled by OTEL_EXPORTER_OTLP_ENDPOINT: spans of service and workers, propagated by W3C traceparent.

If tracing is disabled, OpenTelemetry is not imported. If it is enabled, a span is one line written to a pipe, and a separate
process (trace_sender.py) runs OpenTelemetry's exporter. The exporter may wait for its collector, which must not slow down a
batch, and it uses a thread, which a slot must not have because it forks. If the pipe is full, spans are dropped; writers never
block.

The trace ids of a job and a scene are derived from their ids, so a restart does not change them.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import json
import logging
import os
import random
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

from renderer.child_processes import spawn_guard

__all__ = [
    "HEADER",
    "SpanIds",
    "child_of",
    "current_span",
    "is_on",
    "parse_traceparent",
    "record_span",
    "root_span",
    "span",
    "start_tracing",
    "stop_tracing",
]

HEADER = "traceparent"
ENDPOINTS = ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")
PARENT = re.compile(r"[0-9a-f]{2}-([0-9a-f]{32})-([0-9a-f]{16})-[0-9a-f]{2}")
PIPE_BUF = 4096  # bytes that several processes can write at once without mixing them up
MAX_LENGTH = 500  # characters of an attribute
FLUSH_S = 5.0

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SpanIds:
    """Identity of a span: its trace id and span id, in hexadecimal."""

    trace: str
    span: str

    def __str__(self) -> str:
        """Returns the ids as a traceparent header (W3C Trace Context, level 1)."""
        return f"00-{self.trace}-{self.span}-01"


_here: ContextVar[SpanIds | None] = ContextVar("here", default=None)
_sender: subprocess.Popen[bytes] | None = None
_pipe: int | None = None


def is_on() -> bool:
    """Returns True if spans are recorded."""
    return _pipe is not None


def start_tracing(service: str, instance: str, version: str) -> None:
    """Starts recording in this process and its forks, if tracing is enabled.

    service: the kind of process. instance: name of this service or worker. version: of Rayfarm.
    """
    global _sender, _pipe
    if _pipe is not None or not _is_requested():
        return
    if not _has_packages():
        log.warning("OTEL_EXPORTER_OTLP_ENDPOINT requests traces, which need additional packages: pip install 'rayfarm[otel]'")
        return
    command = [sys.executable, "-m", "telemetry.trace_sender", service, instance, version]
    _sender = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, preexec_fn=spawn_guard())
    assert _sender.stdin is not None
    _pipe = os.dup(_sender.stdin.fileno())
    _sender.stdin.close()
    os.set_blocking(_pipe, False)


def stop_tracing() -> None:
    """Stops recording. Waits a few seconds at most for recorded spans to be sent."""
    global _sender, _pipe
    if _pipe is not None:
        os.close(_pipe)
    sender, _sender, _pipe = _sender, None, None
    if sender is not None:
        try:
            sender.wait(FLUSH_S)
        except subprocess.TimeoutExpired:
            sender.kill()
            sender.wait()


def root_span(what: str, id: str) -> SpanIds:
    """Returns the root span of a job or a scene, derived from its id. what: "job" or "scene"."""
    digest = hashlib.sha256(f"rayfarm {what} {id}".encode()).hexdigest()
    return SpanIds(digest[:32], digest[32:48])


def parse_traceparent(traceparent: Any) -> SpanIds | None:
    """Returns the ids in a traceparent header; None if it is malformed."""
    found = PARENT.fullmatch(traceparent) if isinstance(traceparent, str) else None
    if found is None or not int(found[1], 16) or not int(found[2], 16):
        return None
    return SpanIds(found[1], found[2])


def current_span() -> SpanIds | None:
    """Returns the current span of this thread; None if there is none."""
    return _here.get()


@contextlib.contextmanager
def child_of(parent: SpanIds | None) -> Iterator[None]:
    """Context manager in which `parent`, a span of another process, is this thread's current span. None: there is none."""
    before = _here.set(parent)
    try:
        yield
    finally:
        _here.reset(before)


@contextlib.contextmanager
def span(name: str, parent: SpanIds | None = None, **attributes: Any) -> Iterator[dict[str, Any]]:
    """Context manager that records a span as a child of `parent`, or else of this thread's current span.

    If there is neither, nothing is recorded. Attributes can be added to the yielded dict. An exception is recorded as the
    span's error, and propagates.
    """
    parent = parent or _here.get()
    if _pipe is None or parent is None:
        yield attributes
        return
    own, error = SpanIds(parent.trace, _new_id()), None
    before, begun = _here.set(own), time.time()
    try:
        yield attributes
    except BaseException as fault:
        error = f"{type(fault).__name__}: {fault}"
        raise
    finally:
        _here.reset(before)
        record_span(name, begun, time.time(), parent, own=own, error=error, **attributes)


def record_span(
    name: str,
    begun: float,
    ended: float,
    parent: SpanIds | None,
    *,
    own: SpanIds | None = None,
    links: Sequence[SpanIds | None] = (),
    error: str | None = None,
    **attributes: Any,
) -> None:
    """Records a span with known times. begun, ended: Unix times.

    own: the span's ids, if other spans refer to them; None: new ids. links: related spans. error: description of the failure.
    """
    if _pipe is None or (parent is None and own is None):
        return
    place = own or SpanIds(parent.trace if parent else "", _new_id())
    said: dict[str, Any] = {
        "name": name,
        "begun": begun,
        "ended": ended,
        "own": str(place),
        "error": error and error[:MAX_LENGTH],
    }
    said["parent"] = str(parent) if parent is not None else None
    said["links"] = [str(link) for link in links if link is not None][:32]
    known = {f"rayfarm.{key}": value for key, value in attributes.items() if value is not None}
    said["attributes"] = {key: value[:MAX_LENGTH] if isinstance(value, str) else value for key, value in known.items()}
    line = json.dumps(said, default=str).encode() + b"\n"
    if len(line) > PIPE_BUF:
        line = json.dumps(said | {"attributes": {}, "links": [], "error": "" if error else None}).encode() + b"\n"
    _write(line)


def _new_id() -> str:
    """Returns a random span id, without a system call, in which other threads would run. Python seeds anew after a fork."""
    return f"{random.getrandbits(64) or 1:016x}"


def _write(line: bytes) -> None:
    global _pipe
    try:
        if _pipe is not None:
            os.write(_pipe, line)
    except BlockingIOError:
        return
    except OSError:  # the sending process has ended
        _pipe = None


def _has_packages() -> bool:
    try:
        return importlib.util.find_spec("opentelemetry.exporter.otlp.proto.http") is not None
    except ModuleNotFoundError:
        return False


def _is_requested() -> bool:
    off = os.environ.get("OTEL_SDK_DISABLED", "").strip().lower() == "true"
    none = os.environ.get("OTEL_TRACES_EXPORTER", "otlp").strip().lower() == "none"
    return not off and not none and any(os.environ.get(name, "").strip() for name in ENDPOINTS)
