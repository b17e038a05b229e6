"""Tests of requests for views whose camera alone has changed."""

from __future__ import annotations

from typing import Any

import pytest

from service.routes.viewport import ViewIn
from service.store.models import Scene
from service.viewing.view_request import ViewRequest, move_view, resolve_view

VIEW = {"eye": [0.0, 1.0, 5.0], "target": [0.0, 1.0, 0.0]}
CAMERAS = [{"name": "automatic", "view": VIEW}]
SCENE = Scene(id="s", status="ready", info={"cameras": CAMERAS, "defaults": {}}, compiled={"k": {"sha256": "0" * 64}}, notes=[])


def resolved(id: int, view: dict[str, Any], **more: Any) -> ViewRequest:
    asked = ViewIn.model_validate({"id": id, "width": 64, "height": 48, "draft": 0.5, "view": view, **more})
    request = asked.model_dump(mode="json", exclude={"id", "alpha", "draft"})
    return resolve_view(id, request, SCENE, asked.is_shot, asked.numbers()[0], asked.alpha, asked.draft)


def json_of(view: dict[str, Any]) -> dict[str, Any]:
    shown: dict[str, Any] = ViewIn.model_validate({"id": 1, "view": view}).model_dump(mode="json")["view"]
    return shown


@pytest.mark.parametrize(
    "more",
    (
        {"spp": 4, "noise": 0.1, "denoise": True},
        {"frame": 3.5, "fps": 30},
        {"frame": 2, "turntable": 48, "clip": "walk"},
        {"shutter": 0.5},
        {"light_paths": "on", "background": "transparent", "alpha": True},
    ),
)
def test_moved_view_is_the_resolved_one(more: dict[str, Any]) -> None:
    for view in ({**VIEW, "eye": [3.0, 2.0, 1.0]}, {**VIEW, "fov": 20.0, "up": [0.3, 1.0, 0.0]}):
        assert move_view(resolved(1, VIEW, **more), 2, json_of(view)) == resolved(2, view, **more)
