"""Tests of live views of a scene: a real worker's pictures arrive over the WebSocket, and a closed view leaves nothing behind."""

from __future__ import annotations

import base64
import io
import math
import struct
import threading
import time
import zlib

import numpy as np
import pytest
from PIL import Image
from websockets.exceptions import ConnectionClosed

from protocol.view_parts import CLEAN_GUIDE_SAMPLES, VIEW_ANSWERS, Part, ViewDenoise, ViewFrame, ViewParts, view_key, view_queue
from renderer import film as film_math
from renderer.image import rgbe9995
from renderer.settings import Tile
from service.access.rate_limit import RateLimit
from service.scenes import takes
from service.scheduling.records import Records
from service.viewing import memory_limit, view_cards
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_sums
from tests.service.viewer import look


def remains_of_views(service: Service) -> list[str]:
    """Returns what closed views failed to remove: Redis keys, film files, and ids of jobs."""
    redis = service.farm.views._redis
    keys = [key.decode() for key in redis.scan_iter("rayfarm*view*")]
    films = [str(path) for path in (service.options["data"] / "films").iterdir()]
    return keys + films + [job["id"] for job in service.http.get("/api/jobs").json()]


def blobs(service: Service) -> set[str]:
    return {path.name for path in (service.options["data"] / "blobs").rglob("*") if path.is_file()}


