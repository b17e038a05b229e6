"""Tests of the PTX files, one per kernel variant, that are stored in the kernel cache."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from renderer import jit, kernel_file
from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.cuda import artefacts
from renderer.cuda.artefacts import kernel_name, path_of, ptx_of


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Returns an empty kernel cache folder, and replaces compilation by a stub that takes no time."""
    place = tmp_path / "0123456789abcdef"
    monkeypatch.setattr(jit, "cache_folder", lambda: place)
    monkeypatch.setattr(artefacts, "card_module_of", lambda variant: variant)
    monkeypatch.setattr(artefacts, "emit_ptx", lambda module: f"PTX of {module}")
    return place


def test_kernel_is_built_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert ptx_of("plain") == "PTX of plain"
    assert path_of("plain").stat().st_mode & 0o077 == 0
    monkeypatch.setattr(artefacts, "emit_ptx", lambda module: "built again")
    assert ptx_of("plain") == "PTX of plain"


@pytest.mark.parametrize("variant", [*KERNEL_VARIANTS, "moving-media-spectral"])
def test_gpu_kernel_is_shared_through_the_farm(
    variant: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ptx_of(variant)
    name = kernel_name(variant)
    assert kernel_file.is_name(kernel_file.name_of(folder, name))
    packed = io.BytesIO()
    kernel_file.pack(folder, name, "key", packed)
    other = tmp_path / "other" / folder.name
    monkeypatch.setattr(jit, "cache_folder", lambda: other)
    monkeypatch.setattr(artefacts, "emit_ptx", lambda module: "built again")

    def fetch(wanted: str) -> None:
        assert wanted == name
        packed.seek(0)
        kernel_file.unpack(packed, "key", other)

    assert ptx_of(variant, fetch) == f"PTX of {variant}"


def test_unwritable_cache_rebuilds_each_time(folder: Path) -> None:
    folder.mkdir(parents=True)
    (folder / "ptx").write_text("a file in the folder's place")
    assert ptx_of("plain") == "PTX of plain"
