"""Builds small .blend files for tests, following the file format."""

from __future__ import annotations

import struct

__all__ = ["blend"]

TYPES = {"char": 1, "ID": 24, "Library": 24 + 1024 + 8, "Thing": 1024 + 24 + 1024 + 2 * 1024, "bNodeSocketValueString": 1024}
TYPES |= {"bNode": 24 + 64, "Bake": 24 + 8, "Bakes": 2 * (24 + 8)}  # includes pointers of 8 bytes each
NAMES = ["name[24]", "id", "name[1024]", "*more", "path[1024]", "library", "value[1024]", "two[2][1024]"]
NAMES += ["idname[64]", "*bake_directory", "both[2]"]
STRUCTS = [
    ("ID", [("char", "name[24]")]),
    ("Library", [("ID", "id"), ("char", "name[1024]"), ("char", "*more")]),
    ("Thing", [("char", "path[1024]"), ("ID", "id"), ("char", "name[1024]"), ("char", "two[2][1024]")]),
    ("bNodeSocketValueString", [("char", "value[1024]")]),
    ("bNode", [("ID", "id"), ("char", "idname[64]")]),
    ("Bake", [("ID", "id"), ("char", "*bake_directory")]),
    ("Bakes", [("Bake", "both[2]")]),
]


def blend(*blocks: tuple[str, bytes], form: str = "BLENDER-v405", count: int = 1) -> bytes:
    """Returns a .blend file with the given blocks.

    blocks: pairs (name of a struct, the block's data); the data of a struct with an ID begin with that ID.
    form: the file header, from which byte order and pointer size follow.
    count: the number of structs that each block's header declares.
    """
    is_large = form[7] == "1"
    order, pointer = (">" if form[8] == "V" else "<"), ("I" if form[7] == "_" else "Q")
    kinds = [name for name, _ in STRUCTS]

    def block(code: bytes, kind: int, data: bytes) -> bytes:
        if is_large:
            return struct.pack("<4siQqq", code, kind, 7, len(data), count) + data
        return struct.pack(f"{order}4si{pointer}ii", code, len(data), 7, kind, count) + data

    found = form.encode()
    for kind, data in blocks:
        found += block(b"DATA", kinds.index(kind), data)
    return found + block(b"DNA1", 0, dna(order)) + block(b"ENDB", 0, b"")


def dna(order: str) -> bytes:
    types = list(TYPES)
    data = b"SDNANAME" + struct.pack(f"{order}i", len(NAMES)) + b"".join(name.encode() + b"\0" for name in NAMES)
    data = padded(data) + b"TYPE" + struct.pack(f"{order}i", len(types)) + b"".join(name.encode() + b"\0" for name in types)
    data = padded(data) + b"TLEN" + struct.pack(f"{order}{len(types)}h", *TYPES.values())
    data = padded(data) + b"STRC" + struct.pack(f"{order}i", len(STRUCTS))
    for name, fields in STRUCTS:
        data += struct.pack(f"{order}2h", types.index(name), len(fields))
        for kind, field in fields:
            data += struct.pack(f"{order}2h", types.index(kind), NAMES.index(field))
    return data


def padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)
