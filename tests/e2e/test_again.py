"""A page of which a part did not arrive is loaded again."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Watched
from tests.service.conftest import Service

pytestmark = pytest.mark.browser


@pytest.mark.long
def test_a_module_that_did_not_arrive_is_asked_for_again(many: Service, watched: Watched) -> None:
    page = watched.page
    page.route("**/js/shell/router.js", lambda route: route.abort(), times=1)
    page.goto(f"{many.url}/#/workers")
    expect(page.get_by_role("heading", name="Workers", exact=True)).to_be_visible(timeout=60_000)
    page.wait_for_function("sessionStorage.getItem('rayfarm.again') === null")
