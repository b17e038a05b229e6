"""Fixtures: Node.js with the page's modules."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.page.node import Node


@pytest.fixture(scope="module")
def node(program: str) -> Iterator[Node]:
    """The modules as in a browser in English."""
    with Node(program, "en-GB") as node:
        yield node


@pytest.fixture(scope="module")
def german(program: str) -> Iterator[Node]:
    """The modules as in a browser in German."""
    with Node(program, "de-DE") as node:
        yield node
