"""Tests of the self-test of graphics cards: a card that computes other bits, or whose driver fails, is found."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.cuda import verdicts
from renderer.cuda.cards import Cards, find_cards
from renderer.cuda.driver import Card
from renderer.cuda.verdicts import (
    Verdict,
    discard_passing_failures,
    failed_kernels,
    failure_of,
    keep_verdict,
    kept_verdict,
    kernels_with_verdicts,
    run_self_test,
)
from renderer.render import kernel_name, variant_for
from renderer.scene.caustics import caustic_tables
from renderer.self_test import __main__ as self_test
from renderer.self_test.compare import judge
from renderer.self_test.scenes import SCENES, SelfTestScene, scenes_for, settings_for
from renderer.sentences import Sentence
from renderer.variant_names import example_of, variant_suffix
from tests.grids import grid
from tests.helpers import ROOT
from tests.renderer.cuda.on_host import fake_driver, shared_object, shared_objects

CARD = Card(0, "RTX Test", (8, 6), 8 << 30, 1, "01" * 16, "570.1 (CUDA 13.0)")
BROKEN = Sentence("card-test-ended", "it ended ({cause})", cause="SIGSEGV")


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(fake_driver(tmp_path_factory.mktemp("driver")))


@pytest.fixture
def card(library: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Card:
    """Returns the fake driver's card; child processes find the driver, too."""
    monkeypatch.setenv("FAKE_CUDA_CARDS", "RTX Test:8:6:8192")
    monkeypatch.setenv("LD_LIBRARY_PATH", str(Path(library).parent))
    monkeypatch.setattr(verdicts, "private_folder", lambda name: tmp_path / "cache" / name)
    return find_cards(library).usable[0]


@grid("scene", SCENES, ordinary=[SCENES[1]], ids=[scene.name for scene in SCENES])
def test_scene_uses_the_parts_of_a_kernel_that_it_is_for(scene: SelfTestScene) -> None:
    first = next(name for name, has in KERNEL_VARIANTS.items() if all(getattr(has, part) for part in scene.needs))
    assert variant_for(settings_for(first, scene), scene.compiled(first)) == first


def test_each_part_of_a_kernel_has_a_scene() -> None:
    parts = {part for has in KERNEL_VARIANTS.values() for part in has._fields if getattr(has, part)}
    assert {part for scene in SCENES for part in scene.needs} == parts
    assert [scene.name for scene in scenes_for("plain")] == ["surfaces"]
    assert scenes_for("moving-huang") == [*SCENES]
    of_caustics = scenes_for("moving-huang-caustics")
    assert parts - {part for scene in of_caustics for part in scene.needs} == {"pivots", "grids", "links", "visibility"}
    for kernel in ("full-caustics", "full-guided", "plain-paths-groups", "media-spectral"):
        (scene, *_), settings = scenes_for(kernel), example_of(kernel)[1]
        assert kernel.endswith(variant_suffix(settings_for(kernel, scene)))
        assert kernel_name(settings, "full") == kernel_name(settings_for(kernel, scene), "full")


@grid("scene", SCENES, ordinary=["surfaces", "skin"], ids=[scene.name for scene in SCENES])
def test_scene_has_caustics_if_tables_support_it(scene: SelfTestScene) -> None:
    assert (caustic_tables(scene.compiled("full-caustics")) is not None) == scene.has_caustics


