"""Fixtures: Debian's Chromium, headless, with software WebGL; and pages that record their errors."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

from service.farm import Farm
from service.settings import Settings
from tests.e2e.site import Site
from tests.helpers import running_redis
from tests.many_jobs import many_jobs
from tests.service.conftest import Service

# SwiftShader draws only WebGL on the CPU; for the rest of the page it takes four times as long as the browser's own code
# (measured). The colour profile makes a screenshot's bytes equal the canvas's; other flags keep the browser from contacting its
# vendor.
FLAGS = [
    "--no-sandbox",
    "--enable-unsafe-swiftshader",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--force-color-profile=srgb",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-gpu-compositing",
    "--disable-gpu-rasterization",
    "--no-first-run",
    "--process-per-site",  # a process per page, which compiles all modules again, takes longer than most tests
]
# A live view ends at a higher noise than by default, since it occupies every slot of the farm until then.
# It is not denoised either, so that its pixels are known.
SOON_CLEAR = """try {
    localStorage['rayfarm-view-noise'] ??= '0.1';
    localStorage['rayfarm-view-denoise'] ??= 'off';
} catch { /* a page without an origin */ }"""
KEPT = "cookies,local_storage,indexeddb,cache_storage,service_workers"  # state left by an earlier page


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """Yields the system's Chromium; skips the test if there is none.

    Playwright runs an event loop until it is closed, so it must end before tests of other folders run in this process.
    """
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        pytest.skip("no Chromium on the PATH (Debian: apt-get install chromium)")
    expect.set_options(timeout=20_000)  # on a busy machine, expected changes may take more than the default 5 s
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=path, args=FLAGS)
        yield chromium
        chromium.close()


@dataclass
class Watched:
    """A browser page under test, with the errors of its console and all origins that it contacted."""

    page: Page
    errors: list[str] = field(default_factory=list)
    origins: set[str] = field(default_factory=set)


@pytest.fixture(scope="package")
def site() -> Iterator[Site]:
    """Yields a running server that has the page's files and a fixed live picture, but no farm."""
    site = Site()
    yield site
    site.server.should_exit = True
    site.thread.join(5)


@pytest.fixture(scope="package")
def profile(browser: Browser, site: Site) -> Iterator[BrowserContext]:
    """Yields a browser context whose cache already contains the page's modules.

    So not every test fetches and compiles them.
    """
    # Small and without animations: every frame is drawn by the CPU.
    context = browser.new_context(viewport={"width": 1024, "height": 640}, accept_downloads=True, reduced_motion="reduce")
    context.set_default_timeout(20_000)
    context.set_default_navigation_timeout(60_000)  # next to other tests, the first page has taken more than 20 s
    context.add_init_script(SOON_CLEAR)
    context.new_page().goto(f"{site.url}/blank")  # stays open, and keeps the process that all pages share
    yield context
    context.close()


@pytest.fixture
def watched(profile: BrowserContext) -> Iterator[Watched]:
    """Yields a new browser page, without stored state except for cached files, and records its errors and origins."""
    page = profile.new_page()
    result = Watched(page)
    page.on("console", lambda message: result.errors.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: result.errors.append(str(error)))

    def note(url: str) -> None:
        parts = urlsplit(url)
        if parts.scheme not in ("blob", "data"):
            result.origins.add(parts.netloc)

    page.on("request", lambda request: note(request.url))
    page.on("websocket", lambda socket: note(socket.url))
    yield result
    page.close()
    profile.clear_permissions()
    session = profile.new_cdp_session(profile.pages[0])
    for place in result.origins:
        session.send("Storage.clearDataForOrigin", {"origin": f"http://{place}", "storageTypes": KEPT})
    session.detach()


@pytest.fixture
def page(watched: Watched, site: Site) -> Page:
    """Opens an empty document from the page's server, in which tests can import the page's modules; returns the tab."""
    watched.page.goto(f"{site.url}/blank")
    return watched.page


@pytest.fixture(scope="package")
def many(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """Yields a service with ten thousand jobs and without workers."""
    folder = tmp_path_factory.mktemp("many")
    server = running_redis(folder)
    with server:
        data = folder / "data"
        data.mkdir()
        farm = Farm(Settings(data=data, redis_url=server.url, token="token"))
        many_jobs(farm.sessions, 10_000)
        farm.stop()
        service = Service(data, server)
        yield service
        service.stop()
