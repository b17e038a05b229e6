"""Tests of a slot with a graphics card: it renders the batches of a message, or gives them back for CPU slots."""

from __future__ import annotations

import io
import logging
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from PIL import Image

from protocol.card import CardBatches
from protocol.contract import RenderBatch, Result
from protocol.sums import unpack_sums
from protocol.view_parts import Part, ViewParts
from renderer.cuda.cards import unused_card
from renderer.cuda.driver import Card
from renderer.cuda.render import CardError, CardMemoryError
from renderer.film import CHANNELS, COLOR, SAMPLES, BadSample, BatchSums
from renderer.settings import RenderSettings, Tile, View, tiles_of
from worker.exchange.errors import LinkError, RefusedError
from worker.process.context import WorkerContext
from worker.work import slot_card, view_card
from worker.work.slot_card import blocks_of

CARDS = (Card(0, "first", (7, 0), 1 << 30, 1), Card(3, "second", (8, 6), 1 << 30, 1))
SETTINGS = RenderSettings(160, 130, View((0, 0, 4), (0, 0, 0)))
BATCH = RenderBatch("b", "job", 0, "0" * 64, Tile(0, 0, 8, 8), 0, 2, SETTINGS)


def batch(number: int, tile: Tile, **more: Any) -> RenderBatch:
    return replace(BATCH, batch=f"b{number}", tile=tile, **more)


def sums_of(tile: Tile, first: int, count: int) -> Any:
    """Returns fake sums (channels, h, w) of `count` samples of a tile. All samples are valid.

    The value of pixel (x, y) is 1000 y + x + first in each channel but that of the sample count.
    """
    y, x = np.mgrid[tile.y : tile.y + tile.h, tile.x : tile.x + tile.w]
    sums = np.broadcast_to(1000 * y + x + first, (CHANNELS, tile.h, tile.w)).astype(np.int64)
    sums[SAMPLES] = count
    return sums


class Renderer:
    """A substitute for a graphics card's renderer, which records the loaded kernels.

    answer: function called in place of render_batch, or an exception to raise there; None: the sums are those of `sums_of`.
    """

    answer: Any = None

    def __init__(self, card: Card) -> None:
        self.card = card
        self.loaded: set[str] = set()

    def has_kernel(self, variant: str) -> bool:
        return variant in self.loaded

    def load(self, variant: str, fetch: Any) -> None:
        fetch(f"cuda-{variant}")
        self.loaded.add(variant)


@pytest.fixture
def worker(monkeypatch: pytest.MonkeyPatch) -> Any:
    def rendered(scene: Any, settings: Any, tile: Tile, first: int, count: int, card: Any) -> BatchSums:
        assert card.card == CARDS[1]
        launched.append(tile)
        if isinstance(Renderer.answer, Exception):
            raise Renderer.answer
        if Renderer.answer is not None:
            return Renderer.answer(tile, first, count)
        return BatchSums(sums_of(tile, first, count), [], 0)

    launched: list[Tile] = []
    sent: list[Result] = []
    failed_tests: dict[str, str] = {}
    monkeypatch.setattr(slot_card, "CardRenderer", Renderer)
    for module in (slot_card, view_card):
        monkeypatch.setattr(module, "render_batch", rendered)
    monkeypatch.setattr(slot_card, "variant_for", lambda settings, scene: "plain")
    monkeypatch.setattr(slot_card, "mapped_scene", lambda worker, sha256: SimpleNamespace())
    monkeypatch.setattr(slot_card, "fetch_kernel", lambda link, folder, name: (True, f"{name} fetched"))
    monkeypatch.setattr(slot_card, "check_kernel", lambda link, card, kernel, release: failed_tests.get(kernel, ""))
    monkeypatch.setattr(slot_card, "_failed_tests", {})
    monkeypatch.setattr(slot_card, "slot", lambda: 1)
    monkeypatch.setattr(slot_card, "_cards", {})
    monkeypatch.setattr(slot_card, "_too_large", set())
    monkeypatch.setattr(Renderer, "answer", None)
    results = SimpleNamespace(send=sent.append)
    return SimpleNamespace(
        name="w", slots=2, cards=CARDS, link=object(), results=results, sent=sent, launched=launched, failed_tests=failed_tests
    )


def render(worker: Any, *batches: RenderBatch) -> list[tuple[Tile, bool]]:
    """Renders batches as one message on the graphics card. Returns (tile, is_compiling) of each status report of the slot.

    is_compiling: whether the slot is reported as compiling a kernel.
    """
    shown: list[tuple[Tile, bool]] = []
    worker.speed = slot_card.render_on_card(
        worker, CardBatches(batches or (BATCH,)), lambda block, is_compiling: shown.append((block.tile, is_compiling))
    )
    return shown


