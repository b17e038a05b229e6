"""`python -m telemetry.trace_sender SERVICE INSTANCE VERSION`: reads one span per line from stdin and sends it to a collector.

It uses OpenTelemetry's exporter (OTLP over HTTP), batching and samplers, and so supports all of their environment variables. It
exits at the end of its input.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from typing import Any

from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
from opentelemetry.sdk.resources import Resource
from opentelemetry.sdk.trace import ReadableSpan, TracerProvider
from opentelemetry.sdk.trace.export import BatchSpanProcessor
from opentelemetry.sdk.trace.sampling import Decision
from opentelemetry.sdk.util.instrumentation import InstrumentationScope
from opentelemetry.trace import Link, SpanContext, SpanKind, Status, StatusCode, TraceFlags

from telemetry.log_lines import as_json, uses_json
from telemetry.tracing import SpanIds, parse_traceparent

__all__ = ["main", "read_span"]


def main() -> int:
    """Sends spans until the input ends, then those not sent yet. Returns the exit code."""
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, signal.SIG_IGN)  # the writing process decides when to end
    service, instance, version = sys.argv[1:4]
    if uses_json():
        as_json(service.removeprefix("rayfarm-"))
    attributes = {"service.name": os.environ.get("OTEL_SERVICE_NAME") or service}
    resource = Resource.create(attributes | {"service.version": version, "service.instance.id": instance})
    scope = InstrumentationScope("rayfarm", version)
    provider = TracerProvider(resource=resource)
    processor = BatchSpanProcessor(OTLPSpanExporter())
    for line in sys.stdin.buffer:
        try:
            span = read_span(json.loads(line), resource, scope)
        except (ValueError, KeyError, TypeError):
            continue
        # By the trace's number alone, so that all processes agree without asking each other.
        decision = (
            provider.sampler.should_sample(None, span.context.trace_id, span.name).decision if span.context else Decision.DROP
        )
        if decision is Decision.RECORD_AND_SAMPLE:
            processor.on_end(span)
    processor.shutdown()
    provider.shutdown()
    return 0


def read_span(data: dict[str, Any], resource: Resource, scope: InstrumentationScope) -> ReadableSpan:
    """Converts a line's JSON object to a span. Raises ValueError, KeyError or TypeError if it is malformed.

    resource: the process that recorded the span. scope: the library that recorded it.
    """
    error = data.get("error")
    return ReadableSpan(
        data["name"],
        context=_span_context(parse_traceparent(data["own"])),
        parent=_span_context(parse_traceparent(data["parent"])) if data.get("parent") else None,
        resource=resource,
        attributes=data["attributes"],
        links=[Link(_span_context(parse_traceparent(link))) for link in data["links"]],
        kind=SpanKind.INTERNAL,
        status=Status(StatusCode.ERROR, error) if error is not None else Status(StatusCode.UNSET),
        start_time=round(data["begun"] * 1e9),
        end_time=round(data["ended"] * 1e9),
        instrumentation_scope=scope,
    )


def _span_context(place: SpanIds | None) -> SpanContext:
    if place is None:
        raise ValueError("no place of a span")
    return SpanContext(int(place.trace, 16), int(place.span, 16), is_remote=False, trace_flags=TraceFlags(TraceFlags.SAMPLED))


if __name__ == "__main__":
    sys.exit(main())
