"""Fixtures: Node.js with the page's modules."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.page.node import Node


@pytest.fixture(scope="module")
def node(program: str) -> Iterator[Node]:
    """Yields the modules in Node.js, as in an English browser."""
    with Node(program, "en-GB") as node:
        yield node


@pytest.fixture(scope="module")
def german(program: str) -> Iterator[Node]:
    """Yields the modules in Node.js, as in a German browser."""
    with Node(program, "de-DE") as node:
        yield node
