"""Error sentences for an address at which a server other than a Rayfarm service answers.

Imports little, since the command line uses these sentences too.
"""

from __future__ import annotations

import json
import re
from typing import Any
from urllib.parse import urlsplit

from renderer.sentences import Sentence

__all__ = ["MAX_ANSWER", "describe_answer", "is_address", "is_loopback", "not_a_farm"]

MAX_ANSWER = 64 << 20  # bytes of JSON; a longer answer does not come from a farm


def is_address(url: str) -> bool:
    """Returns True if `url` is a valid address of a service: HTTP or HTTPS, with a host."""
    try:
        parts = urlsplit(url)
        is_http = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        return False
    return is_http and not re.search(r"\s", url)


def is_loopback(url: str) -> bool:
    """Returns True if an address is this machine's loopback, for which no proxy such as HTTP_PROXY is used."""
    try:
        return urlsplit(url).hostname in ("localhost", "127.0.0.1", "::1")
    except ValueError:
        return False


def not_a_farm(url: str, description: str) -> str:
    """Returns the error message for `url`, at which a server other than a Rayfarm service answers.

    description: description of that server's response, from `describe_answer`.
    """
    return Sentence(
        "not-a-farm",
        "{url} answers, but it is not a Rayfarm service: {description}. Give the address that `rayfarm up` shows, as "
        "http://host:8000.",
        url=url,
        description=description,
    )


def describe_answer(body: bytes, content_type: str = "") -> str:
    """Returns a description of a response for the user: empty, an HTML page, a list ..."""
    if not body.strip():
        return Sentence("answer-empty", "its answer is empty")
    if "html" in content_type or body.lstrip()[:15].lower().startswith((b"<!doctype html", b"<html")):
        return Sentence("answer-html", "its answer is an HTML page")
    try:
        data: Any = json.loads(body)
    except (ValueError, RecursionError):
        named = content_type.partition(";")[0].strip()
        return Sentence("answer-not-json", "its answer is not JSON ({type})", type=named or "?")
    if isinstance(data, dict):
        return Sentence("answer-incomplete", "its JSON lacks fields that a farm sends")
    return Sentence(
        "answer-not-object",
        "its answer is not a JSON object ({type})",
        type={list: "array", str: "string", bool: "boolean", type(None): "null"}.get(type(data), "number"),
    )
