"""Tests of which pictures become posters, how large they are, and that they end with their scene."""

from __future__ import annotations

import hashlib
import io
import math
import threading
import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from protocol.contract import BlobRef
from service.events import Events, RowWritten
from service.jobs.lookup import find_scene
from service.scheduling.snapshot import Snapshot
from service.store.models import Scene
from service.viewing.idle_posters import IdlePosters
from service.viewing.poster_choice import (
    MIN_PIXELS,
    Poster,
    is_better,
    is_outdated,
    is_worth_rendering,
    poster_of,
    renderer_of,
)
from service.viewing.poster_store import encode_poster
from service.viewing.posters import MAX_ENDING, MAX_TAKEN, Posters
from service.viewing.session import SettledPicture
from service.viewing.view_request import HOME_PIXELS, home_view, resolve_view, shows_home, view_hash
from tests.service.conftest import OBJ, Service, until
from tests.service.viewer import look

FLAT = np.full((54, 96, 3), 0.5, np.float32)


def poster(samples: float, width: int = 1280, denoised: bool = True) -> Poster:
    return Poster(width, width * 9 // 16, samples, denoised, "0.2.0-3fa9c1d2", "a view")


def picture(scene: Scene, samples: float, color: np.ndarray = FLAT, kind: str = "test-kind") -> SettledPicture:
    return SettledPicture(scene.id, color, samples, True, kind, view_hash(home_view(scene)))


def shown(data: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


def test_poster_is_bounded_whatever_it_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.viewing.poster_store.MAX_PIXELS", 1 << 16)
    monkeypatch.setattr("service.viewing.poster_store.MAX_BYTES", 1 << 15)
    noise = np.random.default_rng(3).random((300, 540, 3), np.float32)
    data = encode_poster(noise)
    height, width = shown(data).shape[:2]
    assert len(data) <= 1 << 15 and 0.98 * (1 << 16) < width * height <= 1 << 16
    assert width / height == pytest.approx(1.8, abs=0.01)


def test_poster_of_dark_picture_is_exposed_by_what_it_shows() -> None:
    """A scene of lamps of 1 W gives radiances about 1e-4, which a live view shows exposed by as many stops."""
    ramp = np.linspace(1e-6, 1e-4, 96 * 54, dtype=np.float32).reshape(54, 96, 1).repeat(3, -1)
    assert shown(encode_poster(ramp)).mean() > 60
    assert shown(encode_poster(0.5 * np.ones_like(ramp))).std() < 1, "a bright picture is as it is"


@pytest.mark.parametrize(
    ("made", "present", "replaces"),
    [
        (poster(2), None, True),
        (poster(16), poster(4), True),
        (poster(15), poster(4), False),
        (poster(256, denoised=False), poster(16), False),
        (poster(16), poster(64, denoised=False), True),
        (poster(256, width=320), poster(16), False),
        (poster(4), poster(64, width=640), True),
        (poster(4, width=660), poster(64, width=640), False),
    ],
    ids=str,
)
def test_poster_is_replaced_only_by_a_better_one(made: Poster, present: Poster | None, replaces: bool) -> None:
    assert is_better(made, present) is replaces


@pytest.mark.parametrize(
    ("present", "lacks"),
    [
        (None, True),
        (poster(4), True),
        (poster(8), False),  # one of 16 samples would not replace it
        (poster(256, width=640), True),
        (poster(16, denoised=False), False),
    ],
    ids=str,
)
def test_poster_is_rendered_only_if_it_would_be_stored(present: Poster | None, lacks: bool) -> None:
    """Otherwise each start of the service would render it again."""
    assert is_worth_rendering(present) is lacks


def test_poster_of_another_renderer_or_another_view_is_outdated() -> None:
    now, kind = poster(16), "0.2.0-3fa9c1d2-x86-64-v3"
    assert renderer_of(kind) == now.renderer == renderer_of("0.2.0-3fa9c1d2-arm64")
    assert not is_outdated(now, "a view", {renderer_of(kind), "0.1.0-11111111"})
    assert not is_outdated(now, "a view", set()), "without workers there is no other renderer"
    assert is_outdated(now, "a view", {"0.3.0-22222222"})
    assert is_outdated(now, "the view of other settings", {renderer_of(kind)})
    stored = {"width": 96, "height": 54, "samples": 16, "denoised": True, "sha256": "0" * 64, "size": 1}
    earlier = poster_of(Scene(info={"poster": stored}))
    assert earlier is not None and is_outdated(earlier, "a view", set()), "an earlier release did not record what it shows"
    assert poster_of(Scene(info={"poster": {"width": 96}})) is None is poster_of(Scene(info=None))


def session(**more: Any) -> Any:
    usual = {"id": "s", "view": 1, "mean_samples": 16.0, "error": None, "awaits_denoising": lambda least: False}
    settled = SettledPicture("a scene", FLAT, 16, True, "test-kind", "a view")
    return SimpleNamespace(**{**usual, "settled_picture": lambda *least: settled, **more})


class Views:
    """Sessions of a view scheduler that renders nothing."""

    def __init__(self) -> None:
        self.ending: list[Any] = []
        self.closed: list[Any] = []

    def sessions(self) -> list[Any]:
        return []

    def end_sampling(self, session: Any, min_samples: float) -> None:
        self.ending.append(session)

    def close_session(self, session: Any) -> None:
        self.closed.append(session)


class Store:
    """Store that keeps pictures in a list."""

    def __init__(self) -> None:
        self.stored: list[SettledPicture] = []

    def store(self, picture: SettledPicture) -> bool:
        self.stored.append(picture)
        return True


def test_pictures_of_closed_views_wait_in_bounded_memory() -> None:
    views: Any = Views()
    nothing: Any = None
    posters = Posters(nothing, views, threading.Event())
    for _ in range(3 * MAX_TAKEN):
        posters.end_session(session())
    assert posters._taken.qsize() == MAX_TAKEN and len(views.closed) == 3 * MAX_TAKEN
    posters.stop()


def test_view_that_is_left_before_it_is_denoised_leaves_its_poster_afterwards() -> None:
    views: Any = Views()
    store: Any = Store()
    posters = Posters(store, views, threading.Event())
    waits = [True]
    settled = session().settled_picture
    more = {"awaits_denoising": lambda least: waits[0], "settled_picture": lambda *least: None if waits[0] else settled()}
    left = [session(**more) for _ in range(MAX_ENDING + 1)]
    for each in left:
        posters.end_session(each)
    assert views.ending == left[:-1] and views.closed == left[-1:], "no more are kept open"
    posters.start()
    time.sleep(0.1)
    assert not store.stored and len(views.closed) == 1
    waits[0] = False
    until(lambda: len(views.closed) == len(left), "they are closed")
    assert len(store.stored) == MAX_ENDING
    posters.stop()


def test_view_that_is_left_is_not_kept_open_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.viewing.posters.ENDING_S", 0.1)
    views: Any = Views()
    posters = Posters(Store(), views, threading.Event())  # type: ignore[arg-type]
    posters.end_session(session(awaits_denoising=lambda least: True))
    posters.start()
    until(lambda: len(views.closed) == 1, "it is closed")
    posters.stop()


def test_home_view_of_a_slender_picture_is_no_longer_than_a_picture_may_be() -> None:
    """A scene file may have a size of 16384x2; enlarged to HOME_PIXELS, it would be refused, and so would the page's view."""
    view = {"eye": [0.0, 1.0, 5.0], "target": [0.0, 1.0, 0.0]}
    info = {"cameras": [{"name": "automatic", "view": view}], "defaults": {"width": 16384, "height": 2}}
    scene = Scene(id="s", status="ready", info=info, compiled={"k": {"sha256": "0" * 64}}, notes=[])
    shown = home_view(scene).settings
    assert (shown.width, shown.height) == (16384, 2)
    assert shows_home(resolve_view(1, {"camera": "automatic", "width": 8192, "height": 1}, scene, False, 0.0), scene)


def test_home_view_is_that_of_first_camera_in_any_size(service: Service) -> None:
    with service.worker():
        scene = find_scene(service.ready_scene(), service.farm)
    camera = scene.info["cameras"][0] if scene.info else {}
    usual = {"denoise": True, "noise": 0.02, "width": 640, "height": 360}

    def is_home(scene: Scene = scene, **more: Any) -> bool:
        return shows_home(resolve_view(1, {**usual, **more}, scene, False, 0.0), scene)

    assert home_view(scene).settings.width * home_view(scene).settings.height == pytest.approx(HOME_PIXELS, rel=0.01)
    assert is_home() and is_home(camera=camera["name"]) and is_home(view=camera["view"], width=333, height=187)
    assert not is_home(width=360), "another shape"
    assert not is_home(max_depth=1)
    assert not is_home(view={**camera["view"], "fov": 20.0})
    derived = Scene(**{name: getattr(scene, name) for name in ("id", "info", "compiled", "status", "error")}, of="another")
    assert not is_home(derived), "its light is another"


def test_view_that_was_open_leaves_poster_in_its_scene(service: Service) -> None:
    with service.worker():
        scene = service.ready_scene()
        assert service.scene(scene)["poster"] is None
        assert service.http.get(f"/api/scenes/{scene}/poster.jpg").status_code == 404
        with look(service, scene) as viewer:
            viewer.show(1, width=96, height=54, spp=16, denoise=True)
            until(lambda: viewer.read() or service.scene(scene)["poster"] is not None, "the scene has a poster")
        answer = service.http.get(service.scene(scene)["poster"])
        assert answer.headers["cache-control"] == "private, max-age=31536000, immutable"
        assert shown(answer.content).shape == (54, 96, 3)
        with look(service, scene) as viewer:
            viewer.show(1, width=96, height=54, spp=256, denoise=True, max_depth=1)
            until(lambda: viewer.read() or bool(viewer.states and viewer.states[-1]["done"]), "another view is done")
        assert service.http.get(f"/api/scenes/{scene}/poster.jpg").content == answer.content


def test_view_left_while_it_is_denoised_leaves_poster_and_closes(service: Service) -> None:
    """Denoising takes seconds on a busy machine: a page that was left before would leave no poster."""
    may_end = threading.Event()
    with service.worker() as worker:
        worker.on_denoise = lambda _: bool(may_end.wait(10)) or None
        scene = service.ready_scene()
        with look(service, scene) as viewer:
            viewer.show(1, width=96, height=54, spp=4, denoise=True)
            until(lambda: viewer.read() or any(each["samples"] >= 2 for each in viewer.states), "it has samples")
        assert service.scene(scene)["poster"] is None
        parts = len(worker.parts)
        may_end.set()
        until(lambda: service.scene(scene)["poster"] is not None, "the scene has a poster")
        until(lambda: not service.farm.views.sessions(), "the view is closed")
        assert len(worker.parts) <= parts + 1, "no more of it was rendered"


def test_poster_is_one_blob_that_is_deleted_with_the_scene(service: Service) -> None:
    with service.worker():
        scene = service.ready_scene()
    row, store, blobs = find_scene(scene, service.farm), service.farm.posters._store, service.farm.blobs

    def stored() -> str:
        info = find_scene(scene, service.farm).info or {}
        return BlobRef("", info["poster"]["sha256"], info["poster"]["size"]).sha256

    assert store.store(picture(row, 4))
    first = stored()
    assert not store.store(picture(row, 8, 0.1 * FLAT)) and stored() == first
    url = service.scene(scene)["poster"]
    assert store.store(picture(row, 64, 0.1 * FLAT))
    second = stored()
    assert blobs.exists(second) and not blobs.exists(first)
    assert service.scene(scene)["poster"] != url
    stale = service.http.get(url)
    assert stale.headers["cache-control"] == "no-cache" and stale.status_code == 200, "an old address is not kept"
    assert not store.store(picture(row, 4096)._replace(view="that of other settings")), "it shows another view by now"
    assert service.http.delete(f"/api/scenes/{scene}").status_code == 204
    assert not blobs.exists(second)
    assert service.http.get(f"/api/scenes/{scene}/poster.jpg").status_code == 404
    assert not store.store(picture(row, 256)), "its scene is gone"


def test_poster_of_another_release_is_replaced_by_one_of_fewer_samples(service: Service) -> None:
    store, whole = service.farm.posters._store, np.full((720, 1280, 3), 0.5, np.float32)
    with service.worker():
        scene = service.ready_scene()
        row = find_scene(scene, service.farm)
        assert store.store(picture(row, 256, whole, "0.1.0-11111111-x86-64-v3"))
        assert store.lacking(1) == [scene], "an idle farm renders it"
        assert store.store(picture(row, 16, 0.1 * whole))
        assert not store.lacking(1) and not store.store(picture(row, 32))


def test_poster_that_another_has_overtaken_leaves_no_blob(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    with service.worker():
        scene = service.ready_scene()
    answers = iter((True, False))  # before the picture is encoded, and when the row is written
    monkeypatch.setattr("service.viewing.poster_store.is_better", lambda *_: next(answers))
    assert not service.farm.posters._store.store(picture(find_scene(scene, service.farm), 16))
    assert not service.farm.blobs.exists(hashlib.sha256(encode_poster(FLAT)).hexdigest())


@pytest.mark.long
def test_idle_farm_renders_missing_posters_and_stops_for_others(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.viewing.idle_posters.IDLE_S", 0.0)
    service.options["idle_posters"] = True
    service.restart()
    views = service.farm.views
    with service.worker() as worker:
        scene = service.ready_scene()
        until(lambda: service.scene(scene)["poster"] is not None, "the scene has a poster")
        info = find_scene(scene, service.farm).info or {}
        assert info["poster"]["width"] * info["poster"]["height"] >= MIN_PIXELS and info["poster"]["samples"] == 16
        until(lambda: not views.sessions(), "the view without a page is closed")
        worker.on_part = lambda work, part: time.sleep(0.5)
        other = service.upload(OBJ + b"# another\n")
        until(lambda: bool(views.sessions()), "its poster is being rendered")
        job = service.submit(other, priority=-100)
        until(lambda: not views.sessions(), "the view without a page makes room for the job")
        assert service.scene(other)["poster"] is None
        worker.on_part = lambda work, part: None
        service.wait_for(job, "finished")
        until(lambda: service.scene(other)["poster"] is not None, "it is rendered after the job")


@pytest.mark.long
def test_idle_farm_compiles_no_kernel_for_a_poster(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    """A job that arrives meanwhile would wait for that. Once the kernel is there, the poster is rendered."""
    monkeypatch.setattr("service.viewing.idle_posters.IDLE_S", 0.0)
    monkeypatch.setattr("service.viewing.idle_posters.RETRY_S", 1.0)
    service.options["idle_posters"] = True
    service.restart()
    has_kernel = threading.Event()
    declined: list[bool] = []
    with service.worker() as worker:
        worker.on_view = lambda work: None if has_kernel.is_set() else declined.append(work.needs_kernel) or {}
        scene = service.ready_scene()
        until(lambda: len(declined) >= 2, "it is tried again after a while")
        assert all(declined)
        assert service.scene(scene)["poster"] is None
        has_kernel.set()
        until(lambda: service.scene(scene)["poster"] is not None, "the scene has a poster")


def test_posters_wait_while_clients_wait_for_pictures() -> None:
    """Samples of a poster would delay the last denoised picture of a job, for which its user waits."""
    report: Any = SimpleNamespace(views=True)
    roster: Any = SimpleNamespace(ready_reports=lambda: [report])
    board: Any = SimpleNamespace(latest=Snapshot(fault=None, roster=roster))
    views: Any = SimpleNamespace(sessions=list)
    nothing: Any = None
    idle = IdlePosters(nothing, nothing, views, board, Events(), threading.Event())
    assert idle._is_idle() is True
    board.latest = replace(board.latest, has_requests=True)
    assert idle._is_idle() is False


def test_idle_farm_looks_for_posters_only_after_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The look reads 24 rows of the database, twice a second."""
    monkeypatch.setattr("service.viewing.idle_posters.IDLE_S", 0.0)
    looks: list[int] = []
    store: Any = SimpleNamespace(renderers=frozenset({"a"}), lacking=lambda recent: looks.append(recent) or [])
    nothing: Any = None
    events = Events()
    idle = IdlePosters(nothing, store, nothing, nothing, events, threading.Event())
    monkeypatch.setattr(idle, "_is_idle", lambda own=None: True)
    idle._not_before["interrupted"] = 0.0
    for _ in range(3):
        idle.render_next()
    assert len(looks) == 1
    events.publish(RowWritten("scene", "s"))
    for _ in range(3):
        idle.render_next()
    assert len(looks) == 2
    store.renderers = frozenset({"b"})
    for _ in range(3):
        idle.render_next()
    assert len(looks) == 3, "posters of another renderer are outdated"


def test_idle_farm_tries_a_poster_again_only_if_it_was_made_in_between(monkeypatch: pytest.MonkeyPatch) -> None:
    """A scene that cannot be rendered is not tried again; a stored poster may become outdated."""
    monkeypatch.setattr("service.viewing.idle_posters.IDLE_S", 0.0)
    lacking = ["broken", "good"]
    store: Any = SimpleNamespace(renderers=frozenset({"a"}), lacking=lambda recent: list(lacking))
    nothing: Any = None
    events = Events()
    idle = IdlePosters(nothing, store, nothing, nothing, events, threading.Event())
    tried: list[str] = []

    def render(id: str) -> None:
        tried.append(id)
        idle._not_before[id] = math.inf
        if id == "good":
            lacking.remove(id)

    monkeypatch.setattr(idle, "_is_idle", lambda own=None: True)
    monkeypatch.setattr(idle, "_render_poster", render)
    for _ in range(5):
        idle.render_next()
    assert tried == ["broken", "good"]
    lacking.append("good")  # its page opens with another view
    events.publish(RowWritten("scene", "good"))
    for _ in range(5):
        idle.render_next()
    assert tried == ["broken", "good", "good"]
    assert set(idle._not_before) <= {"broken", "good"}
