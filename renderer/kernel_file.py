"""A kernel's machine code as one file: compiled by one host, loaded by every other host of its kind.

The file is a signed zip of files of the kernel cache folder (renderer.jit): 32 bytes of HMAC-SHA256 under a shared key, then the
zip. Numba stores machine code as pickles, and loading a pickle runs code, so only files with a valid signature are unpacked.
Does not need numba: folder and name are parameters.
"""

from __future__ import annotations

import hashlib
import hmac
import io
import os
import re
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import IO

from renderer.cache_folders import make_private
from renderer.zips import DAMAGED

__all__ = ["MAX_BYTES", "ArtefactError", "is_name", "is_signed", "name_of", "pack", "signed_anew", "unpack"]

MAX_BYTES = 64 << 20  # of the file; a folder with every kernel packs to a tenth
_MAX_UNPACKED = 4 * MAX_BYTES
_SIGNATURE = 32
_CHUNK = 1 << 20
_KERNEL = r"\w{1,40}(?:-\w{1,40}){1,6}"  # such as render_pool-moving-media, or with all suffixes of renderer/variant_names.py
_NAME = re.compile(rf"[0-9a-f]{{16}}-[a-z]+\d+-{_KERNEL}", re.ASCII)
_MEMBER = re.compile(rf"\w+(\.\w+)*/\w[\w.-]*\.code|{_KERNEL}\.done", re.ASCII)


class ArtefactError(Exception):
    """Raised for a file that is damaged, or not signed with the given key."""


def name_of(folder: Path, kernel: str) -> str:
    """Returns the name of a kernel's file: the folder's name (a hash of sources, compiler, target), Python version, kernel."""
    implementation = sys.implementation
    return f"{folder.name}-{implementation.name}{implementation.version.major}{implementation.version.minor}-{kernel}"


def is_name(text: str) -> bool:
    """Returns True if a text has the form of a kernel file's name, and so is safe as a part of a path."""
    return _NAME.fullmatch(text) is not None


def pack(folder: Path, kernel: str, key: str, out: IO[bytes]) -> None:
    """Writes a cached kernel as a signed kernel file. out: a file opened for reading and writing.

    Raises OSError if files of the kernel are missing in the cache folder.
    """
    start = out.tell()
    out.write(bytes(_SIGNATURE))
    with zipfile.ZipFile(out, "w") as archive:
        done = f"{kernel}.done"
        for member in (*(folder / done).read_text().split(), done):
            if _MEMBER.fullmatch(member):  # without its date: equal files make equal artefacts
                archive.writestr(zipfile.ZipInfo(member), (folder / member).read_bytes(), zipfile.ZIP_DEFLATED, 1)
    out.seek(start)
    signature = _signature(out, key)
    out.seek(start)
    out.write(signature)
    out.seek(0, os.SEEK_END)


def is_signed(file: IO[bytes], key: str) -> bool:
    """Returns True if a kernel file was signed with this key. Reads the file from its beginning."""
    expected = file.read(_SIGNATURE)
    file.seek(0)
    return hmac.compare_digest(expected, _signature(file, key))


def signed_anew(artefact: bytes, key: str) -> bytes:
    """Returns a copy of a kernel file that is signed with this key in place of its former signature."""
    return _signature(io.BytesIO(artefact), key) + artefact[_SIGNATURE:]


def unpack(file: IO[bytes], key: str, folder: Path) -> int:
    """Writes the files in a kernel file into the folder, each atomically; returns their number.

    Raises ArtefactError if the file is damaged or not signed with this key.
    """
    if not is_signed(file, key):
        raise ArtefactError("the kernels are not signed with this farm's token")
    file.seek(0)
    try:
        with zipfile.ZipFile(file) as archive:
            members = archive.infolist()
            if not all(_MEMBER.fullmatch(m.filename) for m in members) or sum(m.file_size for m in members) > _MAX_UNPACKED:
                raise ArtefactError("the kernels' archive holds what no archive of kernels holds")
            # The file that marks a kernel as complete is written last.
            for member in sorted(members, key=lambda m: m.filename.endswith(".done")):
                _write(folder / member.filename, archive.read(member))
    except DAMAGED as error:
        raise ArtefactError(f"the kernels' archive is damaged ({error})") from error
    return len(members)


def _signature(file: IO[bytes], key: str) -> bytes:
    """Returns the HMAC of the file's content from the current position, which is after the signature, to the end."""
    file.seek(_SIGNATURE)
    code = hmac.new(key.encode(), digestmod=hashlib.sha256)
    while chunk := file.read(_CHUNK):
        code.update(chunk)
    return code.digest()


def _write(path: Path, data: bytes) -> None:
    make_private(path.parent)
    with tempfile.NamedTemporaryFile(dir=path.parent, prefix=".part-", delete=False) as beside:
        try:
            beside.write(data)
            beside.flush()
            os.fsync(beside.fileno())
            Path(beside.name).replace(path)
        except BaseException:
            Path(beside.name).unlink(missing_ok=True)
            raise
