"""Tests of finding and choosing graphics cards, and of rendering through the CUDA driver API, with a fake driver."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rayfarm
from protocol.card import CardBatches
from protocol.contract import RenderBatch, Result
from protocol.sums import PACKED, unpack_hits, unpack_sums
from rayfarm import graphics_card
from renderer.cuda import render as card_rendering
from renderer.cuda.cards import (
    CardsError,
    chosen_cards,
    find_cards,
    find_cards_before_fork,
    has_nvidia_hardware,
    reasons_unused,
)
from renderer.cuda.driver import Card, Device, Driver, DriverError
from renderer.cuda.render import CardError, CardRenderer
from renderer.errors import SettingsError
from renderer.film import COLOR, SAMPLES, digest
from renderer.kernel.draft_of_film import draft_of
from renderer.render import RenderStats, render_batch, render_draft, render_frame
from renderer.self_test.compare import judge
from renderer.settings import RenderSettings, Tile, tiles_of
from tests.helpers import ROOT
from tests.renderer.cuda.on_host import fake_driver, shared_object
from tests.renderer.kernel.backends.features import GROUPS, VIEW, grouped, made
from tests.renderer.test_spectral import room_by_spectra, room_over_a_catcher
from worker.work import slot_card

NEW, OLD = "RTX Test:8:6:8192", "GTX Test:6:1:4096"


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(fake_driver(tmp_path_factory.mktemp("driver")))


@pytest.fixture
def with_cards(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    monkeypatch.setenv("FAKE_CUDA_CARDS", NEW)
    return monkeypatch


def test_missing_driver_means_no_cards(tmp_path: Path) -> None:
    cards = find_cards(str(tmp_path / "libcuda.so.1"))
    assert cards.usable == []
    assert len(cards.refused) == 1
    assert "the NVIDIA driver's library cannot be loaded" in cards.refused[0]


def test_driver_without_cards(library: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAKE_CUDA_CARDS", "")
    assert find_cards(library) == ([], ["No graphics card is used: the NVIDIA driver finds none."])


def test_outdated_driver_is_reported(library: str, with_cards: pytest.MonkeyPatch) -> None:
    with_cards.setenv("FAKE_CUDA_VERSION", "11040")
    cards = find_cards(library)
    assert cards.usable == []
    assert "supports CUDA 11.4, and Rayfarm needs CUDA 12.1" in cards.refused[0]


def test_unsupported_card_is_reported_beside_a_usable_one(library: str, with_cards: pytest.MonkeyPatch) -> None:
    with_cards.setenv("FAKE_CUDA_CARDS", f"{OLD},{NEW}")
    cards = find_cards(library)
    assert cards.usable == [Card(1, "RTX Test", (8, 6), 8 << 30, 1, "02" * 16, cards.usable[0].driver)]
    assert cards.usable[0].driver.endswith(" (CUDA 13.0)")
    assert cards.refused == [
        "Card 0: GTX Test, 4 GiB, compute capability 6.1 is not used: Rayfarm needs compute capability 7.0 or higher."
    ]


def test_search_in_a_subprocess_keeps_the_reasons(library: str, with_cards: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with_cards.setenv("FAKE_CUDA_CARDS", f"{OLD},{NEW}")
    with_cards.setenv("LD_LIBRARY_PATH", str(Path(library).parent))
    cards = find_cards_before_fork()
    assert cards == find_cards(library)
    assert [getattr(each, "code", None) for each in cards.refused] == ["card-too-old"]


def test_unused_cards_have_a_reason(library: str, with_cards: pytest.MonkeyPatch) -> None:
    with_cards.setenv("FAKE_CUDA_CARDS", f"{NEW},{NEW},{OLD}")
    cards = find_cards(library)
    unused = reasons_unused(cards, cards.usable[:1])
    assert unused[0] == (
        "Card 1: RTX Test, 8 GiB, compute capability 8.6 is not used. To use it, start the worker with 1 in --gpu."
    )
    assert unused[1:] == cards.refused
    assert reasons_unused(cards, cards.usable) == cards.refused


def test_nvidia_hardware_is_detected_without_a_driver(tmp_path: Path) -> None:
    assert not has_nvidia_hardware(tmp_path)
    for name, vendor, kind in (("a", "0x8086", "0x030000"), ("b", "0x10de", "0x0c0330")):
        device = tmp_path / "sys/bus/pci/devices" / name
        device.mkdir(parents=True)
        (device / "vendor").write_text(f"{vendor}\n")
        (device / "class").write_text(f"{kind}\n")
    assert not has_nvidia_hardware(tmp_path)
    (device / "class").write_text("0x030200\n")
    assert has_nvidia_hardware(tmp_path)


def test_gpu_option_selects_cards(library: str, with_cards: pytest.MonkeyPatch) -> None:
    with_cards.setenv("FAKE_CUDA_CARDS", f"{NEW},{NEW},{OLD}")
    cards = find_cards(library)
    both = cards.usable
    assert chosen_cards("none", cards) == ([], True)
    assert chosen_cards("auto", cards) == (both, True)
    assert chosen_cards("auto", cards._replace(usable=[])) == ([], True)
    assert chosen_cards("all", cards) == (both, True)
    assert chosen_cards("only", cards) == (both, False)
    assert chosen_cards("1", cards) == (both[1:], True)
    assert chosen_cards("1,0,1", cards) == (both[::-1], True)
    for choice, said in (
        ("2", "no usable card 2"),
        ("0,7", "no usable card 7"),
        ("first", "'first'"),
        ("", "''"),
        ("-1", "'-1'"),
    ):
        with pytest.raises(CardsError, match=said):
            chosen_cards(choice, cards)


@pytest.mark.parametrize("choice", ("all", "only", "0"))
def test_missing_card_is_an_error_with_the_reason(choice: str, tmp_path: Path) -> None:
    with pytest.raises(CardsError, match=f"--gpu {choice}: .*library cannot be loaded"):
        chosen_cards(choice, find_cards(str(tmp_path / "none")))


def test_memory_is_copied_and_freed(library: str, with_cards: pytest.MonkeyPatch) -> None:
    device = Device(Driver(library), 0)
    there, back = np.arange(12.0).reshape(3, 4), np.zeros((3, 4))
    address = device.upload(there)
    device.download(address, back)
    assert (back == there).all()
    device.free(address)
    device.upload(np.zeros(0))
    device.close()


def test_driver_error_has_name_and_description(library: str, with_cards: pytest.MonkeyPatch) -> None:
    device = Device(Driver(library), 0)
    said = r"cuModuleLoadDataEx failed: PTX is invalid \(CUDA_ERROR_INVALID_PTX\): ptxas: there is no entry"
    with pytest.raises(DriverError, match=said) as error:
        device.load("nothing", ["render"])
    assert error.value.code == "CUDA_ERROR_INVALID_PTX"
    with pytest.raises(DriverError, match="lacks the function cuNone"):
        Driver(library).call("cuNone")
    device.close()


@pytest.fixture
def card(library: str, with_cards: pytest.MonkeyPatch, tmp_path: Path) -> CardRenderer:
    with_cards.setenv("FAKE_CUDA_KERNEL", str(shared_object("plain", tmp_path)))
    return CardRenderer(find_cards(library).usable[0], library)


def test_card_frame_equals_the_cpu_frame(card: CardRenderer) -> None:
    for name in ("diffuse", "a sky's picture", "diffuse"):
        scene, settings = made(name)
        of_card, of_cpu = RenderStats(), RenderStats()
        film = render_frame(scene, settings, 3, stats=of_card, card=card)
        assert (film == render_frame(scene, settings, 3, stats=of_cpu)).all()
        assert (of_card.samples, of_card.rays) == (of_cpu.samples, of_cpu.rays)
    card.close()


def test_card_batch_equals_the_cpu_batch(card: CardRenderer) -> None:
    scene, settings = made("glass")
    tile = Tile(5, 7, 9, 4)
    assert (render_batch(scene, settings, tile, 2, 5, card).sums == render_batch(scene, settings, tile, 2, 5).sums).all()


def test_card_draft_has_the_bits_of_the_cores(card: CardRenderer) -> None:
    """Drafts of one size after another and of whole batches between them: each begins with an empty film."""
    scene, settings = made("diffuse")
    whole, corner = Tile(0, 0, settings.width, settings.height), Tile(5, 7, 9, 4)
    for tile, first, count, exposure in ((whole, 0, 4, 0.0), (whole, 0, 4, 0.0), (corner, 2, 3, 2.5), (whole, 0, 1, -3.0)):
        sums = render_batch(scene, settings, tile, first, count).sums
        for is_smooth in (False, True):
            wanted = draft_of(sums, settings.film_exponent, exposure, is_smooth=is_smooth)
            assert (render_draft(scene, settings, tile, first, count, card, exposure, is_smooth=is_smooth) == wanted).all()
        assert len(np.unique(draft_of(sums, settings.film_exponent, exposure))) > 9
        assert (render_batch(scene, settings, corner, 0, 2, card).sums == render_batch(scene, settings, corner, 0, 2).sums).all()
    card.close()


def test_card_mattes_and_deep_pixels_equal_the_cpu_ones(card: CardRenderer, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, settings = made("glass")
    settings, tile = replace(settings, cryptomatte=4, deep=8), Tile(5, 7, 9, 4)
    of_cpu = render_batch(scene, settings, tile, 2, 5)
    for most in (1 << 20, 9 * 4 * 11 * 2):  # all at once, two samples a pixel at once
        monkeypatch.setattr("renderer.render._CARD_RECORDS", most)
        of_card = render_batch(scene, settings, tile, 2, 5, card)
        assert digest(of_card.sums, of_card.hits, of_card.deep) == digest(of_cpu.sums, of_cpu.hits, of_cpu.deep)
    assert len(of_cpu.hits.key) > 0
    assert len(of_cpu.deep.key) > 0


@pytest.mark.long
def test_card_pictures_by_wavelength_equal_the_cpu_ones(
    library: str, with_cards: pytest.MonkeyPatch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Spectra that files give; deep pixels, Cryptomatte and alpha over a shadow catcher, in several batches."""
    with_cards.setenv("FAKE_CUDA_KERNEL", str(shared_object("full-spectral", tmp_path)))
    card = CardRenderer(find_cards(library).usable[0], library)
    settings = RenderSettings(16, 12, VIEW, max_depth=6, spectral="on")
    over_a_catcher = replace(settings, background="transparent", deep=8, cryptomatte=2)
    for scene, wanted in ((room_by_spectra(), settings), (room_over_a_catcher(), over_a_catcher)):
        of_card, of_cpu = RenderStats(), RenderStats()
        film = render_frame(scene, wanted, 3, stats=of_card, card=card)
        of_pool = render_frame(scene, wanted, 3, stats=of_cpu)
        assert digest(film, of_card.hits, of_card.deep) == digest(of_pool, of_cpu.hits, of_cpu.deep)
        assert of_card.rays == of_cpu.rays
        tile = Tile(3, 2, 9, 7)
        monkeypatch.setattr("renderer.render._CARD_RECORDS", 9 * 7 * 13 * 2)  # two samples a pixel at once, if recorded
        found, sums = (render_batch(scene, wanted, tile, 1, 5, each) for each in (card, None))
        assert digest(found.sums, found.hits, found.deep) == digest(sums.sums, sums.hits, sums.deep)
    card.close()


