"""Tests that the page's decoders, generated from the protocol's declarations, decode what Python encodes."""

from __future__ import annotations

from typing import Any

import pytest

from protocol.generate import LAYOUTS
from protocol.layout import F32, Layout
from tests.page.node import Node


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.name)
def test_message_head_is_decoded_as_python_encodes_it(layout: Layout[Any], node: Node) -> None:
    """Binary message heads are decoded in Node.js as Python encoded them, with maximum values in all fields but the type."""
    row = layout.row._make(
        i + 0.5 if field.kind == F32 else (1 << int(field.kind.name[1:])) - 1 - i for i, field in enumerate(layout.fields)
    )
    name = layout.row.__name__
    body = f"return m.decode{name}(new DataView(new Uint8Array(a).buffer), 3);"
    assert node.call("base/protocol", body, [7, 7, 7, *layout.pack(row)]) == row._asdict()
    if layout.version is not None:
        refused = f"try {{ {body} }} catch (error) {{ return error.message; }}"
        assert "version 9" in node.call("base/protocol", refused, [7, 7, 7, 9, *layout.pack(row)[1:]])
