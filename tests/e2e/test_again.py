"""Tests of a page of which a module fails to load: the page is loaded again, or else names the missing module."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Watched
from tests.service.conftest import Service


@pytest.mark.long
@pytest.mark.parametrize("module", ["shell/router", "views/workers"])
def test_failed_module_is_requested_again(many: Service, watched: Watched, module: str) -> None:
    page = watched.page
    page.route(f"**/js/{module}.js", lambda route: route.abort())
    page.goto(f"{many.url}/#/workers")
    page.wait_for_function("sessionStorage.getItem('rayfarm.again') !== null")
    page.unroute(f"**/js/{module}.js")
    expect(page.get_by_role("heading", name="Workers", exact=True)).to_be_visible(timeout=60_000)
    page.wait_for_function("sessionStorage.getItem('rayfarm.again') === null")


@pytest.mark.long
def test_missing_view_module_is_named_and_page_can_reload(many: Service, watched: Watched) -> None:
    page = watched.page
    page.goto(many.url)
    expect(page.get_by_role("heading", name="Drop a scene anywhere on this page")).to_be_visible()
    page.route("**/js/views/workers.js", lambda route: route.fulfill(status=404))
    page.route(f"{many.url}/", lambda route: route.fulfill(body="of another version"))
    page.get_by_role("link", name="Workers").click()
    expect(page.get_by_role("heading", name="Rayfarm was updated")).to_be_visible()
    expect(page.get_by_role("main")).to_be_focused()
    page.unroute_all()
    page.get_by_role("button", name="Reload the page").click()
    expect(page.get_by_role("heading", name="Workers", exact=True)).to_be_visible()
