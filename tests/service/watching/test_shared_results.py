"""Tests that a result for many viewers is computed once, and cached only while it is valid."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from protocol.sums import pack_sums
from service.errors import FilmUnavailable
from service.events import Events
from service.store.films import Contribution, Film
from service.store.tile_cache import TileCache
from service.watching import shared_results
from service.watching.broadcast import Broadcast
from service.watching.shared_results import ROUND_PIXELS, SharedResults
from tests.service.peer_worker import expected_sums


def run(test: Coroutine[Any, Any, None]) -> None:
    """Runs a coroutine in a separate thread, since the main thread may already have a running event loop from browser tests."""
    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, asyncio.wait_for(test, 30)).result()


class Packing:
    """Replaces the function that packs a film's tiles: records which tiles are packed, and can block it or make it fail."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.tiles: list[int] = []
        self.go = threading.Event()
        self.begun = threading.Event()
        self.go.set()
        self.fails = False
        real = shared_results.tile_body

        def body(film: Film, frame: int, tile: int) -> tuple[int, bytes] | None:
            found = real(film, frame, tile)
            self.tiles.append(tile)
            self.begun.set()
            self.go.wait(20)
            if self.fails:
                raise FilmUnavailable("The film is locked.")
            return found

        monkeypatch.setattr(shared_results, "tile_body", body)


@pytest.fixture
def packing(monkeypatch: pytest.MonkeyPatch) -> Packing:
    return Packing(monkeypatch)


def film_in(folder: Path) -> Film:
    film = Film(folder / "job.sqlite", 64, 32, 16, 24, TileCache(1 << 20))
    film.open_file(create=True)
    return film


def render(film: Film, tile: int, first: int) -> None:
    film.merge([Contribution(0, tile, first, 1, pack_sums(expected_sums(film.tiles[tile], first, 1, 0)))])


def test_tile_is_packed_once_until_changed(tmp_path: Path, packing: Packing) -> None:
    async def test() -> None:
        film, broadcast = film_in(tmp_path), Broadcast(Events())
        broadcast.open(asyncio.get_running_loop())
        shared = SharedResults(broadcast, 1 << 20)
        for tile in (0, 1):
            render(film, tile, 0)
        with broadcast.listen("job"):
            packing.go.clear()
            asked = [asyncio.create_task(shared.tiles("job", film, 0, tiles)) for tiles in ([0, 1], [1, 0], [1, 2])]
            await asyncio.to_thread(packing.begun.wait, 20)
            asked[0].cancel()
            packing.go.set()
            second, third = await asked[1], await asked[2]
            assert [(body.tile, body.spp) for body in second + third] == [(1, 1), (0, 1), (1, 1)], "an empty tile is left out"
            assert sorted(packing.tiles) == [0, 1, 2], "also for the one that left"
            render(film, 1, 1)
            broadcast.report_tiles("job", 0, {1})
            await asyncio.sleep(0)
            (after,) = await shared.tiles("job", film, 0, [1])
            assert after.spp == 2 and after.words != second[0].words
            assert after.words == shared_results.tile_body(film, 0, 1)[1]  # type: ignore[index]
        film.close()

    run(test())


def test_tile_changed_during_packing_is_packed_again(tmp_path: Path, packing: Packing) -> None:
    async def test() -> None:
        film, broadcast = film_in(tmp_path), Broadcast(Events())
        broadcast.open(asyncio.get_running_loop())
        shared = SharedResults(broadcast, 1 << 20)
        render(film, 0, 0)
        with broadcast.listen("job"):
            packing.go.clear()
            early = asyncio.create_task(shared.tiles("job", film, 0, [0]))
            await asyncio.to_thread(packing.begun.wait, 20)
            render(film, 0, 1)
            broadcast.report_tiles("job", 0, {0})
            await asyncio.sleep(0)
            packing.go.set()
            assert [body.spp for body in await shared.tiles("job", film, 0, [0])] == [2]
            assert [body.spp for body in await early] == [1]
            assert [body.spp for body in await shared.tiles("job", film, 0, [0])] == [2], "the late one took nothing back"
        with broadcast.listen("job"):
            render(film, 0, 2)  # may be rendered while no viewer is connected
            assert [body.spp for body in await shared.tiles("job", film, 0, [0])] == [3]
        film.close()

    run(test())


def test_unreadable_film_is_retried(tmp_path: Path, packing: Packing) -> None:
    async def test() -> None:
        film, broadcast = film_in(tmp_path), Broadcast(Events())
        shared = SharedResults(broadcast, 1 << 20)
        render(film, 0, 0)
        packing.fails = True
        with broadcast.listen("job"):
            for _ in range(2):
                with pytest.raises(FilmUnavailable):
                    await shared.tiles("job", film, 0, [0])
            packing.fails = False
            assert len(await shared.tiles("job", film, 0, [0])) == 1
        film.close()

    run(test())


def test_cached_and_sent_bytes_are_limited(tmp_path: Path, packing: Packing) -> None:
    async def test() -> None:
        film, broadcast = film_in(tmp_path), Broadcast(Events())
        for tile in range(8):
            render(film, tile, 0)
        shared = SharedResults(broadcast, 2 * 4 * 16 * 16 * 4)
        with broadcast.listen("job"):
            await shared.tiles("job", film, 0, range(8))
            assert shared._bytes == 4 * 16 * 16 * 4
            await shared.tiles("job", film, 0, [7])
            assert len(packing.tiles) == 8
            await shared.tiles("job", film, 0, [0])
            assert len(packing.tiles) == 9
        large = SharedResults(broadcast, 1 << 30)
        assert large.round_pixels == ROUND_PIXELS
        with broadcast.listen("a"), broadcast.listen("a"), broadcast.listen("b"):
            few = SharedResults(broadcast, 96 << 10).round_pixels
            assert few == (48 << 10) // (3 * 16)
        film.close()

    run(test())


def test_job_state_is_computed_once_until_changed(tmp_path: Path) -> None:
    async def test() -> None:
        broadcast, made = Broadcast(Events()), []
        broadcast.open(asyncio.get_running_loop())
        shared = SharedResults(broadcast, 1 << 20)

        def make() -> int:
            made.append(0)
            return len(made)

        with broadcast.listen("job"):
            said = await asyncio.gather(*(shared.shared_result("job", "state", make) for _ in range(20)))
            assert said == [1] * 20
            broadcast.report_change("job", "job")
            await asyncio.sleep(0)
            assert await shared.shared_result("job", "state", make) == 2

    run(test())
