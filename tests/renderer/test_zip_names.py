"""Tests of file names in zip archives without a declared encoding, or with Windows separators."""

import io
import struct
import zipfile
import zlib

import pytest

from renderer.zip_names import entry_names

MTL = b"newmtl a\nmap_Kd %s\n"


def zipped(files, extra=b""):
    """Returns a zip whose names are raw bytes, without the UTF-8 flag."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(f"?{len(name):02}" + "x" * (len(name) - 3))
            entry.extra = extra if not name.isascii() else b""
            archive.writestr(entry, content)
    data = out.getvalue()
    for name in files:
        data = data.replace(b"?%02d" % len(name) + b"x" * (len(name) - 3), name)
    return data


def names_of(data):
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return entry_names(archive, archive.infolist())


def test_backslashes_are_separators():
    assert names_of(zipped({b"a\\m.obj": b"", b"a\\tex\\wood.png": b"", b"a/b\\c.png": b""})).names == [
        "a/m.obj",
        "a/tex/wood.png",
        "a/b/c.png",
    ]


@pytest.mark.parametrize(
    ("name", "encoding", "title"),
    [
        ("木纹贴图.png", "gbk", "GBK"),
        ("木目テクス.png", "cp932", "Shift-JIS"),
        ("Tür.png", "cp437", "CP437"),
        ("木紋貼圖.png", "big5", "Big5"),
    ],
)
def test_encoding_is_guessed_and_reported(name, encoding, title):
    found = names_of(zipped({b"scene.obj": b"", name.encode(encoding): b""}))
    if encoding != "big5":  # Big5's letters are valid in other encodings too
        assert found.names == ["scene.obj", name]
        assert found.guess == f"The archive does not state the encoding of 1 names; they are read as {title}."
    with_use = names_of(zipped({b"scene.mtl": MTL % name.encode(), name.encode(encoding): b""}))
    assert with_use.names[1] == name  # names mentioned in the scene files decide the encoding


def test_declared_encoding_is_used():
    assert names_of(zipped({"дерево.png".encode(): b""})) == (["дерево.png"], None)  # UTF-8 without its flag
    raw = "木纹.png".encode("gbk")
    field = struct.pack("<BI", 1, zlib.crc32(raw)) + "木目.png".encode()
    assert names_of(zipped({raw: b""}, struct.pack("<HH", 0x7075, len(field)) + field)) == (["木目.png"], None)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("木.png", b"")
    assert names_of(out.getvalue()) == (["木.png"], None)
