"""Tests of the measurement of kernels for graphics cards: results are kept, and kernels over their budget are found."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from tests.benchmarks import bench_kernels
from tests.benchmarks.bench_kernels import entries, exceeding, is_current, measure
from tests.renderer.cuda.budget import Used


@pytest.fixture
def assemblies(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Replaces the compilers; returns a list to which the architecture of each assembly is appended."""
    found: list[str] = []

    def assemble(assembler: str, ptx: Path, architecture: str) -> dict[str, Used]:
        found.append(architecture)
        return {"end_paths": Used(0, 0, 53), "encode_draft": Used(0, 0, 41 if architecture == "sm_90" else 40)}

    monkeypatch.setattr(bench_kernels, "ptx_of", lambda name: f"ptx of {name}")
    monkeypatch.setattr(bench_kernels, "assembled", assemble)
    monkeypatch.setattr(bench_kernels, "architectures", lambda assembler: ("sm_75", "sm_90"))
    monkeypatch.setattr(bench_kernels, "find_assembler", lambda: "ptxas")
    return found


def test_kernels_are_assembled_once_for_each_ptx(tmp_path: Path, assemblies: list[str]) -> None:
    state = tmp_path / "kernels.jsonl"
    measure("full", "ptxas", state)
    assert assemblies == ["sm_75", "sm_90"]
    entry = entries(state)["full"]
    assert is_current(entry)
    assert exceeding(entry) == {"sm_75": {}, "sm_90": {"encode_draft": Used(0, 0, 41)}}
    state.write_text(
        f'{json.dumps(entry | {"sources": "others"})}\n{{"kernel": "pla'
    )  # of other sources; a line that was cut off
    assert not is_current(entries(state)["full"])
    with state.open("a") as file:
        file.write("\n")
    measure("full", "ptxas", state)
    assert assemblies == ["sm_75", "sm_90"], "the PTX is the same"
    assert is_current(entries(state)["full"])


def test_table_names_kernels_over_their_budget(
    tmp_path: Path, assemblies: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    state = tmp_path / "kernels.jsonl"
    measure("full", "ptxas", state)
    monkeypatch.setattr(sys, "argv", ["bench_kernels", f"--state={state}", "full", "plain", "--minutes=0"])
    with pytest.raises(SystemExit) as ended:
        bench_kernels.main()
    said = capsys.readouterr().out
    assert ended.value.code == 1
    assert "over its budget: full for sm_90: encode_draft: Used(stack=0, spills=0, registers=41)" in said
    assert "1 of 2 kernels are left" in said
