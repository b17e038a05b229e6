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

__all__ = ["library_message"]

_MOST = 200  # characters of a message

_OF_SYSTEM: dict[int, str] = {
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


def library_message(error: BaseException) -> str:
    """Returns the message of an exception of the system or of a library: a Sentence with a code if the message is known."""
    own = str(error)
    if isinstance(own, Sentence):
        return own
    if isinstance(error, (expat.ExpatError, ElementTree.ParseError)):
        return _of_xml(error)
    if isinstance(error, json.JSONDecodeError):
        return Sentence("json-position", "line {line}, column {column}", line=error.lineno, column=error.colno)
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
    if isinstance(error, OSError) and error.errno is not None:
        return _OF_SYSTEM.get(error.errno) or str(error.strerror)
    if isinstance(error, ValueError) and (
        found := re.search(r"(?:could not convert string to float|invalid literal for int.*?): (.*)", own)
    ):
        return Sentence("number-malformed", "{text} is not a number", text=found[1][:60])
    return (own.strip().splitlines() or [type(error).__name__])[0][:_MOST]


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
