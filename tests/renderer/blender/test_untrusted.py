"""Tests of the copies that are made of .blend files: they refer only to uploaded files, and other references are rejected."""

from __future__ import annotations

import contextlib
import gzip
from pathlib import Path

import pytest

from renderer.blender.inside.untrusted import DamagedError, safe_copy
from tests.renderer.blender.files import blend

FORMS = ["BLENDER-v405", "BLENDER_v280", "BLENDER-V272", "BLENDER17-01v0500"]


def text(value: bytes, length: int = 1024) -> bytes:
    return value.ljust(length, b"\0")


def library(path: bytes) -> bytes:
    return text(b"LIother", 24) + text(path) + bytes(8)


def copied(tmp_path: Path, data: bytes, most: int = 1 << 20) -> bytes:
    source, target = tmp_path / "a.blend", tmp_path / "b.blend"
    source.write_bytes(data)
    safe_copy(source, target, lambda path: f"[{path}]", most)
    return target.read_bytes()


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("pack", [bytes, gzip.compress])
def test_only_paths_are_replaced(tmp_path, form, pack):
    data = blend(("Library", library(b"/home/else/secret.blend")), ("ID", text(b"IMname", 24)), form=form)
    expected = data.replace(text(b"/home/else/secret.blend"), text(b"[/home/else/secret.blend]"))
    assert expected != data
    assert copied(tmp_path, pack(data)) == expected


def test_paths_in_nested_structs_are_found(tmp_path):
    thing = text(b"/etc/passwd") + text(b"ID", 24) + text(b"<builtin>") + text(b"//a.png") + text(b"")
    words = text(b"/only/words/of/a/node")
    found = copied(tmp_path, blend(("Thing", 2 * thing), ("bNodeSocketValueString", words), count=2))
    assert found.count(text(b"[/etc/passwd]")) == found.count(text(b"[//a.png]")) == 2
    assert found.count(b"[") == 4 + found.count(b"[1024]") + sum(found.count(b"[%d]" % n) for n in (2, 24, 64))


def test_path_like_a_builtin_is_replaced(tmp_path):
    assert text(b"[<x>/../../etc/passwd]") in copied(tmp_path, blend(("Library", library(b"<x>/../../etc/passwd"))))


def test_import_nodes_and_pointer_paths_are_removed(tmp_path):
    node, other = (
        text(b"NTimport", 24) + text(b"GeometryNodeImportText", 64),
        text(b"NTmesh", 24) + text(b"GeometryNodeMeshLine", 64),
    )
    bake = text(b"BAone", 24) + 8 * b"\7"
    source = blend(("bNode", node + other), ("Bakes", 2 * bake))
    found = copied(tmp_path, source)
    assert found == source.replace(text(b"GeometryNodeImportText", 64), text(b"RayfarmLeftOut", 64)).replace(8 * b"\7", bytes(8))
    assert text(b"GeometryNodeMeshLine", 64) in found


def test_too_long_path_is_truncated(tmp_path):
    found = copied(tmp_path, blend(("Library", library(1024 * b"x"))))
    assert text(b"[" + 1022 * b"x") in found


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "is truncated"),
        (b"PK\x03\x04" + bytes(100), "is not a .blend file"),
        (b"BLENDER99-01v9900" + bytes(200), "newer Blender"),
        (blend()[:-40], "is truncated"),
        (gzip.compress(blend())[:-30], "cannot be unpacked"),
        (b"\x1f\x8b" + bytes(100), "cannot be unpacked"),
        (b"\x28\xb5\x2f\xfd" + bytes(100), "unpack"),
        (blend(("Library", library(b"x")[:500])), "shorter than its header says"),
        (blend().replace(b"SDNANAME", b"SDNAEMAN"), "damaged description"),
        (blend().replace(b"DNA1", b"DNA2"), "no description"),
    ],
)
def test_non_blend_file_is_an_error(tmp_path, data, says):
    with pytest.raises(DamagedError, match=says):
        copied(tmp_path, data)


def test_decompression_bomb_is_limited(tmp_path):
    bomb = gzip.compress(blend(("ID", bytes(100 << 20))))
    assert len(bomb) < 200_000
    with pytest.raises(DamagedError, match="unpacks to more"):
        copied(tmp_path, bomb)
    assert (tmp_path / "b.blend").stat().st_size <= 1 << 20


def test_every_mutated_file_is_copied_or_rejected(tmp_path):
    """Changing any one byte of a small file raises no unexpected exception and yields no copy above the size limit."""
    data = bytearray(blend(("Library", library(b"/x")), form=FORMS[0]))
    places = [*range(60), *range(len(data) - 700, len(data), 3)]
    for place in places:
        for value in (0, 255):
            kept, data[place] = data[place], value
            with contextlib.suppress(DamagedError):
                copied(tmp_path, bytes(data))
            data[place] = kept
            assert (tmp_path / "b.blend").stat().st_size <= 1 << 20
