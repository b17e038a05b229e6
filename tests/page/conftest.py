"""Fixtures: Node.js with the page's modules."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.page.node import Node


@pytest.fixture(scope="module")
def node(program: str) -> Iterator[Node]:
    """Yields a Node.js process, set to English, that can call functions of the page's modules."""
    with Node(program, "en-GB") as node:
        yield node


@pytest.fixture(scope="module")
def german(program: str) -> Iterator[Node]:
    """Yields a Node.js process, set to German, that can call functions of the page's modules."""
    with Node(program, "de-DE") as node:
        yield node
