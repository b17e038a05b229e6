"""Tests that GET /api/events follows the HTML standard's event stream format, and that the page handles each event."""

from __future__ import annotations

import json
import re

from protocol.event_stream import EVENTS, JobEvent, WorkerEvent
from tests.helpers import ROOT


def test_event_has_type_and_one_data_line() -> None:
    text = JobEvent("a1", {"id": "a1", "name": "two\nlines"}).to_text()
    assert text.endswith("\n\n")
    event, data = text.rstrip("\n").split("\n")
    assert event == "event: job"
    assert json.loads(data.removeprefix("data: ")) == {"id": "a1", "name": "two\nlines"}
    assert WorkerEvent("attic", None).to_text() == 'event: worker\ndata: {"id": "attic", "deleted": true}\n\n'


def test_page_handles_every_event() -> None:
    code = (ROOT / "web/js/news/farm.js").read_text()
    handlers = re.search(r"const TAKERS = .*?\}\);", code, re.DOTALL)
    assert handlers is not None
    assert set(re.findall(r"^  (\w+):", handlers[0], re.MULTILINE)) == set(EVENTS)
