"""Tests that events are declared once: the service validates the declared fields, and workers send no others."""

from __future__ import annotations

from typing import Any, get_args

import pytest
from pydantic import BaseModel

from protocol.contract import RenderBatch
from protocol.events import EVENTS
from renderer.settings import RenderSettings, Tile, View
from service.scheduling.incoming.messages import Message
from worker.work.render import returned_event, unreadable_batch_event

MODELS: dict[str, type[BaseModel]] = {
    name: model for model in get_args(Message) for name in get_args(model.model_fields["type"].annotation)
}


def test_service_knows_all_events() -> None:
    assert MODELS.keys() == EVENTS.keys()


@pytest.mark.parametrize("name", EVENTS)
def test_event_fields_equal_validated_fields(name: str) -> None:
    declared, fields = EVENTS[name], MODELS[name].model_fields
    assert declared.__annotations__.keys() == fields.keys() - {"type"} - ({"owner"} if name == "wake" else set())
    required = {field for field, info in fields.items() if info.is_required()} - {"type"}
    assert required <= declared.__required_keys__, "the service refuses an event without it"


def test_worker_sends_declared_fields() -> None:
    worker: Any = type("Worker", (), {"name": "w"})
    settings = RenderSettings(8, 6, View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0)))
    batch = RenderBatch("b", "j", 0, "c", Tile(0, 0, 8, 6), 0, 1, settings)
    for result in (returned_event(worker, batch, "No."), unreadable_batch_event(worker, batch.to_json(), ValueError("no"))):
        declared = EVENTS[result.event["type"]]
        sent = result.event.keys() - {"type"}
        assert declared.__required_keys__ <= sent <= declared.__annotations__.keys()
