"""Streaming extraction of untrusted zip archives. Limits are checked against the bytes that are actually extracted."""

from __future__ import annotations

import errno
import stat
import zipfile
from collections.abc import Callable, Iterator
from typing import Any, BinaryIO, cast

from renderer.formats import is_junk
from renderer.library_messages import library_message
from renderer.sentences import Sentence
from renderer.zip_names import entry_names
from renderer.zips import DAMAGED
from service.errors import Invalid, TooLarge
from service.intake.names import safe_name
from service.intake.unpack import CHUNK, entry_chunks
from service.store.blobs import BlobStore
from service.store.staging import BlobWriter

__all__ = ["extract_archive"]

RATIO_FREE_BYTES = 16 << 20  # smaller files may have any compression ratio
DIRECTORY_BYTES_A_FILE = 512  # average size of a file's entry in the zip's directory

UNPACK_ADVICE = Sentence("archive-advice-unpack", "If it is not one, unpack it and upload the folder.")


def extract_archive(
    archive: BinaryIO,
    name: str,
    store: BlobStore,
    max_files: int,
    max_bytes: int,
    max_ratio: float,
    check_disk: Callable[[int], None],
    notes: list[str],
) -> Iterator[tuple[str, BlobWriter]]:
    """Yields the files of a zip archive as (relative path, written but uncommitted blob). Skips folders and junk files.

    The caller owns the writers. check_disk: called with a number of bytes before they are written; raises an error if the disk
    lacks space. notes: receives a sentence if the encoding of file names was guessed. Raises TooLarge if a limit on files, bytes
    or compression ratio is exceeded, Invalid if the archive is damaged or unsupported.
    """
    try:
        with zipfile.ZipFile(cast(BinaryIO, _Archive(archive, name, max_files))) as file:
            files = [entry for entry in file.infolist() if not entry.is_dir() and entry.filename[-1:] != "\\"]
            named = entry_names(file, files)
            everything = [(safe_name(name), entry) for name, entry in zip(named.names, files, strict=True)]
            found = [(path, entry) for path, entry in everything if not is_junk(path)]
            if named.guess is not None:
                notes.append(named.guess)
            entries = [entry for _, entry in found]
            _check_entries(entries, name, max_files, max_bytes, max_ratio)
            left = max_bytes
            for path, entry in found:
                writer = _extract(file, entry, name, store, left, max_ratio, check_disk)
                left -= writer.size
                yield path, writer
    except DAMAGED as error:
        raise _damaged_archive_error(name, error) from error
    except OSError as error:
        if error.errno in (None, errno.EINVAL):  # from bzip2: damaged data; from the file system: a negative offset
            raise _damaged_archive_error(name, error) from error
        raise


class _Archive:
    """File object around an archive that limits the size of each read.

    zipfile reads the archive's directory in one call, so a directory too large for `max_files` files raises TooLarge.
    """

    def __init__(self, file: BinaryIO, name: str, max_files: int) -> None:
        self._file = file
        self._limit = max(2 * CHUNK, max_files * DIRECTORY_BYTES_A_FILE)
        self._refusal = Sentence(
            "archive-directory-too-large",
            "The archive {name} lists far more than the {most} files allowed. Pack fewer files.",
            name=name,
            most=max_files,
        )

    def read(self, size: int = -1) -> bytes:
        """Reads up to `size` bytes. Raises TooLarge if `size` exceeds what a directory of `max_files` files needs."""
        if size > self._limit:
            raise TooLarge(self._refusal)
        return self._file.read(size)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def _damaged_archive_error(name: str, error: Exception) -> Invalid:
    return Invalid(
        Sentence(
            "archive-unreadable",
            "The archive {name} is damaged or of an unknown format ({error}). Pack it again as a plain zip.",
            name=name,
            error=library_message(error),
        )
    )


def _check_entries(entries: list[zipfile.ZipInfo], name: str, max_files: int, max_bytes: int, max_ratio: float) -> None:
    """Checks the entries in the archive's directory, before any of them is extracted.

    Raises TooLarge if a limit is exceeded, Invalid for unsupported entries.
    """
    if len(entries) > max_files:
        raise TooLarge(
            Sentence(
                "archive-files-too-many",
                "The archive {name} has {count} files; at most {most} are allowed.",
                name=name,
                count=len(entries),
                most=max_files,
            )
        )
    for entry in entries:
        if stat.S_ISLNK(entry.external_attr >> 16):
            raise Invalid(
                Sentence(
                    "archive-entry-symlink",
                    "The entry {entry} of {name} is a symbolic link. Pack the file that it points to.",
                    entry=entry.filename,
                    name=name,
                )
            )
        if entry.flag_bits & 0x1:
            raise Invalid(
                Sentence("archive-encrypted", "The archive {name} is encrypted. Pack it again without a password.", name=name)
            )
    total = sum(entry.file_size for entry in entries)
    packed = sum(entry.compress_size for entry in entries)
    if total > max_bytes:
        raise TooLarge(
            Sentence(
                "archive-too-large",
                "The archive {name} unpacks to {size} bytes; at most {most} are allowed.",
                name=name,
                size=total,
                most=max_bytes,
            )
        )
    if total > RATIO_FREE_BYTES and total > max_ratio * max(packed, 1):
        raise TooLarge(
            Sentence(
                "archive-zip-bomb",
                "The archive {name} unpacks to {size} times its size, as zip bombs do. {advice}",
                name=name,
                size=total // max(packed, 1),
                advice=UNPACK_ADVICE,
            )
        )


def _extract(
    file: zipfile.ZipFile,
    entry: zipfile.ZipInfo,
    name: str,
    store: BlobStore,
    bytes_left: int,
    max_ratio: float,
    check_disk: Callable[[int], None],
) -> BlobWriter:
    """Extracts one entry to a new blob and returns the blob's writer.

    bytes_left: bytes that may still be extracted. The sizes in the directory can be wrong, so the extracted bytes are checked.
    """
    writer = store.writer()
    try:
        for piece in entry_chunks(file, entry):
            check_disk(len(piece))
            writer.write(piece)
            if writer.size > bytes_left:
                raise TooLarge(
                    Sentence(
                        "archive-size-misdeclared",
                        "The archive {name} unpacks to more than its stated size, as zip bombs do. {advice}",
                        name=name,
                        advice=UNPACK_ADVICE,
                    )
                )
            if writer.size > RATIO_FREE_BYTES and writer.size > max_ratio * max(entry.compress_size, 1):
                raise TooLarge(
                    Sentence(
                        "archive-entry-zip-bomb",
                        "The entry {entry} of {name} unpacks to over {ratio} times its size, as zip bombs do. {advice}",
                        entry=entry.filename,
                        name=name,
                        ratio=f"{max_ratio:g}",
                        advice=UNPACK_ADVICE,
                    )
                )
        writer.close_file()
    except BaseException:
        writer.discard()
        raise
    return writer
