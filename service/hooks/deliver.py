"""Delivery of one message to one hook, in one attempt."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import json
import os
import signal
import ssl
import subprocess
import tempfile
import time
from typing import IO, Any
from urllib.parse import urlsplit

from renderer.library_messages import library_message
from renderer.sentences import Sentence
from service.hooks.signing import headers

__all__ = ["RefusedError", "UndeliveredError", "post", "redacted_hook", "run_program"]

ANSWER_TIMEOUT_S = 10.0
RUN_TIMEOUT_S = 60.0
MAX_ERROR_OUTPUT = 300  # characters of a program's error output that are kept


def redacted_hook(hook: str) -> str:
    """Returns the text of a hook for logs: for a URL, only scheme and host, since its path often contains a secret."""
    parts = urlsplit(hook)
    return f"{parts.scheme}://{parts.hostname}/..." if parts.scheme and parts.netloc else hook


class UndeliveredError(Exception):
    """A delivery failed. The message is the reason, as a sentence; a later attempt may succeed."""


class RefusedError(UndeliveredError):
    """The receiver no longer wants messages (HTTP 410)."""


def post(url: str, secret: str, id: str, message: dict[str, Any]) -> None:
    """Posts a signed message to a webhook. Raises UndeliveredError, or RefusedError if the receiver answers 410."""
    import httpx  # imported only if needed: the import takes a tenth of a second of a starting service

    body = json.dumps(message, separators=(",", ":")).encode()
    signed = {"Content-Type": "application/json", "User-Agent": "rayfarm", **headers(secret, id, int(time.time()), body)}
    try:
        status = asyncio.run(_status(url, body, signed))
    except TimeoutError:
        raise UndeliveredError(
            Sentence("hook-timeout", "It did not answer within {seconds} s.", seconds=f"{ANSWER_TIMEOUT_S:.0f}")
        ) from None
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        raise UndeliveredError(
            Sentence(
                "hook-not-reachable",
                "It could not be reached ({kind}: {error}).",
                kind=type(error).__name__,
                error=library_message(error),
            )
        ) from None
    if status == httpx.codes.GONE:
        raise RefusedError(Sentence("hook-gone", "It answered 410: it accepts no more messages."))
    if not 200 <= status < 300:
        raise UndeliveredError(Sentence("hook-status", "It answered {status}.", status=status))


async def _status(url: str, body: bytes, signed: dict[str, str]) -> int:
    import httpx

    # httpx's own timeouts apply to each chunk of a response, not to the whole.
    client = httpx.AsyncClient(timeout=None, follow_redirects=False, verify=_certificates())
    async with asyncio.timeout(ANSWER_TIMEOUT_S), client, client.stream("POST", url, content=body, headers=signed) as answer:
        return answer.status_code


@functools.cache
def _certificates() -> ssl.SSLContext:
    """Returns the TLS context with the trusted certificates. Cached, since loading them takes longer than sending a message."""
    import httpx

    return httpx.create_ssl_context()


def run_program(program: str, id: str, message: dict[str, Any]) -> None:
    """Runs a notification program with the message on its standard input. Raises UndeliveredError."""
    data = message["data"]
    variables = {"RAYFARM_EVENT": message["type"], "RAYFARM_MESSAGE_ID": id}
    variables |= {f"RAYFARM_JOB_{key.upper()}": str(data.get(key) or "") for key in ("id", "name", "state", "error", "page")}
    # The program must not receive the farm's secrets.
    inherited = {key: value for key, value in os.environ.items() if not key.startswith("RAYFARM_")}
    try:
        with tempfile.TemporaryFile() as stderr:  # a pipe would stay open as long as background processes of the program run
            env = inherited | {key: value.replace("\0", "") for key, value in variables.items()}
            returned = _exit_status([program], json.dumps(message).encode(), env, stderr)
            stderr.seek(max(0, stderr.seek(0, os.SEEK_END) - 4 * MAX_ERROR_OUTPUT))
            said = stderr.read(4 * MAX_ERROR_OUTPUT).decode(errors="replace").strip()[-MAX_ERROR_OUTPUT:]
    except subprocess.TimeoutExpired:
        raise UndeliveredError(
            Sentence(
                "hook-program-timeout", "The program took longer than {seconds} s and was ended.", seconds=f"{RUN_TIMEOUT_S:.0f}"
            )
        ) from None
    except OSError as error:
        raise UndeliveredError(
            Sentence("hook-program-not-startable", "The program could not be started ({error}).", error=library_message(error))
        ) from None
    if returned:
        raise UndeliveredError(
            Sentence("hook-program-failed", "The program ended with {status}. Its output: {output}", status=returned, output=said)
            if said
            else Sentence("hook-program-failed-silently", "The program ended with {status}.", status=returned)
        )


def _exit_status(command: list[str], text: bytes, env: dict[str, str], stderr: IO[bytes]) -> int:
    """Runs a command and returns its exit status.

    If it runs longer than RUN_TIMEOUT_S seconds, kills its process group, so that processes do not accumulate, and raises
    subprocess.TimeoutExpired.
    """
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=stderr, env=env, start_new_session=True
    ) as process:
        try:
            process.communicate(text, timeout=RUN_TIMEOUT_S)
        except BaseException:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            raise
        return process.returncode