@pytest.mark.long
def test_card_frame_by_light_equals_the_cpu_one_until_it_stops(
    library: str, with_cards: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Light groups and light paths in a frame that ends early; the card's memory for paths grows and shrinks with them."""
    with_cards.setenv("FAKE_CUDA_KERNEL", str(shared_object("plain-paths-groups", tmp_path)))
    card = CardRenderer(find_cards(library).usable[0], library)
    scene, settings = grouped("diffuse"), replace(made("diffuse")[1], light_paths="on")
    for groups in (",".join(GROUPS), "sky"):
        wanted, passes = replace(settings, light_groups=groups), ([], [])

        def stops(sums: Any, seen: list[int]) -> bool:
            seen.append(int(sums[SAMPLES].max()))
            return seen[-1] >= 4 and bool(sums[COLOR].any())

        of_card, of_cpu = (
            render_frame(scene, wanted, 64, stop=partial(stops, seen=seen), card=each)
            for seen, each in zip(passes, (card, None), strict=True)
        )
        assert (of_card == of_cpu).all()
        assert passes[0] == passes[1]
        assert passes[0][-1] < 64
    card.close()


@pytest.mark.long  # builds the kernels of a variant for card and processor: two minutes of a core each,
@pytest.mark.timeout(1800)  # and a quarter of an hour on a machine with twenty other processes for each core
@pytest.mark.parametrize(
    ("kernel", "names"),
    (
        ("full-caustics", ("casters", "casters by copies")),
        ("media-caustics", ("casters by wax",)),
        ("moving-caustics", ("casters for a camera that moves",)),
        ("aimed-caustics", ("casters by lamps in glass",)),
        ("catchers-caustics", ("casters on a floor that reflects",)),
    ),
)
def test_card_frame_through_casters_equals_the_cpu_one(
    kernel: str, names: tuple[str, ...], library: str, with_cards: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """With mattes and deep pixels; then the self-test of that kernel."""
    with_cards.setenv("FAKE_CUDA_KERNEL", str(shared_object(kernel, tmp_path)))
    card = CardRenderer(find_cards(library).usable[0], library)
    for name in names:
        scene, settings = made(name)
        settings = replace(settings, cryptomatte=2, deep=8)
        of_card, of_cpu = RenderStats(), RenderStats()
        film = render_frame(scene, settings, 3, stats=of_card, card=card)
        of_pool = render_frame(scene, settings, 3, stats=of_cpu)
        assert digest(film, of_card.hits, of_card.deep) == digest(of_pool, of_cpu.hits, of_cpu.deep)
        assert of_card.rays == of_cpu.rays
    assert card.has_kernel(kernel)
    card.close()
    assert judge(card.card, kernel, library) == ("", True)


def test_few_paths_render_many_samples(card: CardRenderer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("renderer.cuda.turns._MOST_PATHS", 40)
    scene, settings = made("diffuse")
    tile = Tile(0, 0, 8, 8)
    sums = render_batch(scene, settings, tile, 0, 3, card).sums
    assert (sums[SAMPLES] == 3).all()
    assert (sums == render_batch(scene, settings, tile, 0, 3).sums).all()


@pytest.mark.long  # compiles the kernel that lists such samples
def test_card_omits_and_counts_nonfinite_samples(card: CardRenderer) -> None:
    scene, settings = made("diffuse")
    scene = scene._replace(environment=np.full((1, 1, 3), np.nan, np.float32))
    of_card, of_cpu = (render_batch(scene, settings, Tile(4, 6, 8, 4), 1, 2, each) for each in (card, None))
    assert of_card.bad_count == of_cpu.bad_count > 0
    assert sorted(of_card.bad) == sorted(of_cpu.bad)
    assert (of_card.sums == of_cpu.sums).all()


def test_scene_larger_than_gpu_memory_is_an_error(card: CardRenderer, with_cards: pytest.MonkeyPatch) -> None:
    with_cards.setenv("FAKE_CUDA_CARDS", "RTX Test:8:6:0")
    with pytest.raises(CardError, match=r"card 0 \(RTX Test\) has too little memory"):
        render_frame(*made("diffuse"), 1, card=card)


def test_unsupported_settings_are_an_error(card: CardRenderer) -> None:
    scene, settings = made("diffuse")
    with pytest.raises(SettingsError, match="a graphics card renders only with"):
        render_frame(scene, replace(settings, integrator="ao"), 1, card=card)


@pytest.fixture
def as_device(library: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes `rayfarm.render` find the test's fake driver."""
    monkeypatch.setattr(graphics_card, "find_cards", lambda: find_cards(library))
    monkeypatch.setattr(card_rendering, "CardRenderer", lambda card: CardRenderer(card, library))


def test_device_picture_equals_the_cpu_picture(as_device: None, with_cards: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with_cards.setenv("FAKE_CUDA_CARDS", f"{OLD},{NEW}")
    with_cards.setenv("FAKE_CUDA_KERNEL", str(shared_object("plain", tmp_path)))
    launched: list[int] = []
    launch = Device.launch
    with_cards.setattr(Device, "launch", lambda *given: (launched.append(given[0]._handle.value), launch(*given))[1])
    wanted = {"scene": ROOT / "scenes" / "cornell-box.yaml", "width": 12, "height": 9, "spp": 2, "max_depth": 4}
    of_cpu = rayfarm.render(**wanted, device="cpu")
    assert not launched
    for device in ("cuda", "cuda:1"):
        of_card = rayfarm.render(**wanted, device=device)
        assert all(np.array_equal(of_card[name], of_cpu[name]) for name in of_cpu)
    assert set(launched) == {1}
    *_, last = rayfarm.progressive(**wanted, device="cuda")
    assert np.array_equal(last["color"], of_cpu["color"])


def test_processor_renders_a_scene_larger_than_the_device_memory(
    as_device: None, with_cards: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with_cards.setenv("FAKE_CUDA_CARDS", "RTX Test:8:6:0")
    with_cards.setenv("FAKE_CUDA_KERNEL", str(shared_object("plain", tmp_path)))
    wanted = {"scene": ROOT / "scenes" / "cornell-box.yaml", "width": 12, "height": 9, "spp": 2, "max_depth": 4}
    with pytest.warns(UserWarning, match=r"card 0 \(RTX Test\) has too little memory, .*; the processor renders it"):
        found = rayfarm.render(**wanted, device="cuda")
    assert np.array_equal(found["color"], rayfarm.render(**wanted)["color"])


@pytest.mark.parametrize("device", ("cuda:0", "cuda:7"))
def test_missing_device_error_lists_available_devices(device: str, as_device: None, with_cards: pytest.MonkeyPatch) -> None:
    with_cards.setenv("FAKE_CUDA_CARDS", f"{OLD},{NEW}")
    said = rf"device is '{device}', and there is no such card. This machine's cards: 1: RTX Test, 8 GiB, .*'cpu' renders"
    with pytest.raises(SettingsError, match=said):
        rayfarm.render(ROOT / "scenes" / "cornell-box.yaml", device=device)


def test_device_without_driver_error_gives_the_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(graphics_card, "find_cards", lambda: find_cards(str(tmp_path / "libcuda.so.1")))
    with pytest.raises(SettingsError, match=r"device is 'cuda', .*library cannot be loaded"):
        rayfarm.render(ROOT / "scenes" / "cornell-box.yaml", device="cuda")


def test_card_results_of_a_worker_message_equal_the_cpu(card: CardRenderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tiles that are rendered in one launch on a graphics card are sent as separate results, bit-identical to the CPU's."""
    scene, settings = made("diffuse")
    tiles = tiles_of(settings.width, settings.height, 8)
    sent: list[Result] = []
    results = SimpleNamespace(send=sent.append)
    worker: Any = SimpleNamespace(name="w", cards=(card.card,), link=None, results=results)  # fetches nothing
    monkeypatch.setattr(slot_card, "_cards", {card.card.number: card})
    monkeypatch.setattr(slot_card, "mapped_scene", lambda worker, sha256: scene)
    card.load("plain")  # which is then tested already
    parts = [RenderBatch(str(k), "job", 0, "0" * 64, tile, 1, 3, settings) for k, tile in enumerate(tiles)]
    blocks: set[Tile] = set()
    slot_card.render_on_card(worker, CardBatches(tuple(parts)), lambda block, is_compiling: blocks.add(block.tile))
    assert blocks == {Tile(0, 0, settings.width, settings.height)}
    assert len(sent) == len(tiles)
    for result in sent:
        tile = tiles[int(result.event["batch"])]
        assert (unpack_sums(result.sums, tile) == render_batch(scene, settings, tile, 1, 3).sums).all()
    with_mattes = replace(settings, cryptomatte=4)
    parts = [replace(part, settings=with_mattes, packing=PACKED) for part in parts[:2]]
    slot_card.render_on_card(worker, CardBatches(tuple(parts)), lambda block, is_compiling: None)
    for result, tile in zip(sent[-2:], tiles, strict=False):
        found, wanted = unpack_hits(result.sums, tile), render_batch(scene, with_mattes, tile, 1, 3).hits
        assert all(np.array_equal(a, b) for a, b in zip(found, wanted, strict=True))