def test_exact_card_passes(card: Card, library: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FAKE_CUDA_KERNEL", str(shared_object("plain", tmp_path)))
    assert judge(card, "plain", library) == ("", True)


@grid("stage", ["scatter_conductor", "start_paths", "shade_misses", "choose_lights"], ordinary=["scatter_conductor"])
def test_card_that_rounds_twice_in_one_stage_fails(
    stage: str, card: Card, library: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("FAKE_CUDA_KERNEL", str(shared_object("plain", tmp_path, unfused=stage)))
    reason, is_lasting = judge(card, "plain", library)
    assert is_lasting
    assert "it computed other bits in the self-test: " in reason
    assert " of 4096 pixels of the scene surfaces with kernel plain" in reason


def test_card_that_encodes_other_drafts_fails(card: Card, library: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FAKE_CUDA_KERNEL", str(shared_object("plain", tmp_path)))
    monkeypatch.setenv("FAKE_CUDA_FAULT", "skip:encode_draft")
    reason, is_lasting = judge(card, "plain", library)
    assert is_lasting
    assert " of 4096 pixels of the scene surfaces (draft) with kernel plain" in reason


def test_driver_error_fails_the_test(card: Card, library: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FAKE_CUDA_KERNEL", str(shared_object("plain", tmp_path)))
    monkeypatch.setenv("FAKE_CUDA_FAULT", "fail:shade_hits")
    reason, is_lasting = judge(card, "plain", library)
    assert not is_lasting
    assert "the self-test of kernel plain failed: card 0 (RTX Test) failed: cuLaunchKernel failed: unspecified launch" in reason


@pytest.mark.long  # each in a process
@pytest.mark.parametrize(
    ("fault", "said"),
    (
        ("", ""),
        ("abort:trace_rays", "the process of the self-test of kernel plain ended early (SIGABRT)"),
        ("hang:trace_rays", "the self-test of kernel plain did not end within 40 s"),
    ),
)
def test_verdict_of_a_process_is_kept(fault: str, said: str, card: Card, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FAKE_CUDA_KERNEL", str(shared_object("plain", tmp_path)))
    monkeypatch.setenv("FAKE_CUDA_FAULT", fault)
    verdict = run_self_test(card, "plain", limit_s=40.0 if fault.startswith("hang") else 300.0)
    assert verdict == (said, not said)
    assert failure_of(card) == (f"Card 0: RTX Test, 8 GiB, compute capability 8.6 is not used: {said}." if said else "")
    assert kernels_with_verdicts(card) == ["plain"]


@pytest.mark.long
def test_command_compares_both_kernels_of_a_start(card: Card, tmp_path: Path) -> None:
    """Plain and full, as before a worker uses a card; then with a driver that rounds twice in a stage of both."""
    command = [sys.executable, "-m", "renderer.self_test"]
    for unfused, code in (("", 0), ("scatter_conductor", 1)):
        kernels = shared_objects(("plain", "full"), tmp_path / f"kernels{code}", unfused)
        environment = {**os.environ, "FAKE_CUDA_KERNEL": str(kernels)}
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stdout + done.stderr
        said = done.stdout.splitlines()
        assert [": plain: " in said[0], ": full: " in said[1]] == [True, True]
        assert all(("other bits" if code else "films equal the processor's (surfaces") in line for line in said)


def test_command_tests_failed_kernels_again(card: Card, monkeypatch: pytest.MonkeyPatch) -> None:
    tested: list[str] = []

    def run(card: Card, kernel: str) -> Verdict:
        assert built == [*tested, kernel], "the test's time limit does not include the building"
        tested.append(kernel)
        return Verdict("", True)

    built: list[str] = []
    monkeypatch.setattr(self_test, "ptx_of", built.append)
    monkeypatch.setattr(self_test, "warm_up", lambda settings, variant: None)

    keep_verdict(card, "media", "ptx", Verdict(BROKEN, False))
    monkeypatch.setattr(self_test, "find_cards_before_fork", lambda: Cards([card], []))
    monkeypatch.setattr(self_test, "run_self_test", run)
    assert self_test.main([]) == 0
    assert tested == ["plain", "full", "media"]


def test_verdicts_belong_to_card_driver_and_ptx(card: Card) -> None:
    assert kept_verdict(CARD, "plain", "ptx") is None
    keep_verdict(CARD, "plain", "ptx", Verdict("", True))
    keep_verdict(CARD, "full", "ptx of full", Verdict(BROKEN, False))
    assert kept_verdict(CARD, "plain", "ptx") == ("", True)
    assert kept_verdict(CARD, "plain", "other ptx") is None
    kept = kept_verdict(CARD, "full", "ptx of full")
    assert kept is not None
    assert getattr(kept.reason, "code", "") == "card-test-ended"
    assert kernels_with_verdicts(CARD) == ["full", "plain"]
    assert failed_kernels(CARD) == ["full"]
    said = failure_of(CARD)
    assert said == "Card 0: RTX Test, 8 GiB, compute capability 8.6 is not used: it ended (SIGSEGV)."
    assert getattr(said, "code", "") == "card-unused"
    discard_passing_failures(CARD)
    assert failure_of(CARD) == ""
    assert kernels_with_verdicts(CARD) == ["plain"]
    for other in (CARD._replace(driver="575.2 (CUDA 13.0)"), CARD._replace(uuid="02" * 16)):
        assert kept_verdict(other, "plain", "ptx") is None
        assert failure_of(other) == ""


def test_damaged_verdicts_are_ignored(card: Card, tmp_path: Path) -> None:
    keep_verdict(CARD, "plain", "ptx", Verdict("", True))
    (path,) = (tmp_path / "cache" / "cards").iterdir()
    for damaged in ("", "[]", '{"plain": 3}', "{"):
        path.write_text(damaged)
        assert kept_verdict(CARD, "plain", "ptx") is None
        assert failure_of(CARD) == ""
