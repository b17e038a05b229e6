"""Tests of what the doctor says of graphics cards: their properties, and the result of their self-test."""

from __future__ import annotations

from pathlib import Path

import pytest

from rayfarm.doctor import machine
from renderer.cuda import cards, verdicts
from renderer.cuda.cards import Cards
from renderer.cuda.driver import Card, DriverError
from renderer.cuda.verdicts import Verdict, keep_verdict

CARD = Card(0, "RTX Test", (8, 6), 8 << 30, 1, "01", "570")
LABEL = "0: RTX Test, 8 GiB, compute capability 8.6"


def test_card_is_shown_with_the_result_of_its_self_test(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(cards, "find_cards", lambda: Cards([CARD], []))
    monkeypatch.setattr(verdicts, "private_folder", lambda name: tmp_path / name)

    def said() -> tuple[str, str]:
        (finding,) = machine._cards()
        return finding.level, finding.says

    assert said() == ("fine", f"Card {LABEL}; a worker tests it before it uses it ({cards.NOT_YET_TRIED}).")
    keep_verdict(CARD, "plain", "ptx", Verdict("", True))
    keep_verdict(CARD, "full", "ptx", Verdict("", True))
    assert said() == ("fine", f"Card {LABEL}; passed the self-test of the kernels full, plain ({cards.NOT_YET_TRIED}).")
    keep_verdict(CARD, "media", "ptx", Verdict("it computed other bits", True))
    assert said() == ("note", f"Card {LABEL} is not used: it computed other bits.")


@pytest.mark.parametrize(
    ("error", "advice"),
    (
        (DriverError("the NVIDIA driver's library cannot be loaded"), "Install NVIDIA's driver"),
        (DriverError("cuInit failed", "CUDA_ERROR_NO_DEVICE"), "`nvidia-smi` shows"),
        (DriverError("cuInit failed", "CUDA_ERROR_SYSTEM_DRIVER_MISMATCH"), "restart the machine"),
    ),
)
def test_advice_follows_where_a_machine_with_a_card_uses_none(
    error: DriverError, advice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(library: str) -> None:
        raise error

    monkeypatch.setattr(cards, "Driver", fail)
    monkeypatch.setattr(cards, "has_nvidia_hardware", lambda: True)
    (finding,) = machine._cards()
    assert (finding.level, advice in finding.do) == ("note", True)
    monkeypatch.setattr(cards, "has_nvidia_hardware", lambda: False)
    (finding,) = machine._cards()
    assert finding.level == ("note" if error.code.endswith("MISMATCH") else "fact")
