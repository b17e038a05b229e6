"""Tests that the protocol code of the page and the add-on equals what the protocol's declarations generate."""

from __future__ import annotations

import re
from typing import Annotated, NamedTuple

import pytest

from protocol import live, viewport
from protocol.generate import LAYOUTS, generated
from protocol.layout import I64, U8, Layout
from protocol.websocket import Acknowledge, FromClient, FromService, read_client, read_service
from tests.helpers import ROOT

FIELDS = re.compile(r"^ *([uif]\d+) +([a-z_]+(?: = \d+|(?:, [a-z_]+)*))(?: {2,}.*)?$", re.MULTILINE)


def test_generated_files_are_current() -> None:
    stale = [path for path, text in generated().items() if (ROOT / path).read_text() != text]
    assert not stale, f"{stale} differ from what is declared: run `python -m protocol.generate`"


def test_documented_layouts_equal_declarations() -> None:
    """docs/live.md lists each field of the binary layouts with its type, in order: a line `u16 w, h  NOTE` for one or more."""
    lines = FIELDS.findall((ROOT / "docs" / "live.md").read_text())
    published = ", ".join(f"{kind} {name}" for kind, names in lines for name in names.split(", "))
    for layout in LAYOUTS:
        assert layout.text in published, f"docs/live.md lacks the layout of a {layout.name}: {layout.text}"


class Row(NamedTuple):
    number: Annotated[int, U8, "a number"]
    value: Annotated[int, I64, "a value"]


def test_layout_has_no_padding_and_checks_version() -> None:
    plain, marked = Layout("row", Row), Layout("row", Row, version=3, kind=7)
    assert plain.pack(Row(1, -2)) == b"\1" + (-2).to_bytes(8, "little", signed=True)
    assert [field.at for field in marked.fields] == [2, 3] and marked.size == 11
    assert marked.unpack(b"junk" + marked.pack(Row(1, -2)), 4) == Row(1, -2)
    with pytest.raises(ValueError, match="version 4 and kind 7 is no row of version 3"):
        marked.unpack(b"\4" + marked.pack(Row(1, 2))[1:])
    with pytest.raises(ValueError, match="a row of 3 bytes is cut off"):
        plain.unpack(b"123")


@pytest.mark.parametrize(
    ("message", "kinds", "text"),
    [
        (Acknowledge(5), live.FROM_CLIENT, '{"ack": 5}'),
        (live.WatchFrame(1.5, False), live.FROM_CLIENT, '{"frame": 1.5, "snapshot": false}'),
        (live.WatchFrame(2.0), live.FROM_CLIENT, '{"frame": 2.0}'),
        (live.Have([1, 2]), live.FROM_CLIENT, '{"have": [1, 2]}'),
        (viewport.Pick(3, 4), viewport.FROM_CLIENT, '{"pick": [3, 4]}'),
        (viewport.Pause(True), viewport.FROM_CLIENT, '{"paused": true}'),
        (viewport.Presence({"cursor": None}), viewport.FROM_CLIENT, '{"presence": {"cursor": null}}'),
        (viewport.Look({"id": 7, "width": 96}), viewport.FROM_CLIENT, '{"id": 7, "width": 96}'),
    ],
)
def test_client_message_round_trip(message: FromClient, kinds: tuple[type[FromClient], ...], text: str) -> None:
    assert message.to_text() == text
    assert read_client(text, kinds) == message


@pytest.mark.parametrize(
    ("message", "kinds", "text"),
    [
        (live.JobState({"id": "j"}), live.FROM_SERVICE, '{"type": "state", "job": {"id": "j"}}'),
        (live.Frames([{"number": 1}]), live.FROM_SERVICE, '{"type": "frames", "frames": [{"number": 1}]}'),
        (
            viewport.ViewState(7, 4, 256, 4.5, 0.1, False, 2, None),
            viewport.FROM_SERVICE,
            '{"type": "state", "id": 7, "samples": 4, "bound": 256, "mean": 4.5, "noise": 0.1, "done": false, "slots": 2, '
            '"message": null, "denoised": false, "denoised_samples": null, "denoises": false, "sample_s": null}',
        ),
        (viewport.Refused(None, "No."), viewport.FROM_SERVICE, '{"type": "error", "id": null, "detail": "No."}'),
        (viewport.People([{"id": 1}]), viewport.FROM_SERVICE, '{"type": "people", "people": [{"id": 1}]}'),
        (viewport.TakesChanged(3), viewport.FROM_SERVICE, '{"type": "takes", "changes": 3}'),
        (
            viewport.Picked(1, 2, [0, 0, 1], None, None, None),
            viewport.FROM_SERVICE,
            '{"type": "picked", "x": 1, "y": 2, "direction": [0, 0, 1], "depth": null, "position": null, "normal": null}',
        ),
    ],
)
def test_service_message_round_trip(message: FromService, kinds: tuple[type[FromService], ...], text: str) -> None:
    assert message.to_text() == text
    assert read_service(text, kinds) == message


def test_unknown_messages_are_ignored() -> None:
    assert read_client('{"later": 1}', live.FROM_CLIENT) is None
    assert read_service('{"type": "later"}', live.FROM_SERVICE) is None
    assert read_service('{"type": "state", "job": {}, "later": 1}', live.FROM_SERVICE) == live.JobState({})
    with pytest.raises(ValueError, match="incomplete"):
        read_service('{"type": "state"}', live.FROM_SERVICE)
    with pytest.raises(TypeError):
        read_client("[1]", live.FROM_CLIENT)