def test_view_starts_small_and_ends_exact(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    before = blobs(service)
    with look(service, scene) as viewer:
        viewer.show(7, spp=16, seed=3)
        viewer.wait(7, 16)
        np.testing.assert_array_equal(
            viewer.words, rgbe9995.pack(film_math.mean(expected_sums(Tile(0, 0, 96, 64), 0, 16, 3), 24)), "sums added once each"
        )
        until(lambda: (viewer.read(), viewer.states[-1]["samples"] == 16)[1], "the state says so")
        told = {"id": 7, "samples": 16, "bound": 16, "mean": 16, "done": True, "slots": 2, "message": None}
        assert {name: viewer.states[-1][name] for name in told} == told
        # The worker takes 10 us per sample of a pixel, so the next view is too large for one complete picture.
        viewer.show(8, view={"eye": [1, 2, 3], "target": [0, 0, 0]}, max_depth=11)
        viewer.wait(8, 1)
        settings = worker.parts[-1][0].settings
        assert (settings.max_depth, settings.view.eye) == (11, (1.0, 2.0, 3.0))
    until(lambda: not remains_of_views(service), "nothing is left", say=lambda: remains_of_views(service))
    assert blobs(service) == before


def test_view_is_denoised_although_a_worker_asks_at_once_or_has_failed_before(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The picture is there before the message is sent: an answer without it would end the denoising of the view."""
    views = service.farm.views
    send, is_there, failures = views._dispatcher.send_view, [], [ValueError("the machine is busy")]

    def asking(work: ViewParts | ViewFrame | ViewDenoise, queue: str) -> None:
        if isinstance(work, ViewDenoise):
            is_there.append(views.means(work.message) is not None)
        send(work, queue)

    def fail_once(watch: str) -> None:
        if failures:
            raise failures.pop()

    monkeypatch.setattr(views._dispatcher, "send_view", asking)
    with service.worker(denoises=True) as worker, look(service, service.ready_scene()) as viewer:
        worker.on_denoise = fail_once
        viewer.show(1, spp=4, denoise=True)
        until(lambda: (viewer.read(), bool(viewer.states) and viewer.states[-1]["denoised"])[1], "it is denoised")
    assert not failures and len(is_there) > 1 and all(is_there)
    assert all(state["denoises"] for state in viewer.states if state["id"] == 1 and state["samples"])


@pytest.mark.long
def test_view_is_denoised_and_then_never_noisy(service: Service) -> None:
    """The last picture is the denoised one of all samples; after the first, no other is sent. A failure shows the noise again."""

    def clean(samples: int) -> np.ndarray:
        sums = expected_sums(Tile(0, 0, 96, 64), 0, samples, 3)
        guides = expected_sums(Tile(0, 0, 96, 64), 0, min(samples, CLEAN_GUIDE_SAMPLES), 3)
        albedo, normal = (film_math.mean(guides, 24, planes) for planes in (film_math.ALBEDO, film_math.NORMAL))
        return rgbe9995.unpack(rgbe9995.pack(film_math.mean(sums, 24) / 2 + albedo + normal))

    with service.worker(denoises=True) as worker, look(service, service.ready_scene()) as viewer:
        viewer.show(1, spp=32, seed=3, denoise=True)
        until(lambda: (viewer.read(), bool(viewer.states) and viewer.states[-1]["denoised"])[1], "it is denoised")
        assert viewer.is_exact.all(), "coarse brightness would show its steps"
        is_last = lambda: (viewer.read(), np.allclose(rgbe9995.unpack(viewer.words), clean(32), rtol=0.01, atol=0.01))[1]  # noqa: E731
        until(is_last, "it has all samples")
        assert 1 <= len(worker.denoised) <= 7, "at doubled samples, and at the end"
        until(lambda: (viewer.read(), viewer.states[-1]["denoised_samples"] == 32)[1], "the state says of how many samples it is")
        viewer.show(2, spp=32, seed=3)
        until(lambda: (viewer.read(), viewer.pictures[-1][0] == 2 and viewer.is_exact.all())[1], "it is not denoised")
        np.testing.assert_array_equal(
            viewer.words, rgbe9995.pack(film_math.mean(expected_sums(Tile(0, 0, 96, 64), 0, 32, 3), 24))
        )

        def fail(watch: str) -> None:
            raise ValueError("it has no memory")

        worker.on_denoise = fail
        viewer.show(3, spp=32, seed=3, denoise=True)
        until(lambda: (viewer.read(), viewer.pictures[-1][0] == 3 and viewer.is_exact.all())[1], "it is shown with its noise")
        # Pictures may come before the first state of their request, while the last state is that of the request before.
        until(lambda: (viewer.read(), (viewer.states[-1]["id"], viewer.states[-1]["done"]) == (3, True))[1], "it is done")
        assert (viewer.states[-1]["denoised"], viewer.errors) == (False, [])


@pytest.mark.long
def test_view_ends_at_target_noise(service: Service, worker: PeerWorker) -> None:
    with look(service, service.ready_scene()) as viewer:
        viewer.show(1, noise=0.06, seed=3)  # evenly distributed samples: 0.577 / sqrt(n)
        until(lambda: (viewer.read(), bool(viewer.states) and viewer.states[-1]["done"])[1], "it is done")
        told = viewer.states[-1]
        assert (told["samples"], told["mean"], told["bound"]) == (128, 128, 256)
        assert 0.04 < told["noise"] < 0.06
        viewer.wait(1, 128)
        until(lambda: (viewer.read(), viewer.is_exact.all())[1], "it is exact")
        np.testing.assert_array_equal(
            viewer.words, rgbe9995.pack(film_math.mean(expected_sums(Tile(0, 0, 96, 64), 0, 128, 3), 24))
        )
        assert not service.farm.views.has_unfinished()
        viewer.show(2, noise=-1)
        until(lambda: (viewer.read(), bool(viewer.errors))[1], "the error comes")
        assert "noise" in viewer.errors[0]["detail"]


@pytest.mark.long
def test_first_picture_size_follows_farm_speed(service: Service, worker: PeerWorker) -> None:
    with look(service, service.ready_scene()) as viewer:
        viewer.show(1, spp=1)
        viewer.wait(1, 1)
        viewer.show(2, spp=1, width=480, height=320)
        until(lambda: (viewer.read(), viewer.pictures[-1] == (2, (480, 320)))[1], "the whole view comes")
    sizes = [size for id, size in viewer.pictures if id == 2]
    width, height = sizes[0]
    assert 2 * 0.02 < 1e-5 * width * height < 2 * 0.06, "seconds of two slots"
    assert width / height == pytest.approx(1.5, rel=0.05)
    assert sizes == sorted(sizes)


@pytest.mark.long
def test_newer_view_replaces_older_one(service: Service, worker: PeerWorker) -> None:
    def slow(work: ViewParts, part: Part) -> None:
        time.sleep(0.02)

    worker.on_part = slow
    with look(service, service.ready_scene()) as viewer:
        viewer.show(1)
        viewer.wait(1, 1)
        viewer.show(2, seed=5)
        viewer.wait(2, 1)
        rendered = [work.settings.seed for work, _ in worker.parts]
        switch = rendered.index(5)
        assert set(rendered[switch:]) == {5}, "what was handed out for the first view is dropped"
        ids = [id for id, _ in viewer.pictures]
        assert ids == sorted(ids)


@pytest.mark.long
def test_slow_viewer_gets_fewer_pictures(service: Service, worker: PeerWorker) -> None:
    with look(service, service.ready_scene()) as viewer:
        viewer.acknowledges = False
        viewer.show(1, spp=64)
        until(lambda: (viewer.read(), bool(viewer.states) and viewer.states[-1]["samples"] == 64)[1], "all is rendered")
        viewer.read(0.3)
        assert len(viewer.pictures) <= 2
        viewer.acknowledges = True
        viewer.say(ack=viewer.seq)
        viewer.wait(1, 64)


@pytest.mark.long
def test_invalid_view_requests_give_error(service: Service, worker: PeerWorker) -> None:
    with look(service, service.ready_scene()) as viewer:
        viewer.connection.send("what?")
        viewer.say(id=1, width=0)
        viewer.say(id=2, widht=3)
        viewer.say(id=3, camera="nobody's")
        until(lambda: (viewer.read(), len(viewer.errors) == 4)[1], "each is answered", say=lambda: viewer.errors)
        viewer.say(id=4, width=16000, height=16000)
        viewer.say(pick=["x"])
        viewer.connection.send('{"pick": [1e999, 0]}')
        viewer.connection.send(b"\0\1")
        until(lambda: (viewer.read(), len(viewer.errors) >= 8)[1], "all are answered", say=lambda: viewer.errors)
        details = " ".join(error["detail"] for error in viewer.errors)
        assert all(error["detail"].endswith(".") for error in viewer.errors)
        assert (
            'The message is invalid. Send a view, {"pick": [x, y]}, {"ack": seq} or {"paused": true}, as a JSON object of at most'
            in details
        )
        assert "unpack" not in details
        assert "width" in details
        assert "widht: there is no such field" in details
        assert "nobody's" in details
        viewer.show(5, spp=2)
        viewer.wait(5, 2)
    with look(service, "there-is-none") as viewer, pytest.raises(ConnectionClosed, match="no scene"):
        viewer.connection.recv(timeout=5)


def test_failed_view_is_reported_and_next_is_rendered(service: Service, worker: PeerWorker) -> None:
    def fail(work: ViewParts, part: Part) -> None:
        if work.settings.seed == 13:
            raise ValueError("The renderer does not like 13.")

    worker.on_part = fail
    with look(service, service.ready_scene()) as viewer:
        viewer.show(1, seed=13)
        until(lambda: (viewer.read(), bool(viewer.errors))[1], "the error comes")
        assert viewer.errors == [{"id": 1, "detail": "The renderer does not like 13."}]
        viewer.show(2, spp=2)
        viewer.wait(2, 2)


@pytest.mark.long
def test_parts_of_lost_worker_are_rendered_again(service: Service) -> None:
    with service.worker(name="first") as first:
        scene = service.ready_scene()
        with look(service, scene) as viewer:
            first.on_part = lambda work, part: False if len(first.parts) > 6 else None
            viewer.show(1, spp=8)
            until(lambda: (viewer.read(), len(first.parts) > 6)[1], "it has begun")
            first.stop()
            until(
                lambda: (viewer.read(), "worker" in (viewer.states[-1]["message"] or ""))[1],
                "the state says so",
                say=lambda: viewer.states[-3:],
            )
            with service.worker(name="second"):
                viewer.wait(1, 8)
            expected = film_math.mean(expected_sums(Tile(0, 0, 96, 64), 0, 8, 0), 24)
            np.testing.assert_array_equal(viewer.words, rgbe9995.pack(expected))


def makes_drafts(service: Service) -> bool:
    """Returns True if the service knows a card that makes drafts."""
    return any(report.drafts_views for report in service.farm.views._cards.accepting("test-kind"))


@pytest.mark.long
@pytest.mark.parametrize("trouble", ("none", "loads", "cannot", "dies"))
def test_cards_draft_a_view_while_it_moves(service: Service, worker: PeerWorker, trouble: str) -> None:
    """Each view begins with a draft, unless the card does not make it; the view that stays becomes exact."""
    declined: list[int] = []

    def decline(work: ViewParts) -> dict[str, object] | None:
        if work.draft is None or trouble in ("none", "dies"):
            return None
        declined.append(work.view)
        return {"error": "The scene does not fit."} if trouble == "cannot" else {"is_loading": True}

    with service.worker(name="card", slots=1, has_cards=True, views=False, denoises=False) as card:
        card.drafts, card.on_view = True, decline
        card.report()
        card.on_part = lambda work, part: False if trouble == "dies" and work.draft is not None else None
        with look(service, service.ready_scene()) as viewer:
            until(lambda: makes_drafts(service), "the card is known")
            viewer.show(1, spp=2)
            viewer.wait(1, 2)
            assert not viewer.drafts, "a view that requests no draft gets none"
            for id in range(2, 5):
                viewer.show(id, spp=32, seed=3, draft=1.5)
                if trouble == "none":
                    has_come = lambda count=id - 1: (viewer.read(0.01), len(viewer.drafts) == count)[1]  # noqa: E731
                    until(has_come, f"view {id} has a draft")
            viewer.wait(4, 32)
            if trouble == "none":
                sizes = [(48, 32, 1), (96, 64, 4), (96, 64, 4)]  # the first by the speed of pieces
                for id, (width, height, samples), (head, jpeg) in zip((2, 3, 4), sizes, viewer.drafts, strict=True):
                    assert head._replace(seq=0) == (id, 0, width, height, 96, 64, samples, 1.5)
                    assert jpeg == card.draft_jpeg
                parts = [part for work, part in card.parts if work.draft is not None]
                assert parts == [Part(0, Tile(0, 0, width, height), 0, samples) for width, height, samples in sizes]
                assert {size for id, size in viewer.pictures if id > 1} == {(96, 64)}, "no small picture follows a draft"
            else:
                assert not viewer.drafts
                assert trouble != "cannot" or len(declined) == 1, "a card that cannot render the view makes no further draft"
            expected = film_math.mean(expected_sums(Tile(0, 0, 96, 64), 0, 32, 3), 24)
            np.testing.assert_array_equal(viewer.words, rgbe9995.pack(expected))
            assert not viewer.errors


@pytest.mark.long
def test_denoised_view_has_drafts_while_it_moves_and_is_denoised_at_rest(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Drafts are smoothed; nothing with noise follows them. A viewer that acknowledges late gets the latest draft next."""
    monkeypatch.setattr(view_cards, "START_TIMEOUT_S", 10.0)  # or a busy machine's card is taken to be busy, too
    with (
        service.worker(denoises=True) as worker,
        service.worker(name="card", slots=1, has_cards=True, views=False, denoises=False) as card,
        look(service, service.ready_scene()) as viewer,
    ):
        card.drafts = True
        card.report()
        until(lambda: makes_drafts(service), "the card is known")
        viewer.show(1, spp=2)
        viewer.wait(1, 2)  # the card has rendered the scene
        viewer.begin_again()
        for id in range(2, 6):
            viewer.show(id, spp=8, denoise=True, draft=0.0)
            has_come = lambda count=id - 1: (viewer.read(0.01), len(viewer.drafts) == count)[1]  # noqa: E731
            until(has_come, f"view {id} has a draft")
        assert all(work.is_smooth for work, _ in card.parts if work.draft is not None)
        until(lambda: (viewer.read(), viewer.states[-1]["denoised"] and viewer.states[-1]["done"])[1], "it is denoised")
        assert worker.denoised
        assert {id for id, _ in viewer.pictures if id > 1} == {5}, "only the view that stays is rendered further"
        assert viewer.is_exact.all() and viewer.samples.min() >= 4, "no noise, and no fewer samples than the draft"
        viewer.acknowledges = False
        drafted = lambda: len([work for work, _ in card.parts if work.draft is not None])  # noqa: E731
        for id in range(6, 12):
            before = drafted()
            viewer.show(id, spp=8, denoise=True, draft=0.0)
            until(lambda before=before: (viewer.read(0.01), drafted() > before)[1], f"view {id} is drafted")
        viewer.read(0.2)
        heads = [head for head, _ in viewer.drafts if head.id > 5]
        assert [head.id for head in heads] == [6, 7], "two are not acknowledged"
        viewer.say(ack=heads[-1].seq)
        until(lambda: (viewer.read(0.01), viewer.drafts[-1][0].id == 11)[1], "the latest follows")
        assert len(viewer.drafts) == 4 + 3


@pytest.mark.long
@pytest.mark.parametrize("trouble", ("none", "loads", "cannot", "busy", "dies"))
def test_cards_take_pieces_first_and_lose_none(service: Service, worker: PeerWorker, trouble: str) -> None:
    """A card's worker beside the cores: each picture is exact, whatever the card does with its messages."""
    died: list[int] = []

    def decline(work: ViewParts) -> dict[str, object] | None:
        died.append(len(work.parts))
        if trouble == "cannot":
            return {"error": "The scene does not fit."}
        return {"is_loading": True} if trouble == "loads" and len(died) == 1 else None

    def end(work: ViewParts, part: Part) -> bool | None:
        return False if trouble == "dies" and len(card.parts) > 5 else None

    card = service.worker(name="card", slots=1, has_cards=True, views=False, denoises=False)
    card.on_view, card.on_part, card.is_fetching = decline, end, trouble != "busy"  # before it begins to fetch
    with card:
        worker.on_part = lambda work, part: time.sleep(0.001)
        with look(service, service.ready_scene()) as viewer:
            until(lambda: service.farm.views._cards.accepting("test-kind"), "the card is known")
            for id in (1, 2):
                begun = time.monotonic()
                viewer.show(id, spp=32, seed=3)
                if trouble == "dies":
                    until(lambda: (viewer.read(), len(card.parts) > 5)[1], "the card has begun")
                    card.stop()
                viewer.wait(id, 32)
                assert trouble != "busy" or time.monotonic() - begun < 10, "it does not wait for the card"
                np.testing.assert_array_equal(
                    viewer.words, rgbe9995.pack(film_math.mean(expected_sums(Tile(0, 0, 96, 64), 0, 32, 3), 24))
                )
                if trouble == "dies":
                    break
        counts = {"cannot": [16], "busy": []}
        assert died == counts.get(trouble, died), "a refused view is not sent again"
        assert bool(card.parts) == (trouble not in ("cannot", "busy"))
        assert worker.parts
        until(lambda: not remains_of_views(service), "nothing is left", say=lambda: remains_of_views(service))


@pytest.mark.long
def test_viewers_share_slots_and_hidden_page_uses_none(service: Service, worker: PeerWorker) -> None:
    worker.on_part = lambda work, part: time.sleep(0.002)
    scene = service.ready_scene()
    with look(service, scene) as one, look(service, scene) as other:
        one.show(1, seed=1)
        other.show(1, seed=2)
        one.wait(1, 4)
        other.wait(1, 4)
        seeds = [work.settings.seed for work, _ in worker.parts]
        share = seeds.count(1) / len(seeds)
        assert 0.25 < share < 0.75
        other.say(paused=True)
        time.sleep(0.3)
        begun = len(worker.parts)
        until(lambda: (one.read(), len(worker.parts) > begun + 10)[1], "the other goes on")
        assert {work.settings.seed for work, _ in worker.parts[begun:]} == {1}
        one.say(paused=True)
        until(lambda: not service.farm.views._out, "nothing is handed out")
        redis = service.farm.views._redis
        redis.delete(view_key(next(each.id for each in service.farm.views._sessions.values() if each.is_paused)))
        worker.unwanted.clear()
        other.say(paused=False)
        other.wait(1, 8)
        assert not worker.unwanted, "its key expired meanwhile, and is renewed before anything is handed out"


def test_first_picture_of_a_page_precedes_other_views(service: Service, worker: PeerWorker) -> None:
    begun: list[tuple[int, str, float]] = []
    rest = threading.Event()

    def on_part(work: ViewParts, part: Part) -> None:
        begun.append((work.settings.seed, work.message, time.monotonic()))
        if rest.is_set():
            time.sleep(0.3)

    worker.on_part = on_part
    scene = service.ready_scene()
    with look(service, scene) as one, look(service, scene) as other:
        one.show(1, seed=1, spp=4096)
        one.wait(1, 1)
        rest.set()
        time.sleep(0.4)  # each slot has a message, and another one waits for it
        other.show(1, seed=2, spp=4096)
        until(lambda: (other.read(), other.pictures)[1], "the other page has a picture")
        (session,) = [each for each in service.farm.views.sessions() if each.request and each.request.settings.seed == 2]
        first = next(at for seed, _, at in begun if seed == 2)
        earlier = {message for _, message, at in begun if at < session.begun}
        later = {message for seed, message, at in begun if seed == 1 and session.begun < at < first} - earlier
        assert not later, "messages that waited are taken back"
        rest.clear()
        count = len(begun)
        until(lambda: (one.read(), other.read(), {1, 2} <= {seed for seed, *_ in begun[count:]})[2], "both go on")


def test_views_precede_batches_and_end_with_page(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    scene = service.ready_scene()
    job = service.submit(scene, spp=4000, width=256, height=256)
    service.wait_for(job, "running")
    with look(service, scene) as viewer:
        viewer.show(1, spp=256)
        viewer.wait(1, 1)
        (watch,) = service.farm.views._sessions.values()
        assert watch.pixels == 96 * 64
        worker.on_part = lambda work, part: time.sleep(0.05)
        viewer.connection.socket.close()  # without a closing handshake, like a killed browser
    service.http.delete(f"/api/jobs/{job}").raise_for_status()
    until(lambda: not remains_of_views(service), "nothing is left", say=lambda: remains_of_views(service))
    assert service.farm.views._sessions == {}
    assert watch.pixels == 0 and not watch._canvases, "not even in memory"


@pytest.mark.long
def test_complete_view_shares_slots(service: Service) -> None:
    with service.worker(slots=1) as worker:
        scene = service.ready_scene()
        with look(service, scene) as viewer:
            viewer.show(1, spp=256, width=384, height=256)
            until(lambda: (viewer.read(), any(each["samples"] for each in viewer.states))[1], "it is whole")
            worker.on_part = lambda work, part: time.sleep(0.1)
            job = service.submit(scene, spp=8)
            until(lambda: (viewer.read(), service.job(job)["state"] == "finished")[1], "the job is done")
            assert service.farm.views.has_unfinished(), "before the view is"


@pytest.mark.long
def test_dragging_sun_shows_prepared_lighting(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    before = len(worker.prepared)
    worker.on_prepare = lambda scene: time.sleep(0.2)
    with look(service, scene) as viewer:
        moves, deadline = 0, time.monotonic() + 30
        while moves < 60 or len({id for id, _ in viewer.pictures}) < 2:
            assert time.monotonic() < deadline, "it sees something while it moves"
            moves += 1
            viewer.show(moves, spp=1, environment={"sky": {"elevation": 5 + moves / 20}})
            viewer.read(0.02)
        seen = {id for id, _ in viewer.pictures}
        viewer.wait(moves, 1)
        # On a busy machine the camera moves on before prepared frames are shown.
        assert len(worker.prepared) - before <= 2 * len(seen) + 3, "and hardly any others are asked for"


@pytest.mark.long
def test_failed_lighting_is_reported_once(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    tried = []

    def fail(scene: str) -> None:
        tried.append(scene)
        raise ValueError("The sun does not shine.")

    worker.on_prepare = fail
    with look(service, scene) as viewer:
        viewer.show(1, environment={"sky": {"elevation": 77}})
        until(lambda: (viewer.read(), bool(viewer.errors))[1], "the error comes", say=lambda: viewer.states[-2:])
        viewer.read(1.5)
        assert [error["detail"] for error in viewer.errors] == ["The scene cannot be rendered: The sun does not shine."]
        assert len(tried) == 1
        worker.on_prepare = lambda scene: None
        viewer.show(2, spp=2, environment={"sky": {"elevation": 77}})
        viewer.wait(2, 2)


@pytest.mark.long
def test_view_waits_if_memory_is_full(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory_limit, "MAX_PIXELS", 96 * 64)
    scene = service.ready_scene()
    with look(service, scene) as other:
        with look(service, scene) as one:
            one.show(1, spp=2)
            one.wait(1, 2)
            other.show(1, spp=2)
            until(
                lambda: (other.read(), memory_limit.MEMORY_LIMIT_REACHED in [each["message"] for each in other.states])[1],
                "it is told",
            )
            one.say(paused=True)
            other.wait(1, 2)
            other.say(paused=True)
            one.begin_again()
            one.say(paused=False)
            one.show(2, spp=2)
            one.wait(2, 2)
        other.begin_again()
        other.say(paused=False)
        other.show(2, spp=2)
        other.wait(2, 2)


@pytest.mark.long
def test_click_picks_surface(service: Service, worker: PeerWorker) -> None:
    with look(service, service.ready_scene()) as viewer:
        viewer.show(1, view={"eye": [0, 0, 5], "target": [0, 0, 0], "aperture": 0.5, "focus": 3})
        viewer.wait(1, 1)
        viewer.say(pick=[5, 60])
        until(lambda: (viewer.read(), bool(viewer.picked))[1], "it is answered")
        (found,) = viewer.picked
        direction = found.pop("direction")
        assert found == {"x": 5, "y": 60, "depth": 2.0, "position": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
        half = math.tan(math.radians(20)) / 32  # of a pixel, with 64 rows
        np.testing.assert_allclose(np.divide(direction, -direction[2]), [(5.5 - 48) * half, (32 - 60.5) * half, -1])
        (asked,) = [(work, part) for work, part in worker.parts if work.is_whole]
        assert asked[1].tile == (5, 60, 1, 1)
        assert asked[0].settings.view.aperture == 0.0, "the depth of a sharp picture"


@pytest.mark.long
def test_pick_is_answered_despite_new_view(service: Service, worker: PeerWorker) -> None:
    with look(service, service.ready_scene()) as viewer:
        viewer.show(1, spp=2)
        viewer.wait(1, 2)
        picks: list[ViewParts] = []

        def first_is_lost(work: ViewParts, part: Part) -> bool | None:
            if not work.is_whole:
                return None
            picks.append(work)
            if len(picks) == 1:
                viewer.show(2, spp=2, seed=1)
                until(lambda: any(each.view > work.view for each in service.farm.views._sessions.values()), "the view is another")
            return None

        worker.on_part = first_is_lost
        viewer.say(pick=[5, 60])
        until(lambda: (viewer.read(), bool(viewer.picked))[1], "it is answered", say=lambda: len(picks))
        viewer.wait(2, 2)
        viewer.read(0.3)
        assert len(viewer.picked) == 1, "and no more than once"


@pytest.mark.long
def test_many_picks_do_not_delay_picture(service: Service, worker: PeerWorker) -> None:
    worker.on_part = lambda work, part: time.sleep(0.02) if work.is_whole else None
    with look(service, service.ready_scene()) as viewer:
        viewer.show(1, spp=8)
        stop = threading.Event()

        def click() -> None:
            while not stop.is_set():
                viewer.say(pick=[5, 60])
                stop.wait(0.001)  # a thousand per second, not as many as possible

        clicking = threading.Thread(target=click)
        clicking.start()
        try:
            viewer.wait(1, 8)
            until(lambda: (viewer.read(), len(viewer.picked) > 3)[1], "some are answered")
            assert service.farm.views._redis.llen(view_queue(worker.kind)) <= 5
        finally:
            stop.set()
            clicking.join()


@pytest.mark.long
def test_frames_of_view_are_prepared_and_released(service: Service, worker: PeerWorker) -> None:
    worker.on_frame = lambda frame: b"compiled for frame %d" % frame if frame else None
    scene = service.ready_scene()
    before = blobs(service)
    with look(service, scene) as viewer:
        for id, frame in enumerate((3, 4, 3)):
            viewer.show(id, frame=frame, spp=2)
            viewer.wait(id, 2)
            assert worker.parts[-1][0].settings.view.eye == (float(frame), 0.0, 5.0)
        assert worker.frames == [3.0, 4.0], "a frame that was seen is there"
        assert len(blobs(service) - before) == 2
        assert worker.parts[-1][0].compiled in blobs(service)
        until(lambda: not service.farm.views._frames, "nothing is kept of what is answered")
    until(lambda: blobs(service) == before, "what was compiled for them goes", say=lambda: blobs(service) - before)
    assert not remains_of_views(service)


@pytest.mark.long
def test_missing_worker_is_reported(service: Service) -> None:
    with service.worker():
        scene = service.ready_scene()
    with look(service, scene) as viewer:
        viewer.show(1)
        until(
            lambda: (viewer.read(), bool(viewer.states) and viewer.states[-1]["message"] == "Waits for a worker.")[1], "it waits"
        )
        with service.worker(name="old", views=False):
            until(lambda: (viewer.read(), "older release" in (viewer.states[-1]["message"] or ""))[1], "it is too old")
            with service.worker(name="other", kind="another-kind"):  # the scene is compiled for this kind, as for a job
                viewer.wait(1, 2)


@pytest.mark.long
def test_restart_discards_views(service: Service, worker: PeerWorker) -> None:
    redis = service.farm.views._redis
    redis.lpush(view_queue("gone"), b"{}")
    redis.rpush(VIEW_ANSWERS, b"old news")
    service.restart()
    until(lambda: not remains_of_views(service), "it is forgotten", say=lambda: remains_of_views(service))
    assert isinstance(service.farm.records, Records)


def test_viewers_of_a_scene_see_each_other(service: Service) -> None:
    """Others see name, cursor and camera, from the first message until a page is hidden or closed; other scenes see nothing."""
    camera = {"eye": [1.0, 2.0, 3.0], "target": [0.0, 0.0, 0.0]}
    scene, other = service.upload(), service.upload(b"# another\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with look(service, scene) as anna, look(service, other) as stranger:
        with look(service, scene) as ben:
            ben.say(presence={"name": " Ben ", "cursor": [0.25, -0.5], "view": camera})
            until(lambda: (anna.read(), bool(anna.people))[1], "ben is seen")
            (seen,) = anna.people[-1]["people"]
            assert (seen["name"], seen["cursor"], seen["view"]["eye"]) == ("Ben", [0.25, -0.5], camera["eye"])
            for wrong in (
                {"cursor": [1, 1e9]},
                {"cursor": "here"},
                {"name": "a" * 61},
                {"name": "a\nb"},
                {"view": {"eye": [1]}},
                {"is_away": False},
            ):
                ben.say(presence=wrong)
            ben.say(presence=7)
            until(lambda: (ben.read(), len(ben.errors) == 7)[1], "all are refused", say=lambda: ben.errors)
            ben.say(paused=True)
            until(lambda: (anna.read(), anna.people[-1]["people"] == [])[1], "a hidden page is not shown")
            ben.say(paused=False)
            until(lambda: (anna.read(), len(anna.people[-1]["people"]) == 1)[1], "it is shown again")
            anna.say(presence={"name": "Anna", "view": camera})
            until(lambda: (ben.read(), bool(ben.people))[1], "anna is seen")
            for n in range(200):
                anna.say(presence={"name": "Anna", "view": camera, "cursor": [n / 1000, 0]})
            until(lambda: (ben.read(), ben.people[-1]["people"][0]["cursor"] == [0.199, 0])[1], "the latest place comes")
            assert len(ben.people) < 60, "a quick cursor is sent ten times a second"
        until(lambda: (anna.read(), anna.people[-1]["people"] == [])[1], "ben has left")
        stranger.read()
        assert stranger.people == []
    until(lambda: not service.farm.visitors._of_scene, "nobody is left")


def encoded_picture(width: int, height: int, format: str = "PNG") -> str:
    """Returns a picture with metadata as base64."""
    file = io.BytesIO()
    exif = Image.Exif()
    exif[0x010E] = "secret"
    Image.new("RGB", (width, height), (200, 100, 50)).save(file, format, exif=exif)
    return base64.b64encode(file.getvalue()).decode()


def with_damaged_profile(picture: str) -> str:
    """Returns a PNG in base64 with an empty colour profile behind its pixels, over which Pillow stumbles."""
    data = base64.b64decode(picture)
    profile = struct.pack(">I", 0) + b"iCCP" + struct.pack(">I", zlib.crc32(b"iCCP"))
    return base64.b64encode(data[:-12] + profile + data[-12:]).decode()


def test_takes_are_seen_at_once_and_by_all(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, other = service.upload(), service.upload(b"# another\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    path = f"/api/scenes/{scene}/takes"
    view = {"eye": [1.0, 2.0, 3.0], "target": [0.0, 0.0, 0.0], "aperture": 0.1}
    shown = {"scene": scene, "view": view, "width": 300, "height": 200, "background": "transparent"}
    asked = {
        "name": " Low sun ",
        "author": "Ben",
        "request": {**shown, "environment": {"sky": {"elevation": 5}}, "spp": 64, "priority": 3, "name": "x"},
        "exposure": -1.5,
        "tonemap": "filmic",
        "picture": encoded_picture(300, 200),
    }
    with look(service, scene) as anna, look(service, other) as stranger:
        answer = service.http.post(path, json=asked)
        assert answer.status_code == 201, answer.text
        take = answer.json()
        assert answer.headers["location"] == f"{path}/{take['id']}"
        until(lambda: anna.read_take_changes() == [{"changes": 1}], "other clients get the event")
        assert take.items() >= {"name": "Low sun", "author": "Ben", "exposure": -1.5, "tonemap": "filmic"}.items()
        assert take["request"] == {**shown, "environment": {"sky": {"elevation": 5.0}}}, "what a view reads, as it was sent"
        picture = service.http.get(take["picture"])
        image = Image.open(io.BytesIO(picture.content))
        assert (picture.headers["content-type"], image.format, image.size) == ("image/webp", "WEBP", (300, 200))
        assert "exif" not in image.info, "nothing of the file but its pixels is kept"
        unchanged = service.http.get(take["picture"], headers={"If-None-Match": picture.headers["etag"]})
        assert unchanged.status_code == 304
        renamed = service.http.patch(f"{path}/{take['id']}", json={"name": "Dusk"})
        assert renamed.json() == {**take, "name": "Dusk"}
        plain = service.http.post(path, json={"name": "Plain", "request": {"scene": scene}}).json()
        assert (plain["author"], plain["picture"], plain["request"]) == (None, None, {"scene": scene})
        assert service.http.get(f"{path}/{plain['id']}/picture.webp").json()["code"] == "take-without-picture"
        assert service.http.get(path).json() == [renamed.json(), plain]
        assert service.http.get(f"/api/scenes/{other}/takes").json() == []
        assert service.http.delete(f"/api/scenes/{other}/takes/{take['id']}").json()["code"] == "take-not-found"
        monkeypatch.setattr(takes, "MAX_TAKES", 2)
        full = service.http.post(path, json=asked)
        assert (full.status_code, full.json()["code"]) == (409, "takes-too-many")
        assert service.http.delete(f"{path}/{take['id']}").status_code == 204
        until(lambda: anna.read_take_changes()[-1] == {"changes": 4}, "they get the event of the deletion")
        stranger.read()
        assert stranger.take_changes == []
    service.http.delete(f"/api/scenes/{scene}").raise_for_status()
    assert service.http.get(path).status_code == 404
    with service.farm.sessions() as session:
        assert list(session.scalars(takes.select_takes(scene))) == [], "they are deleted with their scene"


def test_bad_takes_are_refused(service: Service) -> None:
    scene = service.upload()
    path = f"/api/scenes/{scene}/takes"
    good = {"name": "a", "request": {"scene": scene}}
    for change, code in (
        ({"name": "\u200b "}, "take-name-missing"),
        ({"name": "a\nb"}, "name-control-characters"),
        ({"name": "a" * 101}, None),
        ({"author": "a\x1b[0m"}, "name-control-characters"),
        ({"request": {"scene": "other"}}, "take-of-other-scene"),
        ({"request": {"scene": scene, "view": {"eye": [1]}}}, None),
        ({"request": {"scene": scene, "width": 0}}, None),
        ({"request": {"scene": scene, "widht": 1}}, None),
        ({"exposure": 1e9}, None),
        ({"tonemap": "prettier"}, "tonemap-unknown"),
        ({"picture": "%%%"}, "take-picture-invalid"),
        ({"picture": base64.b64encode(b"RIFF1234WEBPVP8 ").decode()}, "take-picture-invalid"),
        ({"picture": encoded_picture(8, 8, "TIFF")}, "take-picture-invalid"),
        ({"picture": encoded_picture(513, 8)}, "take-picture-invalid"),
        ({"picture": encoded_picture(8, 8)[:-40]}, "take-picture-invalid"),
        ({"picture": with_damaged_profile(encoded_picture(8, 8))}, "take-picture-invalid"),
        ({"picture": "A" * 200_001}, None),
        ({"scene": scene}, None),
    ):
        answer = service.http.post(path, json=good | change)
        assert answer.status_code == 422, (change, answer.text)
        assert code is None or answer.json()["code"] == code, answer.text
    assert service.http.post("/api/scenes/none/takes", json=good).status_code == 404
    assert service.http.get(path).json() == []
    service.farm.access.note_rate = RateLimit(60.0)
    floods = [service.http.patch(f"{path}/none", json={"name": "a"}).status_code for _ in range(61)]
    assert floods == [404] * 60 + [429]
    service.farm.access.note_rate = RateLimit(60.0)
