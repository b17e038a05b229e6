"""Tests of packing compiled kernels into one signed file: only files signed with the key are unpacked."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import pytest

from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.kernel_file import ArtefactError, is_name, is_signed, name_of, pack, unpack

KERNEL = "render_pool-plain"
FILES = {
    "kernel.path/path._render-1.py311.0123456789abcdef.code": b"code" * 999,
    "render_pool-plain.done": b"kernel.path/path._render-1.py311.0123456789abcdef.code\n",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "0123456789abcdef"
    for name, data in FILES.items():
        path = made / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    (made / "render_pool-plain.lock").touch()
    (made / "kernel.path" / ".part-x").touch()
    (made / "kernel.path" / "path._render-1.py311.00000000000000ff.code").write_bytes(b"of another kernel")
    (made / "render_pool-full.done").touch()
    return made


def packed(folder: Path, key: str = "token", kernel: str = KERNEL) -> io.BytesIO:
    file = io.BytesIO()
    pack(folder, kernel, key, file)
    file.seek(0)
    return file


def signed(archive: bytes) -> io.BytesIO:
    """Returns an open file with these bytes, signed like a kernel file."""
    import hashlib
    import hmac

    return io.BytesIO(hmac.new(b"token", archive, hashlib.sha256).digest() + archive)


def test_kernel_file_round_trip(folder: Path, tmp_path: Path) -> None:
    assert unpack(packed(folder), "token", tmp_path / "other") == len(FILES)
    found = {p.relative_to(tmp_path / "other").as_posix(): p.read_bytes() for p in (tmp_path / "other").rglob("*") if p.is_file()}
    assert found == FILES


def test_unsigned_kernel_file_is_not_unpacked(folder: Path, tmp_path: Path) -> None:
    good = packed(folder).getvalue()
    for at in (0, 31, 32, len(good) // 2, len(good) - 1):
        bad = bytearray(good)
        bad[at] ^= 1
        with pytest.raises(ArtefactError, match="not signed"):
            unpack(io.BytesIO(bytes(bad)), "token", tmp_path / "other")
    for data in (b"", good[:20], good[:-1], good + b"x"):
        with pytest.raises(ArtefactError):
            unpack(io.BytesIO(data), "token", tmp_path / "other")
    assert not is_signed(packed(folder), "another token")
    assert is_signed(packed(folder), "token")
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize("name", ["../outside.code", "/etc/passwd", "a/b/c.code", "a/evil.py", "a\\..\\b.code", "x.done/y"])
def test_paths_in_kernel_files_are_rejected(tmp_path: Path, name: str) -> None:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(name, b"x")
    with pytest.raises(ArtefactError, match="holds what no archive"):
        unpack(signed(file.getvalue()), "token", tmp_path / "other")


def test_non_archive_bytes_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(ArtefactError, match="damaged"):
        unpack(signed(b"no zip at all"), "token", tmp_path / "other")


@pytest.mark.parametrize("variant", [*KERNEL_VARIANTS, "moving-media-paths-groups-spectral"])
def test_every_variants_kernel_can_be_shared(variant: str, tmp_path: Path) -> None:
    kernel, folder = f"render_pool-{variant}", tmp_path / "0123456789abcdef"
    folder.mkdir()
    (folder / f"{kernel}.done").write_text("")
    assert is_name(name_of(folder, kernel))
    assert unpack(packed(folder, kernel=kernel), "token", tmp_path / "other") == 1
    assert (tmp_path / "other" / f"{kernel}.done").exists()


def test_names(folder: Path) -> None:
    for name in (
        "",
        "..",
        "0123456789abcdef",
        "0123456789abcdef-cpython311",
        "0123456789abcdef-cpython311-a-b/x",
        "0123456789ABCDEF-cpython311-a-b",
        "x" * 300,
    ):
        assert not is_name(name)
