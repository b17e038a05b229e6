"""Blobs in an S3-compatible object store: AWS, MinIO, Ceph, R2. Needs obstore (the extra `s3`).

Address and credentials come from the usual environment variables: AWS_ENDPOINT_URL, AWS_REGION, AWS_ACCESS_KEY_ID,
AWS_SECRET_ACCESS_KEY; credentials also from files: AWS_ACCESS_KEY_ID_FILE ...
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any, BinaryIO, cast
from urllib.parse import urlsplit

import obstore
from obstore.exceptions import BaseError
from obstore.store import S3Store

from renderer.library_messages import library_message
from renderer.sentences import Sentence
from renderer.variables import FILE, value_of
from service.errors import NotFound, Unavailable
from service.store.blobs import CHUNK, MIN_AGE_S, ServedBlob, blob_not_found, is_sha256
from service.store.staging import BlobWriter, Staging

__all__ = ["S3Blobs", "open_bucket"]

IN_MEMORY = 8 << 20
CREDENTIALS = {
    "access_key_id": "AWS_ACCESS_KEY_ID",
    "secret_access_key": "AWS_SECRET_ACCESS_KEY",
    "session_token": "AWS_SESSION_TOKEN",
}
RETRIES = 5
TIMEOUT = timedelta(seconds=10)


class S3Blobs:
    """Blobs as objects `<prefix>/<first two hex digits>/<sha256>` of an S3 bucket. Uploads are first written to `temporary`."""

    is_local = False

    def __init__(self, url: str, temporary: Path) -> None:
        """Connects to a bucket. url: s3://bucket/prefix. temporary: folder for uploads."""
        self._bucket = urlsplit(url).netloc
        self._temporary = temporary
        self._staging = Staging(temporary)
        self._store = open_bucket(url)

    def writer(self) -> BlobWriter:
        """Returns a writer for a new blob, which is written to a temporary file."""
        return self._staging.writer(self.put)

    def put(self, writer: BlobWriter) -> None:
        """Uploads the bytes of a writer as a blob. The object appears once it is uploaded completely.

        Raises Unavailable if the bucket does not exist or does not respond.
        """
        try:
            with self._faults():
                obstore.put(self._store, _key(writer.sha256), writer.path)
        except NotFound:
            raise Unavailable(
                Sentence(
                    "object-store-bucket-missing",
                    "There is no bucket {bucket}. Create it, or set RAYFARM_BLOBS to another.",
                    bucket=self._bucket,
                )
            ) from None

    def open(self, sha256: str) -> BinaryIO:
        """Downloads a blob to a temporary file, and opens that for reading. Raises NotFound."""
        chunks = self.serve(sha256).chunks
        file = tempfile.SpooledTemporaryFile(IN_MEMORY, "w+b", dir=str(self._temporary))  # noqa: SIM115 - the caller closes it
        try:
            for chunk in chunks:
                file.write(chunk)
            file.seek(0)
        except BaseException:
            file.close()
            raise
        return cast(BinaryIO, file)

    def serve(self, sha256: str) -> ServedBlob:
        """Returns a blob's size and content in chunks, for a response. Raises NotFound."""
        with self._faults():
            found = obstore.get(self._store, _key(sha256))
            return ServedBlob(found.meta["size"], self._chunks(found))

    def exists(self, sha256: str) -> bool:
        """Returns True if the blob exists."""
        return self.size(sha256) is not None

    def size(self, sha256: str) -> int | None:
        """Returns the size of a blob in bytes, or None if it does not exist."""
        try:
            with self._faults():
                return obstore.head(self._store, _key(sha256))["size"]
        except NotFound:
            return None

    def delete(self, hashes: Collection[str], guard: Callable[[], None] = lambda: None) -> None:
        """Deletes the blobs with these hashes. Missing blobs are ignored. guard: raises FarmError if deleting is not allowed."""
        if hashes:
            guard()
            with self._faults():
                obstore.delete(self._store, [_key(sha256) for sha256 in hashes])

    def sweep(self, keep: set[str], older_than_s: float = MIN_AGE_S) -> set[str]:
        """Deletes remains of interrupted uploads, and blobs older than `older_than_s` seconds that are not in `keep`.

        Returns the hashes of younger blobs that are not in `keep`.
        """
        self._staging.sweep()
        old = time.time() - older_than_s
        with self._faults():
            strays = {
                name: item["last_modified"].timestamp() < old
                for page in obstore.list(self._store)
                for item in page
                if is_sha256(name := item["path"].rpartition("/")[2]) and name not in keep
            }
        self.delete([name for name, is_old in strays.items() if is_old])
        return {name for name, is_old in strays.items() if not is_old}

    def _chunks(self, found: obstore.GetResult) -> Iterator[bytes]:
        with self._faults():
            yield from (bytes(chunk) for chunk in found.stream(min_chunk_size=CHUNK))

    @contextmanager
    def _faults(self) -> Iterator[None]:
        try:
            yield
        except FileNotFoundError:
            raise blob_not_found() from None
        except BaseError as error:
            raise Unavailable(
                Sentence(
                    "object-store-failed",
                    "The object store failed ({reason}). Try again; check RAYFARM_BLOBS and AWS_*.",
                    reason=library_message(error),
                )
            ) from error


def open_bucket(url: str) -> S3Store:
    """Returns the bucket at s3://bucket/prefix, with keys relative to the prefix. It is not accessed yet."""
    address = urlsplit(url)
    return S3Store(
        address.netloc,
        prefix=address.path.strip("/") or None,
        **_credentials(),
        client_options={"allow_http": os.environ.get("AWS_ENDPOINT_URL", "").startswith("http://")},
        retry_config={"max_retries": RETRIES, "retry_timeout": TIMEOUT},
    )


def _credentials() -> dict[str, Any]:
    """Returns the credentials that are read from files (AWS_SECRET_ACCESS_KEY_FILE ...).

    Those in environment variables are read by obstore.
    """
    return {key: value_of(name) for key, name in CREDENTIALS.items() if os.environ.get(name + FILE)}


def _key(sha256: str) -> str:
    if not is_sha256(sha256):
        raise ValueError(f"{sha256!r} is not a SHA-256 hash in lower-case hexadecimal")
    return f"{sha256[:2]}/{sha256}"
