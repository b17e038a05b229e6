"""Fixtures: Node.js with the page's modules."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.page.node import Node


@pytest.fixture(scope="module")
def node(program: str) -> Iterator[Node]:
    """Yields the page's modules in a Node.js process whose language is English."""
    with Node(program, "en-GB") as node:
        yield node


@pytest.fixture(scope="module")
def german(program: str) -> Iterator[Node]:
    """Yields the page's modules in a Node.js process whose language is German."""
    with Node(program, "de-DE") as node:
        yield node
