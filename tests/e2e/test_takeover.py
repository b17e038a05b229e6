"""Tests of a browser that watches a job while the farm's owner is killed, and another service takes over."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Page, WebSocket, expect

from tests.e2e.conftest import Watched
from tests.helpers import running_redis
from tests.service.conftest import TOKEN, until
from tests.service.ownership.test_two_services import Started, start_slow_job, states_and_logs
from tests.service.peer_worker import PeerWorker


@pytest.mark.long
def test_picture_continues_after_takeover(tmp_path: Path, watched: Watched) -> None:
    page = watched.page
    tiles: list[WebSocket] = []  # the connection of each tile packet
    page.on("websocket", lambda socket: socket.on("framereceived", lambda said: isinstance(said, bytes) and tiles.append(socket)))
    redis = running_redis(tmp_path)
    redis.start()
    both = [Started(tmp_path / "data", name, redis_url=redis.url) for name in ("one", "other")]
    try:
        until(
            lambda: sorted(each.says() for each in both) == ["ready", "stands by"],
            "both are there",
            90,
            lambda: states_and_logs(both),
        )
        owner, other = sorted(both, key=Started.says)
        with PeerWorker(redis.url, other.url, TOKEN) as worker:
            job = start_slow_job(other, worker)
            page.goto(f"{other.url}/#/jobs/{job}")  # the standby forwards requests
            page.evaluate("window.isStillHere = true")
            until(lambda: shown_samples(page) > 0 and tiles, "there is something to see", 60, lambda: states_and_logs(both))
            first = tiles[0]
            owner.process.kill()
            owner.process.wait()
            until(other.is_ready, "the other has taken over", 60, lambda: states_and_logs(both))
            before = int(other.job(job)["samples"]) // (64 * 48)
            until(
                lambda: shown_samples(page) > before,
                "the numbers go on",
                60,
                lambda: (shown_samples(page), states_and_logs(both)),
            )
            until(
                lambda: shown_samples(page) > 0 and tiles[-1] is not first,
                "the picture goes on",
                60,
                lambda: states_and_logs(both),
            )
            expect(page.get_by_text("Connection lost")).to_be_hidden()
            assert page.evaluate("window.isStillHere"), "nobody has loaded it again"
            other.http.patch(f"/api/jobs/{job}", json={"state": "cancelled"})  # refused if the job has ended by itself
            expect(page.locator(".job-head .chip:not(.verdict)")).to_have_text("Cancelled")
    finally:
        for each in both:
            each.end()
        redis.stop()


def shown_samples(page: Page) -> int:
    """Returns the samples per pixel shown on the page."""
    found = page.locator(".side .big.number").text_content()
    return int((found or "0").replace(",", ""))
