"""Converts messages of the operating system and of libraries, which are in English only, to sentences with codes.

The codes make them translatable. An unknown message is returned unchanged.
"""

from __future__ import annotations

import errno
import json
import re
import zipfile
import zlib
from xml.etree import ElementTree
from xml.parsers import expat

from renderer.sentences import Sentence

__all__ = ["library_message", "position_in_text"]

_MAX_CHARACTERS = 200  # characters of a message

_SYSTEM_MESSAGES: dict[int, str] = {
    errno.ENOENT: Sentence("os-not-found", "No such file or directory"),
    errno.EACCES: Sentence("os-permission-denied", "Permission denied"),
    errno.EPERM: Sentence("os-not-permitted", "Operation not permitted"),
    errno.ENOSPC: Sentence("os-no-space-left", "No space left on device"),
    errno.EDQUOT: Sentence("os-quota-exceeded", "Disk quota exceeded"),
    errno.EROFS: Sentence("os-read-only", "Read-only file system"),
    errno.EMFILE: Sentence("os-too-many-files", "Too many open files"),
    errno.ENFILE: Sentence("os-too-many-files-in-system", "Too many open files in system"),
    errno.ENOMEM: Sentence("os-out-of-memory", "Cannot allocate memory"),
    errno.EAGAIN: Sentence("os-temporarily-unavailable", "Resource temporarily unavailable"),
    errno.EIO: Sentence("os-input-output", "Input/output error"),
    errno.ENAMETOOLONG: Sentence("os-name-too-long", "File name too long"),
    errno.EISDIR: Sentence("os-is-directory", "Is a directory"),
    errno.ENOTDIR: Sentence("os-not-directory", "Not a directory"),
    errno.EFBIG: Sentence("os-file-too-large", "File too large"),
    errno.EINVAL: Sentence("os-invalid-argument", "Invalid argument"),
    errno.ECONNREFUSED: Sentence("os-connection-refused", "Connection refused"),
    errno.ECONNRESET: Sentence("os-connection-reset", "Connection reset by peer"),
    errno.ETIMEDOUT: Sentence("os-timed-out", "Connection timed out"),
    errno.EADDRINUSE: Sentence("os-address-in-use", "Address already in use"),
}


# Messages of Redis, its client and SQLite: the errors have no codes of their own, or only the text contains them.
_TEXT_MESSAGES: tuple[tuple[str, str], ...] = (
    (r"Connection closed by server|closed the connection", Sentence("connection-closed", "the connection was closed")),
    (r"Timeout (reading|connecting|writing)|timed out", Sentence("connection-timeout", "no answer in time")),
    (r"WRONGPASS|invalid username-password|invalid password", Sentence("redis-password-wrong", "wrong user name or password")),
    (r"NOAUTH|Authentication required", Sentence("redis-password-missing", "a password is required")),
    (r"max number of clients", Sentence("redis-clients-full", "too many clients are connected")),
    (r"NOPERM|no permissions", Sentence("redis-no-permission", "its user lacks a permission")),
    (r"database is locked", Sentence("sqlite-locked", "the database is locked")),
    (r"disk image is malformed", Sentence("sqlite-malformed", "the database file is malformed")),
    (r"file is not a database", Sentence("sqlite-not-a-database", "file is not a database")),
    (r"disk I/O error", Sentence("sqlite-disk-error", "disk I/O error")),
    (r"unable to open database file", Sentence("sqlite-not-openable", "the database file cannot be opened")),
    (r"attempt to write a readonly database", Sentence("sqlite-read-only", "the database is read-only")),
    (r"database or disk is full", Sentence("sqlite-full", "the disk is full")),
)
_CERTIFICATE = re.compile(r"certificate verify failed(?:: ([^(\n]+))?")  # the number of TLS errors is no errno of the system
_ERRNO = re.compile(r"\[Errno (-?\d+)\]")
_CONNECTING = re.compile(r"Error (\d+) connecting to ([^ ]+)\.")  # of Redis's client
# Errors of the object store's client, by class.
_STORE_MESSAGES: dict[str, str] = {
    "PermissionDeniedError": Sentence("store-permission-denied", "access is denied"),
    "UnauthenticatedError": Sentence("store-unauthenticated", "the credentials are not accepted"),
    "NotFoundError": Sentence("store-not-found", "the bucket or object does not exist"),
}


def position_in_text(line: int, column: int) -> Sentence:
    """Returns the place of a fault in a text, both from 1."""
    return Sentence("json-position", "line {line}, column {column}", line=line, column=column)


