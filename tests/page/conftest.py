"""Fixtures: Node.js with the page's modules."""

from __future__ import annotations

import shutil
from collections.abc import Iterator

import pytest

from tests.page.node import Node


@pytest.fixture(scope="session")
def program() -> str:
    """Node.js; the test is skipped if there is none."""
    path = shutil.which("node")
    if path is None:
        pytest.skip("no Node.js on the PATH (Debian: apt-get install nodejs)")
    return path


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
