"""Tests that a browser loads the page's files once, and again only after a new release."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
import uvicorn
from playwright.sync_api import Page
from starlette.types import ASGIApp, Receive, Scope, Send

from rayfarm.local.farm import free_port
from service.pages import WebPages
from tests.e2e.conftest import Watched
from tests.e2e.site import WEB
from tests.service.conftest import until


class Served:
    """Serves the page's files as the service does, without the rest of the service; `asked` has the requested paths."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.pages: ASGIApp = WebPages(WEB)
        port = free_port("127.0.0.1")
        self.url = f"http://127.0.0.1:{port}/"
        self.server = uvicorn.Server(uvicorn.Config(self, port=port, log_level="error", lifespan="off"))
        self.thread = threading.Thread(target=self.server.run, daemon=True)
        self.thread.start()
        until(lambda: self.server.started, "the page is served")

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            self.asked.append(scope["path"])
            await self.pages({**scope, "app": self}, receive, send)

    def of_the_page(self) -> list[str]:
        """Returns and clears the recorded paths of requests, without those of the API."""
        asked, self.asked = [path for path in self.asked if not path.startswith("/api")], []
        return asked


@pytest.fixture
def served() -> Iterator[Served]:
    served = Served()
    yield served
    served.server.should_exit = True
    served.thread.join(5)


def first_paint(page: Page) -> float:
    """Returns the milliseconds from the start of the navigation to the first contentful paint."""
    page.wait_for_function("performance.getEntriesByName('first-contentful-paint').length > 0")
    return float(page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime"))


def all_is_here(page: Page) -> None:
    """Waits until the modules of all views are loaded; most are preloaded only some time after the first view is shown."""
    page.wait_for_function(
        """() => {
            const wanted = Object.values(JSON.parse(document.getElementById("view-modules").textContent)).flat();
            const here = new Set(performance.getEntriesByType("resource").map(({ name }) => new URL(name).pathname));
            return wanted.every((href) => here.has(new URL(href, location.href).pathname));
        }""",
        timeout=60_000,
    )


@pytest.mark.long
def test_second_visit_requests_only_the_index(served: Served, watched: Watched) -> None:
    page = watched.page
    page.add_init_script("performance.setResourceTimingBufferSize(1000)")
    page.goto(served.url)
    page.get_by_role("heading", name="Drop a scene").wait_for()
    all_is_here(page)
    first = served.of_the_page()
    assert len(first) > 50 and len(first) == len(set(first)), "no file is loaded twice"
    assert sorted(path for path in first if not path.startswith("/v/")) == ["/", "/fonts/inter.ttf"]
    paints = []
    for _ in range(5):
        page.reload()
        page.get_by_role("heading", name="Drop a scene").wait_for()
        assert served.of_the_page() == ["/"]
        paints.append(first_paint(page))
    print(f"first paint, warm: {sorted(paints)} ms")
    assert min(paints) < 600