def library_message(error: BaseException) -> str:
    """Returns the message of an exception of the system or of a library: a Sentence with a code if the message is known."""
    own = str(error)
    if isinstance(own, Sentence):
        return own
    if isinstance(error, (expat.ExpatError, ElementTree.ParseError)):
        return _of_xml(error)
    if isinstance(error, json.JSONDecodeError):
        return position_in_text(error.lineno, error.colno)
    if isinstance(error, zipfile.BadZipFile) and own == "File is not a zip file":
        return Sentence("zip-not-an-archive", "it is not a zip file")
    if isinstance(error, zlib.error):
        return Sentence("compressed-data-damaged", "its compressed data is damaged")
    if isinstance(error, EOFError):
        return Sentence("data-ends-early", "its data ends early")
    if isinstance(error, UnicodeDecodeError):
        return Sentence("text-not-in-encoding", "byte {place} is not {encoding}", place=error.start, encoding=error.encoding)
    if isinstance(error, KeyError):
        return Sentence("key-missing", "it lacks {name}", name=repr(error.args[0])[:60] if error.args else "?")
    if (found := _CERTIFICATE.search(own)) is not None:
        reason = (found[1] or "no reason given").strip()
        return Sentence("tls-certificate-rejected", "certificate verify failed: {reason}", reason=reason)
    if isinstance(error, OSError) and error.errno is not None and "[SSL" not in own:
        return _SYSTEM_MESSAGES.get(error.errno) or str(error.strerror)
    if isinstance(error, ValueError) and (
        found := re.search(r"(?:could not convert string to float|invalid literal for int.*?): (.*)", own)
    ):
        return Sentence("number-malformed", "{text} is not a number", text=found[1][:60])
    return _of_service_library(error, own) or (own.strip().splitlines() or [type(error).__name__])[0][:_MAX_CHARACTERS]


def _of_service_library(error: BaseException, own: str) -> str | None:
    """Returns the message of an error of Redis, SQLite, the object store or the multipart parser; None for others."""
    module = type(error).__module__.partition(".")[0]
    if module == "python_multipart":
        if "boundary" in own.lower():
            return Sentence("multipart-boundary-malformed", "a boundary between its parts is malformed")
        return Sentence("multipart-header-malformed", "the header of a part is malformed")
    if module == "obstore":
        if (found := _STORE_MESSAGES.get(type(error).__name__)) is not None:
            return found
        if "error sending request" in own or "dns error" in own:
            return Sentence("store-not-reachable", "its server cannot be reached")
    if "[SSL" in own:
        return None
    if (place := _CONNECTING.search(own)) and (cause := _SYSTEM_MESSAGES.get(int(place[1]))) is not None:
        return Sentence("redis-connection-failed", "{address}: {error}", address=place[2], error=cause)
    if (number := _ERRNO.search(own)) and (cause := _SYSTEM_MESSAGES.get(int(number[1]))) is not None:
        return cause
    return next((sentence for pattern, sentence in _TEXT_MESSAGES if re.search(pattern, own)), None)


def _of_xml(error: expat.ExpatError | ElementTree.ParseError) -> str:
    line, column = (error.lineno, error.offset) if isinstance(error, expat.ExpatError) else error.position
    match expat.errors.messages.get(error.code):
        case expat.errors.XML_ERROR_NO_ELEMENTS:
            return Sentence("xml-no-element", "no element found: line {line}, column {column}", line=line, column=column)
        case expat.errors.XML_ERROR_INVALID_TOKEN:
            return Sentence("xml-invalid-token", "invalid token: line {line}, column {column}", line=line, column=column)
        case expat.errors.XML_ERROR_TAG_MISMATCH:
            return Sentence("xml-tag-mismatch", "mismatched tag: line {line}, column {column}", line=line, column=column)
        case expat.errors.XML_ERROR_UNCLOSED_TOKEN:
            return Sentence("xml-token-not-closed", "unclosed token: line {line}, column {column}", line=line, column=column)
        case expat.errors.XML_ERROR_DUPLICATE_ATTRIBUTE:
            return Sentence(
                "xml-attribute-duplicate", "duplicate attribute: line {line}, column {column}", line=line, column=column
            )
        case expat.errors.XML_ERROR_JUNK_AFTER_DOC_ELEMENT:
            return Sentence(
                "xml-after-root", "content after the root element: line {line}, column {column}", line=line, column=column
            )
        case expat.errors.XML_ERROR_UNDEFINED_ENTITY:
            return Sentence("xml-entity-undefined", "undefined entity: line {line}, column {column}", line=line, column=column)
        case expat.errors.XML_ERROR_UNBOUND_PREFIX:
            return Sentence("xml-prefix-unbound", "unbound prefix: line {line}, column {column}", line=line, column=column)
        case expat.errors.XML_ERROR_UNKNOWN_ENCODING:
            return Sentence("xml-encoding-unknown", "unknown encoding: line {line}, column {column}", line=line, column=column)
    return Sentence("xml-malformed", "not well-formed: line {line}, column {column}", line=line, column=column)
