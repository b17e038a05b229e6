"""Streaming parser of multipart/form-data: writes files to disk in chunks and enforces all limits while it reads."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from typing import Any

from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.concurrency import run_in_threadpool

from renderer.library_messages import library_message
from renderer.sentences import Sentence
from service.errors import Invalid, TooLarge, UnknownFormat
from service.store.blobs import BlobStore
from service.store.staging import BlobWriter

__all__ = ["Form", "read_form"]

MAX_FIELD = 4096
MAX_FIELDS = 32
MAX_HEADER = 8192


@dataclass
class Form:
    """A received form. The owner of `files` must commit or discard their writers."""

    fields: dict[str, str] = field(default_factory=dict)
    files: list[tuple[str, BlobWriter]] = field(default_factory=list)

    def discard(self) -> None:
        """Discards the written files that were not committed."""
        for _, writer in self.files:
            writer.discard()
        self.files.clear()


async def read_form(
    content_type: str,
    chunks: AsyncIterator[bytes],
    store: BlobStore,
    max_files: int,
    max_bytes: int,
    check_disk: Callable[[int], None],
) -> Form:
    """Reads a form with files, and returns it with the files written to disk.

    Raises TooLarge if a limit is exceeded, UnknownFormat for another media type, Invalid for malformed data.
    """
    media, options = parse_options_header(content_type)
    if media != b"multipart/form-data" or not options.get(b"boundary"):
        raise UnknownFormat(
            Sentence(
                "upload-not-multipart",
                "Send the files as multipart/form-data, for example: curl -F files=@scene.glb URL/api/scenes",
            )
        )
    reader = _Reader(store, max_files)
    callbacks: Any = {name: getattr(reader, name) for name in dir(reader) if name.startswith("on_")}
    total = 0
    try:
        parser = MultipartParser(options[b"boundary"], callbacks)

        def write_piece(piece: bytes) -> None:
            check_disk(len(piece))
            parser.write(piece)

        async for piece in chunks:
            total += len(piece)
            if total > max_bytes:
                raise TooLarge(
                    Sentence(
                        "upload-too-large",
                        "The upload is larger than the {most} bytes allowed. Leave files out, or ask the administrator of "
                        "this farm.",
                        most=max_bytes,
                    )
                )
            await run_in_threadpool(write_piece, piece)
        if not reader.ended:
            raise Invalid(Sentence("upload-interrupted", "The upload was interrupted. Send it again."))
    except FormParserError as error:
        reader.discard()
        raise Invalid(
            Sentence(
                "upload-malformed",
                "The upload is not well-formed multipart/form-data ({error}). Send it again.",
                error=library_message(error),
            )
        ) from error
    except BaseException:
        reader.discard()
        raise
    return reader.form


class _Reader:
    """Callbacks that receive the events of the multipart parser. Data is passed as (buffer, start, end)."""

    def __init__(self, store: BlobStore, max_files: int) -> None:
        self.form = Form()
        self.ended = False
        self._store = store
        self._max_files = max_files
        self._name = b""
        self._value = b""
        self._disposition = b""
        self._field = ""
        self._text = bytearray()
        self._writer: BlobWriter | None = None

    def discard(self) -> None:
        self.form.discard()

    def on_part_begin(self) -> None:
        self._disposition = self._name = self._value = b""
        self._text = bytearray()
        self._writer = None

    def on_header_field(self, data: bytes, start: int, end: int) -> None:
        self._name = self._check_header_size(self._name + data[start:end])

    def on_header_value(self, data: bytes, start: int, end: int) -> None:
        self._value = self._check_header_size(self._value + data[start:end])

    def on_header_end(self) -> None:
        if self._name.lower() == b"content-disposition":
            self._disposition = self._value
        self._name = self._value = b""

    def on_headers_finished(self) -> None:
        _, options = parse_options_header(self._disposition)
        try:
            self._field = options.get(b"name", b"").decode()
            filename = _unescape(options[b"filename"].decode()) if b"filename" in options else None
        except UnicodeDecodeError:
            raise Invalid(
                Sentence("upload-name-not-utf-8", "A name in the upload is not UTF-8. Rename the file and send it again.")
            ) from None
        if filename is None:
            if len(self.form.fields) >= MAX_FIELDS:
                raise TooLarge(
                    Sentence("upload-fields-too-many", "The form has more than {most} fields. Send fewer.", most=MAX_FIELDS)
                )
            return
        if len(self.form.files) >= self._max_files:
            raise TooLarge(
                Sentence(
                    "upload-files-too-many",
                    "The upload has more than {most} files. Pack only what the scene needs.",
                    most=self._max_files,
                )
            )
        self._writer = self._store.writer()
        self.form.files.append((filename, self._writer))

    def on_part_data(self, data: bytes, start: int, end: int) -> None:
        if self._writer is not None:
            self._writer.write(data[start:end])
        elif len(self._text) + end - start > MAX_FIELD:
            raise TooLarge(
                Sentence(
                    "upload-field-too-long",
                    "The field {field} is longer than {most} bytes. Shorten it.",
                    field=repr(self._field[:60]),
                    most=MAX_FIELD,
                )
            )
        else:
            self._text += data[start:end]

    def on_part_end(self) -> None:
        if self._writer is not None:
            self._writer.close_file()
        else:
            try:
                self.form.fields[self._field] = self._text.decode()
            except UnicodeDecodeError:
                raise Invalid(
                    Sentence(
                        "upload-field-not-utf-8",
                        "The field {field} is not UTF-8. Send it as UTF-8.",
                        field=repr(self._field[:60]),
                    )
                ) from None

    def on_end(self) -> None:
        self.ended = True

    @staticmethod
    def _check_header_size(header: bytes) -> bytes:
        if len(header) > MAX_HEADER:
            raise TooLarge(
                Sentence(
                    "upload-header-too-long",
                    "A header in the upload is longer than {most} bytes. Shorten the file names.",
                    most=MAX_HEADER,
                )
            )
        return header


def _unescape(filename: str) -> str:
    """Decodes the three escapes that browsers use in file names (HTML Standard, "multipart/form-data encoding algorithm")."""
    return filename.replace("%22", '"').replace("%0D", "\r").replace("%0A", "\n")