def test_adjacent_tiles_form_one_block() -> None:
    tiles = tiles_of(160, 130, 64)
    batches = [batch(number, tile) for number, tile in enumerate(tiles)]
    (whole,) = blocks_of(batches[::-1])
    assert whole.tile == Tile(0, 0, 160, 130)
    assert sorted(each.batch for each in whole.batches) == [f"b{number}" for number in range(9)]
    corner = blocks_of(batches[1:])
    assert sum(block.tile.w * block.tile.h for block in corner) == 160 * 130 - 64 * 64
    assert len(corner) == 2
    assert len(blocks_of(batches, most=2 * 64 * 64 * 2)) == 4
    assert [block.samples for block in blocks_of(batches, most=1)] == [tile.w * tile.h * 2 for tile in tiles_in_order(batches)]
    for other in (replace(batches[1], first=2), replace(batches[1], count=3), replace(batches[1], frame=2)):
        assert len(blocks_of([batches[0], other])) == 2
    with_mattes = [replace(each, settings=replace(each.settings, cryptomatte=2)) for each in batches]
    assert [block.batches for block in blocks_of(with_mattes)] == [[each] for each in with_mattes]


def tiles_in_order(batches: list[RenderBatch]) -> list[Tile]:
    return sorted((each.tile for each in batches), key=lambda tile: (tile.x, tile.w, tile.y))


def test_message_is_rendered_in_blocks_and_sent_by_batch(worker: Any) -> None:
    tiles = tiles_of(160, 130, 64)
    batches = [batch(number, tile) for number, tile in enumerate(tiles)]
    assert render(worker, *batches) == [
        (Tile(0, 0, 160, 130), False), (Tile(0, 0, 160, 130), True), (Tile(0, 0, 160, 130), False)
    ]  # fmt: skip
    assert worker.launched == [Tile(0, 0, 160, 130)]
    assert worker.speed > 0
    assert {result.event["batch"] for result in worker.sent} == {each.batch for each in batches}
    for result in worker.sent:
        number = int(result.event["batch"][1:])
        assert (result.event["type"], result.event["bad_count"]) == ("batch", 0)
        assert (unpack_sums(result.sums, tiles[number]) == sums_of(tiles[number], 0, 2)).all()
    assert render(worker, batches[0]) == [(tiles[0], False)]


