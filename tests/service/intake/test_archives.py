"""Tests of zip archives: each kind of damage gives an error message, and zip bombs use little memory."""

from __future__ import annotations

import io
import tracemalloc
import zipfile
from pathlib import Path

import pytest

from service.errors import FarmError, Invalid, TooLarge
from service.intake.archives import extract_archive
from service.store.blobs import BlobFolder
from tests.grids import grid

METHODS = [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA]
OBJ = b"".join(b"v %d 0 1\n" % i for i in range(400))


@pytest.fixture
def store(tmp_path: Path) -> BlobFolder:
    return BlobFolder(tmp_path / "blobs", tmp_path / "tmp")


def zip_bytes(files: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return out.getvalue()


def unpack(store: BlobFolder, content: bytes, max_files: int = 10, max_bytes: int = 50 << 20) -> dict[str, bytes]:
    """Extracts a zip into blobs, reads these and deletes them; returns the files' contents by name."""
    found: dict[str, bytes] = {}
    for name, writer in extract_archive(
        io.BytesIO(content), "pack.zip", store, max_files, max_bytes, 100.0, lambda size: None, []
    ):
        found[name] = writer.rewind().read()
        writer.discard()
    return found


@pytest.mark.parametrize("method", METHODS)
def test_common_compression_methods_are_unpacked(store: BlobFolder, method: int) -> None:
    assert unpack(store, zip_bytes({"a/scene.obj": OBJ}, method)) == {"a/scene.obj": OBJ}


@pytest.mark.parametrize("method", METHODS)
def test_archive_with_damaged_byte_is_intact_or_rejected(store: BlobFolder, method: int) -> None:
    whole = zip_bytes({"scene.obj": OBJ}, method)
    refused = 0
    places = {*range(0, len(whole), max(1, len(whole) // 40)), *range(0, 60, 2), *range(len(whole) - 80, len(whole), 2)}
    for at in sorted(places):
        for value in (0x00, 0xFF, whole[at] ^ 0x10):
            damaged = whole[:at] + bytes([value]) + whole[at + 1 :]
            try:
                unpack(store, damaged)
            except FarmError as error:
                refused += 1
                assert str(error).endswith("."), error
            store.sweep(set())
    assert refused > 20


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_undecodable_data_is_reported_as_damaged(store: BlobFolder, method: int) -> None:
    whole = bytearray(zip_bytes({"scene.obj": OBJ}, method))
    start = whole.index(b"scene.obj") + len("scene.obj") + (9 if method == zipfile.ZIP_LZMA else 0)
    whole[start : start + 40] = b"\xff" * 40
    with pytest.raises(Invalid, match="damaged"):
        unpack(store, bytes(whole))


@grid("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA], ordinary=(zipfile.ZIP_DEFLATED,))
def test_zip_bomb_is_detected_early(store: BlobFolder, method: int) -> None:
    """A zip bomb, zeros in a few kilobytes with a directory that states a small size, is refused before it is in memory."""
    size = 96 << 20
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as archive, archive.open("scene.obj", "w", force_zip64=True) as file:
        for _ in range(size >> 20):
            file.write(bytes(1 << 20))
    bomb = out.getvalue().replace(size.to_bytes(8, "little"), (1000).to_bytes(8, "little"))
    bomb = bomb.replace(size.to_bytes(4, "little"), (1000).to_bytes(4, "little"))
    tracemalloc.start()
    try:
        with pytest.raises(FarmError):
            unpack(store, bomb)
        assert tracemalloc.get_traced_memory()[1] < 30 << 20
    finally:
        tracemalloc.stop()


def test_highly_compressible_file_gets_advice(store: BlobFolder) -> None:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("scene.obj", bytes(17 << 20))
    with pytest.raises(TooLarge, match=r"times its size, as zip bombs do\. If it is not one, unpack it and upload the folder\.$"):
        unpack(store, out.getvalue())


def test_oversized_directory_is_not_read(store: BlobFolder) -> None:
    entry = zip_bytes({"a.obj": b""})
    at = entry.index(b"PK\x01\x02")
    end = entry.index(b"PK\x05\x06")
    directory = entry[at:end] * 100_000
    tail = bytearray(entry[end:])
    tail[12:16] = len(directory).to_bytes(4, "little")
    with pytest.raises(TooLarge, match="lists far more than the 10"):
        unpack(store, entry[:at] + directory + bytes(tail))


@pytest.mark.parametrize("name", ["/etc/passwd", "../up.obj", "a/../../up.obj", "C:\\scene.obj", "a\nb.obj", "a\u2028b.obj"])
def test_unsafe_paths_are_rejected(store: BlobFolder, name: str) -> None:
    with pytest.raises(Invalid, match="file name"):
        unpack(store, zip_bytes({name: OBJ}))


def test_name_with_nul_is_rejected(store: BlobFolder) -> None:
    with pytest.raises(Invalid, match="control characters"):
        unpack(store, zip_bytes({"sceneX.obj": OBJ}).replace(b"sceneX", b"scene\0"))


def test_backslash_folders_are_folders(store: BlobFolder) -> None:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name in ("set\\", "set\\a.obj", "set\\..\\..\\b.obj"):
            entry = zipfile.ZipInfo(name)
            entry.create_system = 0
            archive.writestr(entry, b"" if name.endswith("\\") else OBJ)
    with pytest.raises(Invalid, match="leads out"):
        unpack(store, out.getvalue())
    assert list(unpack(store, out.getvalue().replace(b"set\\..\\..\\", b"set\\one\\2\\"))) == ["set/a.obj", "set/one/2/b.obj"]


def test_names_in_other_encodings_are_unpacked_with_note(store: BlobFolder) -> None:
    name = "木纹.png".encode("gbk")
    data = zip_bytes({"x\\m.mtl": b"map_Kd t.png", "t___.png": b"png"}).replace(b"t___.png", name)
    notes: list[str] = []
    found = {}
    for path, writer in extract_archive(io.BytesIO(data), "a.zip", store, 9, 999, 9.0, lambda size: None, notes):
        found[path] = writer.rewind().read()
        writer.discard()
    assert found == {"x/m.mtl": b"map_Kd t.png", "木纹.png": b"png"}
    assert notes == ["The archive does not state the encoding of 1 names; they are read as GBK."]
