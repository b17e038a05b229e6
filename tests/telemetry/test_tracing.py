"""Tests of tracing: no spans are made if tracing is off, and values of W3C's traceparent are valid."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from telemetry import tracing
from telemetry.tracing import SpanIds, parse_traceparent, root_span
from tests.helpers import ROOT, wait_until
from tests.rayfarm.otlp_receiver import Receiver


def run(program: str, **environment: str) -> subprocess.CompletedProcess[str]:
    env = {name: value for name, value in os.environ.items() if not name.startswith("OTEL_")} | environment
    return subprocess.run([sys.executable, "-c", program], cwd=ROOT, env=env, capture_output=True, text=True, timeout=60)


def test_unasked_nothing_is_begun_and_nothing_is_taken() -> None:
    program = """
import sys
from telemetry import tracing
tracing.start_tracing("rayfarm-worker", "w", "1")
assert not tracing.is_on() and tracing._sender is None
with tracing.span("x", tracing.root_span("job", "j")): assert tracing.current_span() is None
tracing.record_span("x", 0, 1, tracing.root_span("job", "j"))
tracing.stop_tracing()
assert not any(name.startswith("opentelemetry") for name in sys.modules)
"""
    for environment in ({}, {"OTEL_EXPORTER_OTLP_ENDPOINT": "http://127.0.0.1:9", "OTEL_SDK_DISABLED": "true"}):
        done = run(program, **environment)
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("text", [None, 7, "", "00-0-0-01", f"00-{'0' * 32}-{'1' * 16}-01", f"00-{'G' * 32}-{'1' * 16}-01"])
def test_what_is_no_traceparent_says_nothing(text: object) -> None:
    assert parse_traceparent(text) is None


def test_places_are_said_and_read_and_follow_from_ids() -> None:
    place = root_span("job", "j")
    assert parse_traceparent(str(place)) == place == root_span("job", "j") != root_span("scene", "j")
    assert parse_traceparent(f"01-{'a' * 32}-{'b' * 16}-00") == SpanIds("a" * 32, "b" * 16)


SPANS = """
import os
from telemetry import tracing
from telemetry.tracing import root_span, span
tracing.start_tracing("rayfarm-worker", "attic", "1.2")
root = root_span("job", "j")
try:
    with span("outer", root, job="j") as more:
        more["found"] = [1, 2]
        with span("inner"):
            child = os.fork()
            if child == 0:
                with span("in a fork", text="x" * 5000): os._exit(0)
            os.waitpid(child, 0)
            raise ValueError("why")
except ValueError: pass
with span("long", root, **{f"a{n}": "x" * 400 for n in range(20)}): pass
tracing.stop_tracing()
"""


def test_spans_reach_a_collector_with_their_parents_errors_and_from_forks() -> None:
    with Receiver() as receiver:
        done = run(SPANS, OTEL_EXPORTER_OTLP_ENDPOINT=receiver.url, OTEL_RESOURCE_ATTRIBUTES="studio=north")
        assert done.returncode == 0, done.stderr
        wait_until(lambda: len(receiver.spans) >= 3, 20, "they come")
    spans = {span.name: span for span in receiver.spans}
    outer, inner = spans["outer"], spans["inner"]
    root = root_span("job", "j")
    assert (outer.trace, outer.parent, outer.instance) == (root.trace, root.span, "attic")
    assert (inner.parent, inner.error) == (outer.id, "ValueError: why")
    assert outer.attributes == {"rayfarm.job": "j", "rayfarm.found": [1, 2]}
    assert outer.begun <= inner.begun <= inner.ended <= outer.ended
    assert spans["long"].attributes == {}, "more than a pipe takes at once is left out"


@pytest.mark.long
def test_a_collector_that_is_away_holds_up_nobody_and_samplers_are_obeyed() -> None:
    program = """
import time
from telemetry import tracing
tracing.start_tracing("rayfarm-worker", "w", "1")
begun = time.monotonic()
for number in range(20_000):
    with tracing.span("x", tracing.root_span("job", str(number))): pass
assert time.monotonic() - begun < 10
import sys; sys.stderr.write(str(time.monotonic() - begun))
tracing.FLUSH_S = 0.1
tracing.stop_tracing()
"""
    done = run(program, OTEL_EXPORTER_OTLP_ENDPOINT="http://127.0.0.1:9")
    assert done.returncode == 0, done.stderr
    with Receiver() as receiver:
        assert run(SPANS, OTEL_EXPORTER_OTLP_ENDPOINT=receiver.url, OTEL_TRACES_SAMPLER="always_off").returncode == 0
        assert receiver.spans == []
    assert not tracing.is_on()