def test_settings_are_part_of_the_kernel(worker: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[str] = []
    monkeypatch.setattr(slot_card, "fetch_kernel", lambda link, folder, name: (True, str(loaded.append(name))))
    render(worker, BATCH)

    def without_guide(settings: RenderSettings, scene: Any, prepare_pilot: Any) -> RenderSettings:
        return replace(settings, guiding="off") if settings.guiding == "auto" else settings

    monkeypatch.setattr(slot_card, "settings_as_rendered", without_guide)
    for more in ({"spectral": "on"}, {"guiding": "auto"}, {"guiding": "on"}):
        render(worker, replace(BATCH, settings=replace(SETTINGS, **more)))
    assert loaded == ["cuda-plain", "cuda-plain-spectral", "cuda-plain-guided"], "auto is refused, so it has the plain kernel"


def test_card_that_fails_the_test_of_a_kernel_is_not_used_again(worker: Any, caplog: Any) -> None:
    """The kernel for spectral pictures computes other bits, after the plain one was rendered with."""
    render(worker, BATCH)
    assert worker.sent.pop().event["type"] == "batch"
    reason = unused_card(CARDS[1], "it computed other bits")
    worker.failed_tests["plain-spectral"] = reason
    with caplog.at_level(logging.WARNING, "worker"):
        render(worker, replace(BATCH, settings=replace(SETTINGS, spectral="on")))
    assert caplog.messages == [reason]
    for more in ({"spectral": "on"}, {}):
        render(worker, replace(BATCH, settings=replace(SETTINGS, **more)))
    assert [each.event["error"] for each in worker.sent] == [reason] * 3
    assert returned_batches(worker) == [("batch-returned", True, "card-unused")] * 3
    assert len(worker.launched) == 1


def test_discarded_samples_belong_to_their_tile(worker: Any) -> None:
    def with_bad(tile: Tile, first: int, count: int) -> BatchSums:
        sums = sums_of(tile, first, count)
        sums[SAMPLES, 3, 70] -= 1
        return BatchSums(sums, [BadSample(70, 3, 1)], 1)

    Renderer.answer = with_bad
    render(worker, batch(0, Tile(0, 0, 64, 64)), batch(1, Tile(64, 0, 64, 64)))
    bad = {result.event["batch"]: (result.event["bad"], result.event["bad_count"]) for result in worker.sent}
    assert bad == {"b0": ([], 0), "b1": ([[70, 3, 1]], 1)}


def returned_batches(worker: Any) -> list[tuple[str, bool, str]]:
    found = [(each.event["type"], each.event.get("for_cpu", False), each.event["error"].code) for each in worker.sent]
    worker.sent.clear()
    return found


def test_unsupported_settings_go_to_cpus(worker: Any) -> None:
    render(worker, replace(BATCH, settings=replace(SETTINGS, integrator="ao")))
    assert returned_batches(worker) == [("batch-returned", True, "card-lacks-settings")]


def test_scene_too_large_for_card_goes_to_cpus(worker: Any, caplog: Any) -> None:
    Renderer.answer = CardMemoryError("card 3 (second) has too little memory, 1 GiB, for this scene")
    with caplog.at_level(logging.WARNING, "worker"):
        render(worker, BATCH, replace(BATCH, batch="c", first=2))
    assert caplog.messages == ["card 3 (second) has too little memory, 1 GiB, for this scene; the processor renders it"]
    assert returned_batches(worker) == [("batch-returned", True, "card-scene-too-large")] * 2
    Renderer.answer = None
    render(worker)
    assert returned_batches(worker) == [("batch-returned", True, "card-scene-too-large")]
    render(worker, replace(BATCH, compiled="1" * 64))
    assert worker.sent[0].event["type"] == "batch"


def test_failed_card_sends_finished_sums_and_is_not_reused(worker: Any, caplog: Any) -> None:
    def fails_later(tile: Tile, first: int, count: int) -> BatchSums:
        if first:
            raise CardError("card 3 (second): cuLaunchKernel failed")
        return BatchSums(sums_of(tile, first, count), [], 0)

    Renderer.answer = fails_later
    with caplog.at_level(logging.WARNING, "worker"):
        render(worker, BATCH, replace(BATCH, batch="c", first=2))
    assert "from now on the processor renders" in caplog.text
    assert sorted((each.event["type"], each.event["batch"]) for each in worker.sent) == [("batch", "b"), ("batch-returned", "c")]
    worker.sent.clear()
    Renderer.answer = None
    render(worker)
    assert returned_batches(worker) == [("batch-returned", True, "card-failed")]


@pytest.mark.parametrize(("error", "for_cpu"), ((LinkError("The service is away."), False), (RefusedError("gone"), True)))
def test_download_failure_returns_batches(worker: Any, monkeypatch: pytest.MonkeyPatch, error: Exception, for_cpu: bool) -> None:
    def fails(worker: Any, sha256: str) -> Any:
        raise error

    monkeypatch.setattr(slot_card, "mapped_scene", fails)
    monkeypatch.setattr(slot_card, "PATIENCE_S", 0.0)
    render(worker)
    assert returned_batches(worker) == [("batch-returned", for_cpu, "worker-returned-batch")]


class Answers:
    """A substitute for a view's answers, which records them. wanted: number of blocks after which the view is outdated."""

    sent: ClassVar[list[tuple[str, dict[str, Any]]]] = []
    wanted = 99

    def __init__(self, worker: Any, work: ViewParts) -> None:
        Answers.wanted += 1  # for the question before the first block

    def send(self, type: str, sums: bytes = b"", **more: Any) -> None:
        self.sent.append((type, {**more, "sums": sums} if sums else more))

    def is_wanted(self) -> bool:
        Answers.wanted -= 1
        return Answers.wanted > 0


def view(worker: Any, monkeypatch: pytest.MonkeyPatch, wanted: int = 99, **more: Any) -> list[tuple[str, dict[str, Any]]]:
    """Renders nine parts of a view, with two ranges of samples each, on the graphics card. Returns the answers."""
    monkeypatch.setattr(view_card, "ViewAnswers", Answers)
    monkeypatch.setattr(Answers, "sent", [])
    monkeypatch.setattr(Answers, "wanted", wanted)
    places = [(tile, first) for first in (0, 1) for tile in tiles_of(160, 130, 64)]
    parts = [Part(number, tile, first, 1) for number, (tile, first) in enumerate(places)]
    worker.launched.clear()
    sent = replace(ViewParts("m", "watch", 1, "0" * 64, SETTINGS, parts, on_card=True), **more)
    work = ViewParts.from_json(sent.to_json())
    assert work == sent
    worker.speed = view_card.render_view_on_card(worker, work, lambda is_compiling: None)
    return Answers.sent


def test_view_is_declined_while_its_scene_is_loaded_and_then_rendered(worker: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(view_card, "_ready", {})
    assert view(worker, monkeypatch) == [("begun", {}), ("declined", {"is_loading": True}), ("over", {})]
    assert worker.launched == [Tile(0, 0, 160, 130)]
    begun, *parts, over = view(worker, monkeypatch)
    assert (begun, over) == (("begun", {}), ("over", {}))
    assert worker.launched == [Tile(0, 0, 160, 130)] * 2
    assert worker.speed > 0
    assert sorted(more["number"] for _, more in parts) == list(range(18))
    for kind, more in parts:
        tile, first = tiles_of(160, 130, 64)[more["number"] % 9], more["number"] // 9
        assert kind == "part"
        assert (unpack_sums(more["sums"], tile)[COLOR] == sums_of(tile, first, 1)[COLOR]).all()
        assert more["seconds"] >= 0
    assert len(view(worker, monkeypatch, wanted=1)) == 2 + 9, "an outdated view ends with the block"
    kinds = [kind for kind, _ in view(worker, monkeypatch, settings=replace(SETTINGS, max_depth=3))]
    assert kinds == ["begun", *["part"] * 18, "over"]
    slot_card._cards.clear()
    assert view(worker, monkeypatch)[1] == ("declined", {"is_loading": True}), "of a kernel that is not loaded"


def test_draft_of_a_view_is_rendered_as_one_tile_and_sent_as_a_jpeg(worker: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The colours of the JPEG are those of the draft, red in the lowest byte, and have no more noise than its compression."""

    def drafted(scene: Any, settings: Any, tile: Tile, first: int, count: int, card: Any, **more: Any) -> Any:
        assert (card.card, tile, first, count) == (CARDS[1], Tile(0, 0, 160, 130), 0, 4)
        assert more == {"exposure": 0.0, "is_smooth": True}
        return words

    y, x = np.mgrid[:130, :160].astype(np.uint32)
    words = x | (y << 8) | (200 << 16)
    monkeypatch.setattr(view_card, "_ready", {"0" * 64: None})
    monkeypatch.setattr(view_card, "render_draft", drafted)
    slot_card._cards[3] = Renderer(CARDS[1])  # type: ignore[assignment]
    slot_card._cards[3].loaded.add("plain")  # type: ignore[union-attr]
    ((kind, more),) = view(worker, monkeypatch, parts=[Part(0, Tile(0, 0, 160, 130), 0, 4)], draft=0.0, is_smooth=True)
    assert kind == "draft"
    assert more["seconds"] >= 0
    assert worker.speed > 0
    picture = np.asarray(Image.open(io.BytesIO(more["sums"]))).astype(int)
    np.testing.assert_allclose(picture, np.stack([x, y, np.full_like(x, 200)], -1), atol=12)
    monkeypatch.setattr(view_card, "_ready", {})
    assert view(worker, monkeypatch, parts=[Part(0, Tile(0, 0, 160, 130), 0, 4)], draft=0.0, is_smooth=True) == [
        ("declined", {"is_loading": True}),
        ("over", {}),
    ]


@pytest.mark.parametrize(
    ("answer", "code"),
    (
        (CardMemoryError("too little memory"), "card-scene-too-large"),
        (CardError("it failed"), "card-failed"),
        (ValueError("a bug"), "worker-view-failed"),
    ),
)
def test_view_that_a_card_cannot_render_is_declined(
    worker: Any, monkeypatch: pytest.MonkeyPatch, answer: Exception, code: str
) -> None:
    monkeypatch.setattr(view_card, "_ready", {"0" * 64: None})
    Renderer.answer = answer
    kind, more = view(worker, monkeypatch)[-1]
    assert (kind, more["error"].code) == ("declined", code)
    assert worker.speed == 0.0


def test_view_with_unsupported_settings_is_declined(worker: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    kind, more = view(worker, monkeypatch, settings=replace(SETTINGS, integrator="ao"))[-1]
    assert (kind, more["error"].code) == ("declined", "card-lacks-settings")


def test_worker_with_cards_serves_only_its_own_batch_queue() -> None:
    def queues(**more: Any) -> list[str]:
        return WorkerContext("w", 2, "kind", "redis://", *[SimpleNamespace()] * 3, **more).queues  # type: ignore[arg-type]

    assert "rayfarm.render.kind" in queues()
    assert "rayfarm.card.w" not in queues()
    alone = queues(cards=CARDS)
    assert alone[:2] == ["rayfarm.card-view.w", "rayfarm.card.w"]
    assert "rayfarm.render.kind" not in alone
    assert "rayfarm.prepare.kind" in alone
    assert queues(cards=CARDS, is_beside_cpu=True) == ["rayfarm.card-view.w", "rayfarm.card.w", "rayfarm.prepare.kind.of.w"]


def test_worker_with_cards_beside_the_cores_is_not_counted_for_views() -> None:
    """Its slots do not serve the queue of views, so that a view would wait for them in vain."""
    board: Any = SimpleNamespace(read=lambda: (["", ""], 0.0), speed=lambda slot: 0.0)
    nothing: Any = None

    def has_views(**more: Any) -> bool:
        return WorkerContext("w", 2, "kind", "redis://", nothing, nothing, board, **more).report().views

    assert has_views()
    assert has_views(cards=CARDS)
    assert not has_views(cards=CARDS, is_beside_cpu=True)
