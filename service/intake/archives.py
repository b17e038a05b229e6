"""Zip archives from strangers: expanded as a stream, with every bound checked on the bytes that really come out."""

from __future__ import annotations

import stat
import zipfile
import zlib
from collections.abc import Callable, Iterator
from typing import BinaryIO

from renderer.formats import is_junk
from service.api.problem import Problem
from service.intake.names import safe_name
from service.store.blobs import BlobStore
from service.store.staging import BlobWriter

__all__ = ["expand"]

CHUNK = 1 << 20
RATIO_FREE_BYTES = 16 << 20  # small files may shrink as well as they like
DAMAGED = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, UnicodeDecodeError, ValueError)


def expand(
    archive: BinaryIO,
    name: str,
    store: BlobStore,
    max_files: int,
    max_bytes: int,
    max_ratio: float,
    check_disk: Callable[[int], None],
) -> Iterator[tuple[str, BlobWriter]]:
    """The files of a zip: (relative path, written but not committed blob), junk and folders left out.

    The caller owns the writers it was given. check_disk(bytes) raises where the disk has no room for as many more.
    Raises Problem: 413 where the archive is too large in files, bytes or ratio, 422 where it is not a sane archive.
    """
    try:
        with zipfile.ZipFile(archive) as file:
            everything = [entry for entry in file.infolist() if not entry.is_dir()]
            for entry in everything:
                safe_name(entry.orig_filename.split("\0")[0])
            entries = [entry for entry in everything if not is_junk(entry.filename)]
            _judge(entries, name, max_files, max_bytes, max_ratio)
            left = max_bytes
            for entry in entries:
                writer = _extract(file, entry, name, store, left, max_ratio, check_disk)
                left -= writer.size
                yield safe_name(entry.filename), writer
    except DAMAGED as error:
        raise Problem(
            422, f"The archive {name} is damaged or of an unknown kind ({error}). Pack it again as a plain zip."
        ) from error


def _judge(entries: list[zipfile.ZipInfo], name: str, max_files: int, max_bytes: int, max_ratio: float) -> None:
    """Refuse what the directory itself admits, before anything is written."""
    if len(entries) > max_files:
        raise Problem(413, f"The archive {name} has {len(entries)} files; at most {max_files} are taken.")
    for entry in entries:
        if stat.S_ISLNK(entry.external_attr >> 16):
            raise Problem(422, f"The entry {entry.filename} of {name} is a symbolic link. Pack the file that it points to.")
        if entry.flag_bits & 0x1:
            raise Problem(422, f"The archive {name} is encrypted. Pack it again without a password.")
    total = sum(entry.file_size for entry in entries)
    packed = sum(entry.compress_size for entry in entries)
    if total > max_bytes:
        raise Problem(413, f"The archive {name} unpacks to {total} bytes; at most {max_bytes} are taken.")
    if total > RATIO_FREE_BYTES and total > max_ratio * max(packed, 1):
        raise Problem(413, f"The archive {name} unpacks to {total // max(packed, 1)} times its size, as zip bombs do.")


def _extract(
    file: zipfile.ZipFile,
    entry: zipfile.ZipInfo,
    name: str,
    store: BlobStore,
    left: int,
    max_ratio: float,
    check_disk: Callable[[int], None],
) -> BlobWriter:
    """One entry's bytes; its directory may lie, so the bounds are held against what comes out."""
    writer = store.writer()
    try:
        with file.open(entry) as source:
            while chunk := source.read(CHUNK):
                check_disk(len(chunk))
                writer.write(chunk)
                if writer.size > left:
                    raise Problem(413, f"The archive {name} unpacks to more than it says, as zip bombs do.")
                if writer.size > RATIO_FREE_BYTES and writer.size > max_ratio * max(entry.compress_size, 1):
                    raise Problem(
                        413,
                        f"The entry {entry.filename} of {name} unpacks to over {max_ratio:g} times its size, as zip bombs do.",
                    )
    except BaseException:
        writer.discard()
        raise
    return writer
